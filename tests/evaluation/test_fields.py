"""Forecasts of a system whose state is a field."""

from __future__ import annotations

import numpy as np
import pytest

from expertaug.errors import InputError
from expertaug.evaluation import traces
from expertaug.evaluation.forecast_file import Forecasts

LABELS = ("Mean", "Hybrid", "Hybrid+")


def write(folder, space=(8, 8), labels=LABELS):
    """Two components over some space, 11 times, 2 samples, seeds 3 and 5."""
    rng = np.random.default_rng(0)
    truth = rng.normal(size=(2, 11, 2, *space)).astype(np.float32)
    names = {"state_names": ["u", "v"], "state_units": ["", ""], "parameter_names": ["a"], "parameter_units": [""]}
    paths = {}
    for k, label in enumerate(labels):
        paths[label] = folder / f"{k}.npz"
        arrays = {"test_truth": truth, "test_prediction": np.stack([truth + k, truth - k]), "test_index": [4, 9]}
        arrays |= {"test_z_e": np.full((20, 1), 0.5), "t": np.arange(11.0), "observed": 3, "seeds": [3, 5]}
        np.savez(paths[label], **arrays, **names)
    return paths, truth


def test_truth_method_and_augmented_method_at_six_times(tmp_path, drawn):
    paths, truth = write(tmp_path)
    traces.forecasts(paths, tmp_path / "f", {"seed": 5, "labels": list(LABELS)})
    panels = [axis for axis in drawn[0].axes if axis.images]
    assert len(panels) == 18, "truth, Hybrid and Hybrid+"
    np.testing.assert_array_equal(panels[4].images[0].get_array(), truth[0, 8, 0])
    np.testing.assert_allclose(panels[-1].images[0].get_array(), truth[0, 10, 0] - 2, rtol=1e-6)
    assert [panels[k].get_ylabel() for k in (0, 6, 12)] == ["truth", "Hybrid", "Hybrid+"]
    assert panels[0].get_title() == "t = 0 s\nobserved" and "forecast" in panels[2].get_title()
    assert (tmp_path / "f.png").is_file() and (tmp_path / "f.pdf").is_file()


def test_other_samples_and_spaces(tmp_path, drawn):
    paths, truth = write(tmp_path, space=(8,), labels=("Hybrid",))
    traces.forecasts(paths, [tmp_path / "f.png"], {"samples": [1]})
    lines = [axis.lines[0] for axis in drawn[0].axes]
    np.testing.assert_array_equal(lines[5].get_ydata(), truth[1, 10, 0])
    with pytest.raises(InputError, match="no seed 9"):
        traces.forecasts(paths, tmp_path / "f", {"seed": 9})


def test_shapes_are_checked(tmp_path):
    paths, _ = write(tmp_path, labels=("Hybrid",))
    arrays = dict(np.load(paths["Hybrid"]))
    arrays["test_prediction"] = arrays["test_prediction"][..., :4]
    np.savez(paths["Hybrid"], **arrays)
    with pytest.raises(InputError, match=r"here \(2, 2, 11, 2, 8, 8\)"):
        Forecasts.load(paths["Hybrid"])

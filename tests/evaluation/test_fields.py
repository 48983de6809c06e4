"""Forecasts of a system whose state is a field."""

from __future__ import annotations

import numpy as np
import pytest
from fake_runs import loaded

from expertaug import plotting
from expertaug.errors import InputError
from expertaug.evaluation import traces
from expertaug.evaluation.forecasts import Forecasts
from expertaug.evaluation.settings import FigureReading
from expertaug.evaluation.traces import View

METHODS = ("mean", "hybrid", "hybrid+")
LABELS = FigureReading.of(labels=[["hybrid", "Hybrid"], ["hybrid+", "Hybrid+"]])


def write(folder, space=(8, 8), methods=METHODS):
    """Two components over some space, 11 times, 2 samples, seeds 3 and 5."""
    rng = np.random.default_rng(0)
    truth = rng.normal(size=(2, 11, 2, *space)).astype(np.float32)
    names = {"state_names": ["u", "v"], "state_units": ["", ""], "parameter_names": ["a"], "parameter_units": [""]}
    paths = {}
    for k, method in enumerate(methods):
        paths[method] = folder / f"{k}.npz"
        arrays = {"test_truth": truth, "test_prediction": np.stack([truth + k, truth - k]), "test_index": [4, 9]}
        arrays |= {"test_z_e": np.full((20, 1), 0.5), "t": np.arange(11.0), "observed": 3, "seeds": [3, 5]}
        np.savez(paths[method], **arrays, **names)
    return paths, truth


def test_states_and_errors_of_truth_method_and_augmented_method(tmp_path):
    paths, truth = write(tmp_path)
    figure = traces.forecasts(loaded(paths), LABELS, View(seed=5))
    panels = [axis for axis in figure.axes if axis.images]
    assert len(panels) == 3 * 4 + 2 * 2, "states of truth, Hybrid and Hybrid+; errors of two forecast times"
    np.testing.assert_array_equal(panels[2].images[0].get_array(), truth[0, 7, 0])
    np.testing.assert_allclose(panels[11].images[0].get_array(), truth[0, 3, 0] - 2, rtol=1e-6)
    assert [panels[k].get_title() for k in (0, 3)] == ["t = 0 s\nobserved", "t = 10 s\nforecast"]
    named = [axis.get_ylabel() for axis in panels if axis.get_ylabel()]
    assert named == ["truth", "Hybrid\n1", "Hybrid+\n2"], "the errors of seed 5 are -1 and -2 everywhere"
    augmented = panels[-2:]
    for axis in augmented:
        np.testing.assert_allclose(axis.images[0].get_array(), -2, rtol=1e-5)
    (limits,) = {axis.images[0].get_clim() for axis in augmented}
    assert limits == pytest.approx((-2, 2), rel=1e-5)
    plotting.save_all({tmp_path / "f": figure})
    assert (tmp_path / "f.png").is_file() and (tmp_path / "f.pdf").is_file()


def test_other_samples_and_spaces(tmp_path):
    paths, truth = write(tmp_path, space=(8,), methods=("hybrid",))
    figure = traces.forecasts(loaded(paths), view=View(samples=[1]))
    lines = [axis.lines[0] for axis in figure.axes if axis.lines]
    np.testing.assert_array_equal(lines[3].get_ydata(), truth[1, 10, 0])
    low, high = lines[3].axes.get_ylim()
    room = 0.1 * np.ptp(truth[1, :, 0])
    assert (low, high) == pytest.approx((truth[1, :, 0].min() - room, truth[1, :, 0].max() + room))
    assert len(lines[0].axes.get_yticks()) > 1 and not len(lines[3].axes.get_yticks())
    assert next(axis.get_ylabel() for axis in figure.axes if axis.get_ylabel()) == "truth\n$u$ [1]"
    with pytest.raises(InputError, match="no seed 9"):
        traces.forecasts(loaded(paths), view=View(seed=9))


@pytest.mark.parametrize(("z_e", "drawn_sample"), [((0.5, 0.5), 0), ((0.5, 1.1), 1), ((-0.3, 1.2), 0)])
def test_the_sample_farthest_outside_the_training_range_is_drawn(tmp_path, z_e, drawn_sample):
    paths, truth = write(tmp_path, methods=("hybrid",))
    arrays = dict(np.load(paths["hybrid"]))
    arrays["train_z_e"] = np.array([[0.0], [1.0]])
    arrays["test_z_e"][[4, 9], 0] = z_e
    np.savez(paths["hybrid"], **arrays)
    figure = traces.forecasts(loaded(paths))
    first = next(axis for axis in figure.axes if axis.images)
    np.testing.assert_array_equal(first.images[0].get_array(), truth[drawn_sample, 0, 0])


def test_a_forecast_that_ran_away_leaves_the_scale_to_the_others(tmp_path):
    paths, _ = write(tmp_path)
    arrays = dict(np.load(paths["hybrid"]))
    arrays["test_prediction"][0, 0, 9:, 0, 0, 0] = np.nan
    np.savez(paths["hybrid"], **arrays)
    figure = traces.forecasts(loaded(paths), LABELS)
    last = [axis for axis in figure.axes if axis.images][-1]
    assert last.images[0].get_clim() == pytest.approx((-2, 2), rel=1e-5)


def test_shapes_are_checked(tmp_path):
    paths, _ = write(tmp_path, methods=("hybrid",))
    arrays = dict(np.load(paths["hybrid"]))
    arrays["test_prediction"] = arrays["test_prediction"][..., :4]
    np.savez(paths["hybrid"], **arrays)
    with pytest.raises(InputError, match=r"here \(2, 2, 11, 2, 8, 8\)"):
        Forecasts.load(paths["hybrid"])

"""Figures of estimated parameters."""

from __future__ import annotations

import numpy as np
import pytest
from fake_runs import LABELS, loaded, method_of, pairs, write_double_forecasts, write_forecasts
from whole_figures import assert_nothing_is_cut

from expertaug import plotting
from expertaug.evaluation import dots, parameters
from expertaug.evaluation.settings import ParameterReading


@pytest.mark.parametrize("write", [write_forecasts, write_double_forecasts])
def test_parameters(tmp_path, write):
    paths = write(tmp_path)
    for path in paths.values():
        np.savez(path, **np.load(path), version=["swing", "corrected", "a"])
    ranges = {"omega0": [1.5, 3.1], "omega1": [-20, 20], "omega2": [-40, 40]}
    reading = ParameterReading(training_range=ranges, priors={"hybrid": {"omega0": [0.25, 3.5]}}, **pairs())
    figure = parameters.parameters(loaded(paths), reading)
    assert figure.get_suptitle() == "swing: expert parameters"
    panels = figure.axes
    estimating = [label for label in LABELS if method_of(label) in paths and label not in ("Mean", "ML only")]
    assert [axis.get_title() for axis in panels[: len(estimating)]] == estimating
    patch = panels[0].patches[0]
    low, high = ranges["omega0" if write is write_forecasts else "omega1"]
    assert (patch.get_x(), patch.get_width()) == pytest.approx((low, high - low))
    for panel in panels[: len(estimating)]:
        edges = [line.get_xdata()[0] for line in panel.lines if len(set(line.get_xdata())) == 1]
        own = write is write_forecasts and panel.get_title() == "Hybrid"
        assert edges == ([0.25, 3.5] if own else [])
    with np.load(paths["hybrid"]) as data:
        names = data["parameter_names"]
        count = sum(len(c.get_offsets()) for c in panels[1].collections)
        assert count == 2 * len(data["seeds"]) * min(len(data["test_z_e"]), parameters.POINTS)
    assert len(panels) == len(names) * len(estimating)
    assert_nothing_is_cut(figure)


def test_long_units_of_many_methods_do_not_collide(tmp_path, monkeypatch):
    monkeypatch.setattr(plotting, "quantity", lambda name, unit: "$b$ [1/(m s)^2]")
    paths = dict.fromkeys([f"Method {k}" for k in range(7)], write_double_forecasts(tmp_path)["hybrid"])
    figure = parameters.parameters(loaded(paths))
    with plotting.use_style():
        figure.draw_without_rendering()
        boxes = [axis.xaxis.label.get_window_extent() for axis in figure.axes]
        boxes += [axis.yaxis.label.get_window_extent() for axis in figure.axes if axis.get_ylabel()]
    assert not any(a.overlaps(b) for k, a in enumerate(boxes) for b in boxes[:k])


def test_estimates_outside_are_counted(tmp_path):
    paths = write_forecasts(tmp_path, labels=("Hybrid",))
    arrays = dict(np.load(paths["hybrid"]))
    arrays["test_z_e_hat"][:] = 50
    np.savez(paths["hybrid"], **arrays)
    figure = parameters.parameters(loaded(paths))
    (told,) = figure.axes[0].texts
    assert told.get_text() == "50 % outside" and told.get_position()[1] > 1, "above the panel"
    assert_nothing_is_cut(figure)


def test_filled_marks_are_the_shifted_sets_as_in_dots(tmp_path):
    figure = parameters.parameters(loaded(write_forecasts(tmp_path, labels=("Hybrid",))))
    looks = {
        text.get_text(): line
        for text, line in zip(figure.legends[0].get_texts(), figure.legends[0].legend_handles, strict=True)
    }
    assert looks["test (OOD)"].get_markerfacecolor() != "none"
    assert looks["validation (set of choices)"].get_markerfacecolor() == "none"
    for name, (marker, face) in dots.LOOKS.items():
        if name in ("validation", "iid", "test"):
            assert parameters.MARKERS[name] == marker and (face == "own") == (name == "test")

"""Figures of forecasts, also of fields, and of trainings."""

from __future__ import annotations

import itertools
import json

import numpy as np
import pytest
from fake_runs import loaded, pairs, write_double_forecasts, write_forecasts, write_logs
from whole_figures import assert_nothing_is_cut

from expertaug import plotting
from expertaug.errors import InputError
from expertaug.evaluation import traces
from expertaug.evaluation.forecasts import Forecasts
from expertaug.evaluation.settings import FigureReading
from expertaug.evaluation.traces import View
from expertaug.tracking.log import read_log

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


def test_forecasts(tmp_path):
    paths = write_forecasts(tmp_path)
    for path in paths.values():
        np.savez(path, **np.load(path), version=["swing", "corrected", "a"])
    title = "swing (toy run)"
    figure = traces.forecasts(loaded(paths), FigureReading(**pairs(), title=title), View(seed=1))
    assert figure.get_suptitle() == "swing (toy run): forecasts on the test (OOD) set, seed 1"
    panels = figure.axes
    assert len(panels) == 6
    assert [panels[0].get_ylabel(), panels[3].get_ylabel()] == [r"$\theta$ [rad]", r"$\omega$ [rad/s]"]
    with np.load(paths["hybrid+"]) as data:
        np.testing.assert_array_equal(panels[4].lines[0].get_ydata(), data["test_truth"][1, :, 1])
        np.testing.assert_array_equal(panels[4].lines[-1].get_ydata(), data["test_prediction"][1, 1, :, 1])
    window = panels[0].patches[0]
    assert (window.get_x(), window.get_width()) == (0.0, 5.0)
    assert_nothing_is_cut(figure)


def test_bands_in_the_legend_are_those_that_can_be_seen(tmp_path):
    paths = write_forecasts(tmp_path, labels=("Hybrid", "Hybrid+", "Mean"))
    for method, width in (("hybrid", 0.3), ("hybrid+", 1e-3)):
        arrays = dict(np.load(paths[method]))
        later = arrays["test_prediction"][..., -150:, :]
        np.savez(paths[method], **arrays, test_band=np.stack((later - width, later + width)))
    figure = traces.forecasts(loaded(paths), FigureReading(**pairs(("Hybrid", "Hybrid+", "Mean"))))
    legend = figure.legends[0]
    bands = [text.get_text() for text in legend.get_texts() if "band" in text.get_text()]
    assert bands == ["90 % band of Hybrid"]
    truth, *others = figure.axes[0].lines
    assert all(truth.get_zorder() < line.get_zorder() for line in others), "no forecast is wholly under the truth"
    assert truth.get_linewidth() > 2 * max(line.get_linewidth() for line in others)


def test_forecasts_of_four_dimensions(tmp_path):
    paths = write_double_forecasts(tmp_path)
    figure = traces.forecasts(loaded(paths), view=View(set="validation", samples=[0, 2]))
    assert len(figure.axes) == 8
    assert_nothing_is_cut(figure)


def test_a_runaway_forecast_leaves_the_truth_visible(tmp_path):
    paths = write_forecasts(tmp_path, labels=("Hybrid",))
    arrays = dict(np.load(paths["hybrid"]))
    arrays["test_prediction"][..., -1, :] = 1e6
    np.savez(paths["hybrid"], **arrays)
    figure = traces.forecasts(loaded(paths))
    assert figure.axes[0].get_ylim()[1] < 4


def test_curves(tmp_path):
    logs = write_logs(tmp_path, steps=40) + write_logs(tmp_path, "double_swing", steps=1000)
    figure = traces.curves(map(read_log, logs), FigureReading(**pairs()))
    loss, score, long_loss, _ = figure.axes
    assert len(loss.lines) == 3
    assert list(loss.lines[0].get_xdata()) == list(range(1, 41))
    assert list(score.lines[0].get_xdata()) == [10, 20, 30, 40]
    assert len(long_loss.lines[0].get_xdata()) <= traces.CURVE_POINTS
    assert long_loss.get_yscale() == "log"
    assert_nothing_is_cut(figure)
    figure = traces.curves(map(read_log, logs), FigureReading(**pairs()), ["hybrid", "hybrid+"])
    assert len(figure.axes[0].lines) == 2
    assert not figure.get_suptitle() and figure.axes[1].get_ylabel() == "selection score"
    figure = traces.curves(map(read_log, logs[:3]), FigureReading(**pairs()))
    assert figure.get_suptitle() == "swing" and not any(axis.get_title() for axis in figure.axes)
    assert_nothing_is_cut(figure)


def test_labels_of_a_loss_that_falls_below_zero_do_not_collide(tmp_path):
    """A few values of hundreds, most of them of five, the last ones below zero."""
    logs = write_logs(tmp_path, labels=("Hybrid",), steps=40)
    for log in logs:
        lines = [json.loads(line) for line in log.read_text().splitlines()]
        steps = [line for line in lines if "loss" in line]
        for line, value in zip(steps, [500.0, 150.0, 50.0, *[5.0] * 27, *[-10.0] * 10], strict=True):
            line["loss"] = [value] * len(line["loss"])
        log.write_text("".join(json.dumps(line) + "\n" for line in lines))
    figure = traces.curves(map(read_log, logs))
    axis = figure.axes[0]
    assert axis.get_yscale() == "symlog"
    with plotting.use_style():
        figure.draw_without_rendering()
    boxes = [tick.label1.get_window_extent() for tick in axis.yaxis.get_major_ticks() if tick.label1.get_text()]
    shown = sorted((box.y0, box.y1) for box in boxes if axis.bbox.y0 <= (box.y0 + box.y1) / 2 <= axis.bbox.y1)
    assert len(shown) >= 4 and all(one[1] < other[0] for one, other in itertools.pairwise(shown))


def test_a_course_of_one_step_is_not_in_the_legend(tmp_path):
    logs = write_logs(tmp_path, labels=("Hybrid", "Mean"), steps=20)
    short = logs[-1].read_text().splitlines()
    steps = [k for k, line in enumerate(short) if "loss" in line]
    logs[-1].write_text("".join(f"{line}\n" for k, line in enumerate(short) if k not in steps[1:]))
    figure = traces.curves(map(read_log, logs), FigureReading(**pairs(("Hybrid", "Mean"))))
    assert len(figure.axes[0].lines) == 1
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["Hybrid", "range over seeds (line: mean)"]


def test_where_nothing_is_trained_the_curves_say_so():
    assert traces.curves([]).texts[0].get_text() == "no method is trained by gradient steps"


def test_a_label_may_look_like_another_methods_version(tmp_path):
    """Colours and lines follow from the methods, whatever their labels end in."""
    logs = write_logs(tmp_path, labels=("Hybrid", "Hybrid+"), steps=20)
    for path, label in zip(logs, ("A+ (x)", "B"), strict=True):
        path.write_text(path.read_text().replace(f'"label": "Hybrid{"+" * (label == "B")}"', f'"label": "{label}"'))
    figure = traces.curves(map(read_log, logs), FigureReading(labels=[], hues=[("hybrid", 0)]))
    plain, augmented = figure.axes[0].lines
    assert [handle.get_label() for handle in figure.legends[0].legend_handles[:2]] == ["A+ (x)", "B"]
    assert (plain.get_linestyle(), augmented.get_linestyle()) == ("--", "-")
    assert sum(plain.get_color()) > sum(augmented.get_color())

"""Figures: what is drawn, that nothing is cut off, and that bad input is told."""

from __future__ import annotations

import itertools
import json

import numpy as np
import pandas as pd
import pytest
from fake_runs import (
    LABELS,
    loaded,
    method_of,
    pairs,
    rows_of,
    tables_of,
    write_double_forecasts,
    write_forecasts,
    write_logs,
    write_metrics,
)
from matplotlib.image import imread

from expertaug import plotting
from expertaug.errors import InputError
from expertaug.evaluation import dots, parameters, traces
from expertaug.evaluation.forecasts import Forecasts
from expertaug.evaluation.settings import FigureReading, ParameterReading, PlotJob, Titles
from expertaug.evaluation.traces import View
from expertaug.hues import HUES, assign_hues
from expertaug.tracking.log import read_log


def assert_nothing_is_cut(figure):
    """All texts and legends lie inside the page, and the legend touches no panel."""
    with plotting.use_style():
        figure.draw_without_rendering()
        renderer = figure.canvas.get_renderer()
        page = figure.bbox
        inside = [axis.get_tightbbox(renderer) for axis in figure.axes if axis.axison]
        parts = [*figure.legends, *figure.texts]
        boxes = [*inside, *(part.get_window_extent(renderer) for part in parts)]
    for box in boxes:
        assert box.x0 >= page.x0 - 1
        assert box.x1 <= page.x1 + 1
        assert box.y0 >= page.y0 - 1
        assert box.y1 <= page.y1 + 1
    for legend in figure.legends:
        assert not any(legend.get_window_extent(renderer).overlaps(box) for box in inside)


def test_an_end_that_rounding_puts_beyond_its_mean_is_drawn(drawn, tmp_path):
    """Of a parameter that all windows share each sample has the same error."""
    lengths = plotting.whiskers([14.457905, 1.0], [14.457905 + 2e-15, np.nan], [14.457905, 2.0])
    assert (lengths >= 0).all() and lengths[:, 1].tolist() == [0.0, 1.0]
    (axis,) = plotting.new_figure(2).subplots(1, 1, squeeze=False)[0]
    axis.errorbar([14.457905, 1.0], [0, 1], xerr=lengths)


def test_dots_are_at_the_means(tmp_path):
    metrics = write_metrics(tmp_path)
    (path,) = tables_of(metrics)
    table = pd.read_csv(path)
    known = table["label"] != "Mean"  # of which no samples are kept
    table.assign(low=(table["mean"] - 0.3).where(known), high=(table["mean"] + 0.5).where(known)).to_csv(path)
    figure = dots.log_mse(rows_of([path]), PlotJob(**pairs()))
    plotting.save_all({tmp_path / "dots": figure})
    table = pd.concat(map(pd.read_csv, metrics)).query("metric == 'log_mse_sum'")
    axis = figure.axes[0]
    marks = [line for line in axis.lines if not line.get_label().startswith("_")]  # the ends of an error bar have none
    places = sorted(line.get_xdata()[0] for line in marks)
    assert places == pytest.approx(sorted(table.groupby(["label", "set"])["value"].mean()))
    means = table[table["label"] != "Mean"].groupby(["label", "set"])["value"].mean()
    ends = sorted(tuple(c.get_segments()[0][:, 0]) for c in axis.collections)
    assert ends == [pytest.approx((mean - 0.3, mean + 0.5)) for mean in sorted(means)], "the table's intervals"
    assert not figure.get_suptitle()
    assert (tmp_path / "dots.pdf").read_bytes().startswith(b"%PDF")
    assert imread(tmp_path / "dots.png").std() > 0.1
    assert_nothing_is_cut(figure)


def test_where_there_is_an_iid_test_set_figures_leave_validation_out(tmp_path):
    metrics = write_metrics(tmp_path)
    without = dots.log_mse(rows_of(tables_of(metrics)), PlotJob(**pairs()))
    for path in metrics:
        table = pd.read_csv(path)
        pd.concat([table, table[table["set"] == "validation"].assign(set="iid")]).to_csv(path, index=False)
    figure = dots.log_mse(rows_of(tables_of(metrics)), PlotJob(**pairs()))
    entries = [[text.get_text() for text in each.legends[0].get_texts()] for each in (without, figure)]
    assert entries == [["train", "validation (set of choices)", "test (OOD)"], ["train", "IID test", "test (OOD)"]]
    assert_nothing_is_cut(figure)


@pytest.mark.parametrize("seeds", [(0,), (0, 1, 2)])
def test_several_experiments_and_long_labels_fit(tmp_path, monkeypatch, seeds):
    from fake_runs import SWING

    name = "Expert only (equal point masses)"
    monkeypatch.setitem(SWING, name, SWING["Expert only"])
    monkeypatch.setitem(SWING, "Other+", SWING["Hybrid+"])
    labels = [*LABELS, name, "Other+"]
    metrics = write_metrics(tmp_path, labels=labels, seeds=seeds)
    for paths in (metrics, metrics + write_metrics(tmp_path, "double_swing", seeds, labels)):
        rows = rows_of(tables_of(paths))
        assert_nothing_is_cut(dots.log_mse(rows, PlotJob(labels=[])))
        figure = dots.parameter_errors(rows, PlotJob(labels=[]))
        assert_nothing_is_cut(figure)
    assert all(axis.get_xlabel() for axis in figure.axes), "below each column"
    assert [axis.get_title() for axis in figure.axes][:2] == [r"swing: $\omega_{0}$", r"double swing: $\omega_{1}$"]


def test_dots_of_a_method_without_finite_values(tmp_path):
    metrics = write_metrics(tmp_path)
    table = pd.read_csv(metrics[0])
    table["value"] = np.inf
    table.to_csv(metrics[0], index=False)
    figure = dots.log_mse(rows_of(tables_of(metrics)), PlotJob(labels=[]))
    assert sum(text.get_text() == "not finite" for text in figure.axes[0].texts) == 3
    assert_nothing_is_cut(figure)


def test_same_numbers_make_the_same_files(tmp_path):
    rows = rows_of(tables_of(write_metrics(tmp_path)))
    for name in ("a", "b"):
        plotting.save_all({tmp_path / name: dots.log_mse(rows, PlotJob(labels=[]))})
    for suffix in (".png", ".pdf"):
        assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()


def test_a_method_has_one_colour_in_figures_of_different_methods():
    hues = {"mean": 0, "expert_only": 1, "hybrid": 2}
    assert plotting.colours(["hybrid"], hues)["hybrid"] == plotting.colours(["mean", "hybrid"], hues)["hybrid"]
    pair = plotting.colours(["hybrid", "hybrid+", "hybrid+wide"], hues)
    assert sum(pair["hybrid"]) > sum(pair["hybrid+"]) + 0.5 and pair["hybrid+wide"] == pair["hybrid+"]


def test_methods_drawn_together_have_hues_of_their_own_as_long_as_there_are_as_many():
    count = len(HUES)
    methods = [f"m{k}" for k in range(2 * count)]
    found = assign_hues([*([name] for name in methods), methods[count - 1 : 2 * count - 1], [methods[0], methods[-1]]])
    assert [found[name] for name in methods[:count]] == list(range(count))
    assert len({found[name] for name in methods[count - 1 : 2 * count - 1]}) == count
    assert found[methods[0]] != found[methods[-1]]
    assert set(assign_hues([methods]).values()) == set(range(count)), "more than there are hues: each is taken"
    assert plotting.colours(["a", "b"], {"a": 3})["a"] == plotting.colours(["a"], {"a": 3})["a"]
    assert len(set(plotting.colours(["a", "b", "c"], {"a": 1}).values())) == 3


def test_words_are_printed_once():
    once = plotting.text("APHYNITY (F_a of known form), z_e")
    assert once == "APHYNITY ($F_a$ of known form), $z_e$" == plotting.text(once)


def test_symbols():
    assert plotting.symbol("omega0") == r"$\omega_{0}$"
    assert plotting.symbol("theta") == r"$\theta$"
    assert plotting.symbol("L") == "$L$"
    assert plotting.symbol("spring_rate") == "spring rate"
    assert plotting.quantity("k", "") == "$k$ [1]"


def test_names_with_underscores_are_made_readable():
    assert plotting.text("APHYNITY, F_a sees z_e+") == "APHYNITY, $F_a$ sees $z_e$+"
    assert Titles().of_set("both_small") == "both small" and Titles().of_set("z_a_small") == "z_a small"
    assert Titles(set_titles={"z_a_small": "near"}).of_set("z_a_small") == "near"
    assert Titles().of_experiment("double_swing") == "double swing"
    assert Titles(title="RLC circuit").of_experiment("rlc") == "RLC circuit"


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


def test_methods_without_parameters_get_a_note(tmp_path):
    tables = tables_of(write_metrics(tmp_path, labels=("Mean", "ML only")))
    notes = [
        parameters.parameters(loaded({"mean": write_forecasts(tmp_path)["mean"]})),
        dots.parameter_errors(rows_of(tables), PlotJob(labels=[])),
    ]
    assert [figure.texts[0].get_text() for figure in notes] == ["no method estimates parameters"] * 2
    plotting.save_all({tmp_path / "note.png": notes[0]})
    assert plotting.NOTE.encode() in (tmp_path / "note.png").read_bytes()
    rows = pd.read_csv(tables[0])
    unknown = rows[rows["metric"] == "log_mse_sum"].assign(metric="relative_error", n=0, of=0, mean=np.nan)
    pd.concat([rows, unknown]).to_csv(tables[0], index=False)
    figure = dots.parameter_errors(rows_of(tables), PlotJob(labels=[]))
    assert figure.texts[0].get_text() == "the true parameters are not known"


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


def test_bad_input(tmp_path):
    tables, paths = tables_of(write_metrics(tmp_path / "m")), write_forecasts(tmp_path / "f")
    with pytest.raises(InputError, match=r"suffix '\.svg'"):
        plotting.save_all({tmp_path / "x.svg": dots.log_mse(rows_of(tables), PlotJob(labels=[]))})
    other = pd.read_csv(tables[0]).query("set == 'test'").assign(set="held_out")
    other.to_csv(tmp_path / "other.csv", index=False)
    with pytest.raises(InputError, match="no log_mse_sum on train, validation, iid, test"):
        dots.log_mse(rows_of([tmp_path / "other.csv"]), PlotJob(labels=[]))
    with pytest.raises(InputError, match="no seed 9; it has 0, 1"):
        traces.forecasts(loaded(paths), view=View(seed=9))
    with pytest.raises(InputError, match="no set 'held_out'"):
        traces.forecasts(loaded(paths), view=View(set="held_out"))
    with pytest.raises(InputError, match="no sample 5"):
        traces.forecasts(loaded(paths), view=View(samples=[5]))
    with pytest.raises(InputError, match="other samples"):
        traces.forecasts(loaded(paths | {"other": write_forecasts(tmp_path / "g", count=50)["hybrid"]}))
    (tmp_path / "torn.npz").write_bytes(paths["mean"].read_bytes()[:500])
    with pytest.raises(InputError, match="not a forecast file"):
        Forecasts.load(tmp_path / "torn.npz")
    np.savez(tmp_path / "short.npz", t=np.arange(3))
    with pytest.raises(InputError, match="no array 'observed'"):
        Forecasts.load(tmp_path / "short.npz")
    with pytest.raises(InputError, match="none of them has the metrics"):
        traces.curves(map(read_log, write_logs(tmp_path / "l", steps=0)))
    with pytest.raises(InputError, match="forecasts: no file"):
        traces.forecasts({})


def test_where_nothing_is_trained_the_curves_say_so():
    assert traces.curves([]).texts[0].get_text() == "no method is trained by gradient steps"


def test_a_seed_that_could_not_be_trained_is_not_drawn(tmp_path):
    paths = write_forecasts(tmp_path, labels=("Hybrid",), seeds=(0, 1))
    arrays = dict(np.load(paths["hybrid"]))
    arrays["test_z_e_hat"][0] = arrays["validation_z_e_hat"][0] = 50
    np.savez(paths["hybrid"], **arrays, failed=[0])
    figure = parameters.parameters(loaded(paths))
    assert not figure.axes[0].texts, "nothing is outside"
    figure = traces.forecasts(loaded(paths))
    line = figure.axes[0].lines[-1].get_ydata()
    np.testing.assert_array_equal(line, arrays["test_prediction"][1, 0, :, 0])
    assert figure.get_suptitle().endswith("seed 1")


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


def test_a_figure_has_no_date_and_the_resolution_asked_for(tmp_path):
    figure = plotting.new_figure(1.0, 2.0)
    plotting.save(figure, tmp_path / "a", dpi=50)
    assert imread(tmp_path / "a.png").shape[:2] == (50, 100)
    assert (
        b"CreationDate" not in (tmp_path / "a.pdf").read_bytes()
        and b"Software" not in (tmp_path / "a.png").read_bytes()
    )


def test_words_keep_to_the_width_that_they_have():
    lines = plotting.wrap_words("APHYNITY (diffusion alone), the other way round", 1.1).splitlines()
    assert len(lines) > 2 and max(map(len, lines)) <= 17
    assert plotting.wrap_words("APHYNITY", 0.3) == "APHYNITY", "a word stays whole"

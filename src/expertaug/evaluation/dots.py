"""Dots: a row for each version of a method, a mark for each set at the mean over seeds; of one experiment or of all."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from expertaug import plotting
from expertaug.errors import InputError
from expertaug.evaluation.metrics import RELATIVE_ERROR, RELATIVE_ERROR_OF, log_mse_of, metric_of
from expertaug.evaluation.products import OVERVIEWS
from expertaug.evaluation.settings import OverviewExperiment, OverviewJob, PlotJob, Reading, Titles
from expertaug.evaluation.summary import TabledMean, drawn_sets, in_domain, labels_of, order_sets, read_long
from expertaug.rows import group_by
from expertaug.versions import SHOWN_SETS, base, choose_paired, order_versions

ROW, LABELS = 0.165, 1.6  # inches: height of a row, width of the labels beside them
# Sets of the training's domain are hollow; those beside the three of each experiment look like the test set.
LOOKS = {"train": ("|", "none"), "validation": ("o", "white"), "iid": ("s", "white"), "test": ("D", "own")}
APART = 0.17  # of two sets of one row, in rows
LOG_MSE_AXIS, ERROR_AXIS = "log-MSE (lower is better)", "relative error [%] (lower is better)"


@dataclass(frozen=True)
class Panel:
    """One panel.

    Attributes:
        title: above it.
        rows: of long tables, of one metric.
        titles: how the sets are printed.
    """

    title: str
    rows: Sequence[TabledMean]
    titles: Titles


def draw_dots(
    panels: Sequence[Panel],
    hues: Mapping[str, int],
    axis_label: str,
    logarithmic: bool = False,
    floor: str | None = None,
) -> Figure:
    """Draw panels, at most three side by side, which share the rows of what any of them shows.

    Arguments:
        hues: of every method of the configuration, in its order.
        axis_label: of the values.
        logarithmic: whether the values, all positive, are on such an axis.
        floor: a version at whose value on the test set a line is drawn.
    """
    rows = [row for panel in panels for row in panel.rows]
    labels = labels_of(rows)
    colours = plotting.colours(order_versions(labels, hues), hues)
    columns = -(-len(panels) // -(-len(panels) // 3))  # as many in each line, but for the last
    beside = [panels[start : start + columns] for start in range(0, len(panels), columns)]
    versions = [order_versions((row.method for panel in line for row in panel.rows), hues) for line in beside]
    heights = [0.75 + ROW * len(methods) for methods in versions]
    with plotting.use_style():
        figure = plotting.new_figure(0.75 + sum(heights), plotting.WIDTH if columns > 1 else 5.2)
        width = (figure.get_figwidth() - LABELS) / columns
        grid = figure.subplots(len(beside), columns, squeeze=False, sharey="row", height_ratios=heights)
        for axes, line, methods in zip(grid, beside, versions, strict=True):
            for axis, panel in zip(axes, line, strict=False):
                _panel(axis, panel, methods, colours, floor)
                axis.set_title(plotting.wrap_words(panel.title, width))
                if logarithmic:
                    plotting.plain_log(axis, "x")
            axes[0].set_ylim(len(methods) - 0.5, -0.5)
            axes[0].set_yticks(range(len(methods)), [plotting.text(labels[m]) for m in methods])
        for axis in grid.flat[len(panels) :]:
            axis.set_axis_off()
        for axis in grid.flat[max(0, len(panels) - columns) : len(panels)]:  # the lowest of each column
            axis.set_xlabel(plotting.wrap_words(axis_label, width))
        sets = order_sets(row.set for row in rows)
        handles = [_mark(name, "0.3", panels[0].titles) for name in sets]
        if floor in labels:
            text = f"{labels[floor]}, {panels[0].titles.of_set(sets[-1])}"
            handles.append(Line2D([], [], color="0.35", linewidth=0.9, linestyle=":", label=text))
        if len(handles) > 1:
            plotting.legend(figure, handles)
    return figure


def _mark(name: str, colour: object, titles: Titles) -> Line2D:
    marker, face = LOOKS.get(name, LOOKS["test"])
    face = colour if face == "own" else face
    look = {"marker": marker, "markersize": 4, "markerfacecolor": face, "markeredgecolor": colour}
    return Line2D([], [], linestyle="", label=titles.of_set(name), **look)


def _panel(axis: Axes, panel: Panel, methods: Sequence[str], colours: plotting.Colours, floor: str | None) -> None:
    sets = order_sets(row.set for row in panel.rows)
    values = group_by(panel.rows, lambda mean: (mean.method, mean.set))
    if floor is not None and (floor, sets[-1]) in values:
        at_floor = float(np.mean([mean.mean for mean in values[floor, sets[-1]]]))
        axis.axvline(at_floor, color="0.35", linewidth=0.9, linestyle=":")
    for row, method in enumerate(methods):
        if row and base(method) != base(methods[row - 1]):
            axis.axhline(row - 0.5, color="0.88", linewidth=0.6, zorder=0)
        for place, name in enumerate(sets):
            if (method, name) not in values:
                continue
            mean = values[method, name][0]
            y = row + (place - (len(sets) - 1) / 2) * APART
            if mean.n == 0:
                at = {"xycoords": ("axes fraction", "data"), "va": "center", "fontsize": 5.5, "color": "0.3"}
                axis.annotate("not finite", (0.01 + 0.14 * place, row), **at)
                continue
            dark = tuple(0.75 * channel for channel in colours[method])
            if math.isfinite(mean.low):
                ends = plotting.whiskers([mean.mean], [mean.low], [mean.high])
                axis.errorbar(mean.mean, y, xerr=ends, color=dark, linewidth=0.9, capsize=1.5, zorder=3)
            mark = _mark(name, dark, panel.titles)
            mark.set_data([mean.mean], [y])
            mark.set_zorder(5)
            axis.add_line(mark)
    axis.autoscale_view(scaley=False)
    axis.tick_params(axis="y", length=0)
    axis.grid(axis="x")


def run_stage(tables: Sequence[Path], output: Path, job: OverviewJob) -> None:
    """Stage: draw the figures that compare experiments, each as .png and .pdf.

    Arguments:
        tables: the long table of every experiment (:mod:`expertaug.evaluation.tabulate`).
        output: folder of the figures.

    Raises:
        InputError: a file is broken.
    """
    figures = overview([row for path in tables for row in read_long(path)], job)
    plotting.save_all({Path(output) / name: figure for name, figure in figures.items()})


def overview(rows: Sequence[TabledMean], job: OverviewJob) -> dict[str, Figure]:
    """Each of :data:`~expertaug.evaluation.products.OVERVIEWS` that has a panel: one for each experiment that shows in
    it, with the methods that have an augmented version, these versions, and opponents.

    Arguments:
        rows: of the long tables of all experiments.
    """
    figures = {}
    for kind in OVERVIEWS:
        experiments = [experiment for experiment in job.experiments if getattr(experiment, kind.shows)]
        if experiments:
            figures[kind.name] = globals()[kind.draw](rows, experiments, dict(job.hues))
    return figures


def log_mse_of_all(
    rows: Sequence[TabledMean], experiments: Sequence[OverviewExperiment], hues: Mapping[str, int]
) -> Figure:
    """The paper's figure log_mse."""
    panels = [
        _panel_of(rows, e, _log_mse(e), note=f" ({e.convention_text.partition(' over')[0]})") for e in experiments
    ]
    return draw_dots(panels, hues, LOG_MSE_AXIS)


def parameter_errors_of_all(
    rows: Sequence[TabledMean], experiments: Sequence[OverviewExperiment], hues: Mapping[str, int]
) -> Figure:
    """The paper's figure param_acc; a note where no experiment's parameters are known."""
    panels = [panel for e in experiments if (panel := _panel_of(rows, e, RELATIVE_ERROR.name)).rows]
    return draw_dots(panels, hues, ERROR_AXIS, True) if panels else plotting.note(_without_errors(rows))


def log_mse_of_shifted(
    rows: Sequence[TabledMean], experiments: Sequence[OverviewExperiment], hues: Mapping[str, int]
) -> Figure:
    """Of each experiment the set out of the expertise that it names."""
    panels = [_panel_of(rows, e, _log_mse(e), sets=[e.shifted]) for e in experiments if e.shifted]
    return draw_dots(panels, hues, LOG_MSE_AXIS)


def _log_mse(reading: Reading) -> str:
    return log_mse_of(reading.convention).name


def _panel_of(
    rows: Sequence[TabledMean], experiment: OverviewExperiment, metric: str, sets: Sequence[str] = (), note: str = ""
) -> Panel:
    """A panel of the methods that have an augmented version, and of these versions, or of all where there is none; and
    of the opponents that never have one.

    Arguments:
        sets: by default the set of the training's domain and the test set.
        note: behind the title.
    """
    part = [row for row in rows if (row.experiment, row.metric) == (experiment.name, metric) and row.of]
    sets = sets or (in_domain(row.set for row in part), "test")
    part = [row for row in part if row.set in sets]
    methods = {*choose_paired(row.method for row in part), *experiment.opponents}
    title = f"{experiment.of_experiment(experiment.name)}{note}"
    return Panel(title, [row for row in part if row.method in methods], experiment)


def log_mse(rows: Sequence[TabledMean], job: PlotJob) -> Figure:
    """The log-MSE of every method on every set: mean over seeds, 95 % interval as error bar.

    Arguments:
        rows: of the long table (:mod:`expertaug.evaluation.tabulate`); those of several experiments become panels.

    Raises:
        InputError: there is no such metric.
    """
    parts = _select(rows, [_log_mse(job)])
    panels = [Panel(job.of_experiment(name), part, job) for (name, _), part in parts.items()]
    return draw_dots(panels, dict(job.hues), LOG_MSE_AXIS, floor=job.floor)


def parameter_errors(rows: Sequence[TabledMean], job: PlotJob) -> Figure:
    """The relative error of the expert parameters in %, one panel per parameter; otherwise like :func:`log_mse`.

    Where no error is known the figure says why.
    """
    evaluated = list(dict.fromkeys(row.metric for row in rows if row.of))
    names = [name for name in evaluated if metric_of(name).family is RELATIVE_ERROR_OF]
    names = names or [name for name in (RELATIVE_ERROR.name,) if name in evaluated]
    if not names:
        return plotting.note(_without_errors(rows))
    panels = []
    for (experiment, metric), part in _select(rows, names).items():
        parameter, name = plotting.symbol(metric_of(metric).of), job.of_experiment(experiment)
        panels.append(Panel(f"{name}: {parameter}" if parameter else name, part, job))
    return draw_dots(panels, dict(job.hues), ERROR_AXIS, logarithmic=True)


def _without_errors(rows: Sequence[TabledMean]) -> str:
    """Why no method's error of the parameters is known."""
    unknown = any(row.metric == RELATIVE_ERROR.name for row in rows)  # a row of no seed
    return "the true parameters are not known" if unknown else "no method estimates parameters"


def _select(rows: Sequence[TabledMean], metrics: Sequence[str]) -> dict[tuple[str, str], list[TabledMean]]:
    """Means of each experiment and of these metrics on the sets that figures show of the experiment."""
    chosen = [row for row in rows if row.metric in metrics and row.set in SHOWN_SETS and row.of]
    if not chosen:
        evaluated = ", ".join(dict.fromkeys(row.metric for row in rows))
        what = f"no {' or '.join(metrics)} on {', '.join(SHOWN_SETS)}"
        raise InputError("metrics", what, f"the files hold {evaluated}")
    drawn = []
    for part in group_by(chosen, lambda row: row.experiment).values():
        sets = drawn_sets(row.set for row in part)
        drawn += [row for row in part if row.set in sets]
    return group_by(drawn, lambda row: (row.experiment, row.metric))

"""Dots: a row for each version of a method, a mark for each set at the mean over seeds; of one experiment or of all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from expertaug import plotting
from expertaug.errors import InputError
from expertaug.evaluation.metrics import RELATIVE_ERROR, RELATIVE_ERROR_OF, log_mse_of, metric_of
from expertaug.evaluation.settings import OverviewExperiment, OverviewJob, PlotJob, Reading, Titles
from expertaug.evaluation.summary import drawn_sets, in_domain, labels_of, order_sets, read_metrics, summarise
from expertaug.versions import SHOWN_SETS, base, ordered, paired

ROW, LABELS = 0.165, 1.6  # inches: height of a row, width of the labels beside them
# Sets of the training's domain are hollow; those beside the three of each experiment look like the test set.
LOOKS = {"train": ("|", "none"), "validation": ("o", "white"), "iid": ("s", "white"), "test": ("D", "own")}
APART = 0.17  # of two sets of one row, in rows


@dataclass(frozen=True)
class Panel:
    """One panel.

    Attributes:
        title: above it.
        table: rows of metrics.csv, of one metric.
        titles: how the sets are printed.
    """

    title: str
    table: pd.DataFrame
    titles: Titles


def draw_dots(
    panels: Sequence[Panel],
    all_methods: Sequence[str],
    axis_label: str,
    title: str,
    logarithmic: bool = False,
    floor: str | None = None,
) -> Figure:
    """Draw panels, at most three side by side, which share the rows of what any of them shows.

    Arguments:
        all_methods: of the configuration, in order.
        axis_label: of the values.
        title: above all panels; presets and number of seeds are added.
        logarithmic: whether the values, all positive, are on such an axis.
        floor: a version at whose value on the test set a line is drawn.
    """
    everything = pd.concat([panel.table for panel in panels])
    labels = labels_of(everything)
    colours = plotting.colours(ordered(everything["method"], all_methods), all_methods)
    columns = -(-len(panels) // -(-len(panels) // 3))  # as many in each line, but for the last
    beside = [panels[start : start + columns] for start in range(0, len(panels), columns)]
    versions = [ordered(pd.concat([panel.table for panel in row])["method"], all_methods) for row in beside]
    heights = [0.75 + ROW * len(methods) for methods in versions]
    with plotting.styled():
        figure = plotting.new_figure(0.75 + sum(heights), plotting.WIDTH if columns > 1 else 5.2)
        grid = figure.subplots(len(beside), columns, squeeze=False, sharey="row", height_ratios=heights)
        for axes, row, methods in zip(grid, beside, versions, strict=True):
            for axis, panel in zip(axes, row, strict=False):
                _panel(axis, panel, methods, colours, floor)
                axis.set_title(plotting.wrapped(panel.title, (figure.get_figwidth() - LABELS) / columns))
                if logarithmic:
                    plotting.plain_log(axis, "x")
            axes[0].set_ylim(len(methods) - 0.5, -0.5)
            axes[0].set_yticks(range(len(methods)), [plotting.text(labels[m]) for m in methods])
        for axis in grid.flat[len(panels) :]:
            axis.set_axis_off()
        lowest = [axis for axis in grid[-1] if axis.axison]
        lowest[len(lowest) // 2].set_xlabel(axis_label)  # in the axes' room: below it comes the legend
        presets = ", ".join(dict.fromkeys(everything["preset"]))
        seeds = everything.groupby(["experiment", "method"])["seed"].nunique()
        number = "1 seed" if set(seeds) == {1} else f"{seeds.min()} seeds" if seeds.nunique() == 1 else "all seeds"
        number = number if number == "1 seed" else f"mean ± std over {number}"
        plotting.heading(figure, f"{title}{'; ' if columns > 1 else chr(10)}{number}; preset {presets}")
        sets = order_sets(everything["set"])
        handles = [_mark(name, "0.3", panels[0].titles) for name in sets]
        if floor in set(everything["method"]):
            text = f"{labels[floor]}, {panels[0].titles.of_set(sets[-1])}"
            handles.append(Line2D([], [], color="0.35", linewidth=0.9, linestyle=":", label=text))
        plotting.legend(figure, handles)
    return figure


def _mark(name: str, colour: object, titles: Titles) -> Line2D:
    marker, face = LOOKS.get(name, LOOKS["test"])
    face = colour if face == "own" else face
    look = {"marker": marker, "markersize": 4, "markerfacecolor": face, "markeredgecolor": colour}
    return Line2D([], [], linestyle="", label=titles.of_set(name), **look)


def _panel(axis: Axes, panel: Panel, methods: Sequence[str], colours: Mapping, floor: str | None) -> None:
    part, sets = panel.table, order_sets(panel.table["set"])
    values = summarise(part).set_index(["method", "set"])
    if floor is not None and (floor, sets[-1]) in values.index:
        axis.axvline(float(np.mean(values.loc[(floor, sets[-1]), "mean"])), color="0.35", linewidth=0.9, linestyle=":")
    for row, method in enumerate(methods):
        if row and base(method) != base(methods[row - 1]):
            axis.axhline(row - 0.5, color="0.88", linewidth=0.6, zorder=0)
        for place, name in enumerate(sets):
            if (method, name) not in values.index:
                continue
            cell = values.loc[(method, name)]
            cell = cell.iloc[0] if isinstance(cell, pd.DataFrame) else cell
            y = row + (place - (len(sets) - 1) / 2) * APART
            if cell["n"] == 0:
                at = {"xycoords": ("axes fraction", "data"), "va": "center", "fontsize": 5.5, "color": "0.3"}
                axis.annotate("not finite", (0.01 + 0.14 * place, row), **at)
                continue
            dark = tuple(0.75 * channel for channel in colours[method])
            if cell["n"] > 1:
                axis.errorbar(cell["mean"], y, xerr=cell["std"], color=dark, linewidth=0.9, capsize=1.5, zorder=3)
            mark = _mark(name, dark, panel.titles)
            mark.set_data([cell["mean"]], [y])
            mark.set_zorder(5)
            axis.add_line(mark)
    axis.autoscale_view(scaley=False)
    axis.tick_params(axis="y", length=0)
    axis.grid(axis="x")


def overview(metrics: Sequence[Path], output: Path, job: OverviewJob) -> None:
    """Draw log_mse (paper's figure log_mse), parameter_errors (param_acc) and, where an experiment asks for it,
    za_shifted, each as .png and .pdf: a panel for each experiment, methods with their augmented versions and opponents.

    Arguments:
        metrics: metrics.csv of every experiment, method and group of seeds.
        output: folder of the figures.

    Raises:
        InputError: a file is broken.
    """
    table, folder = read_metrics(metrics), Path(output)
    shown = [one for one in job.experiments if one.shown]

    def save(name: str, panels: Sequence[Panel], axis: str, note: str, logarithmic: bool = False) -> None:
        with plotting.styled():
            plotting.save(draw_dots(panels, job.all_methods, axis, note, logarithmic), folder / name)

    if shown:
        panels = []
        for one in shown:
            how = one.convention_text.partition(" over")[0]
            panels.append(Panel(f"{one.of_experiment(one.name)} ({how})", _shown(table, one, _log_mse(one)), one))
        save("log_mse", panels, "log-MSE", "log-MSE, squared error summed or averaged over the observed dimensions")
        panels = [Panel(one.of_experiment(one.name), _shown(table, one, RELATIVE_ERROR.name), one) for one in shown]
        panels = [panel for panel in panels if len(panel.table)]
        if panels:
            note = "mean relative error of the expert parameters"
            save("parameter_errors", panels, "relative error [%]", note, True)
        else:
            plotting.save_note("no method estimates parameters", folder / "parameter_errors")
    panels = [
        Panel(one.of_experiment(one.name), _shown(table, one, _log_mse(one), [one.shifted]), one)
        for one in job.experiments
        if one.shifted
    ]
    if panels:
        save("za_shifted", panels, "log-MSE", "log-MSE where the interaction's parameters are shifted as well")


def _log_mse(reading: Reading) -> str:
    return log_mse_of(reading.convention).name


def _shown(table: pd.DataFrame, one: OverviewExperiment, metric: str, sets: Sequence[str] = ()) -> pd.DataFrame:
    """Rows of the methods that have an augmented version, and of these versions, or of all where there is none; and of
    the opponents that never have one.

    Arguments:
        sets: by default the set of the training's domain and the test set.
    """
    part = table[(table["experiment"] == one.name) & (table["metric"] == metric)]
    part = part[part["set"].isin(sets or (in_domain(part["set"]), "test"))]
    return part[part["method"].isin([*paired(part["method"]), *one.opponents])]


def log_mse(metrics: Sequence[Path], outputs: Path | Sequence[Path], job: PlotJob) -> None:
    """Draw the log-MSE of every method on every set: mean over seeds, standard deviation as error bar.

    Arguments:
        metrics: metrics.csv of every method and group of seeds; several experiments become panels.
        outputs: .png or .pdf files, or one path without suffix for both.

    Raises:
        InputError: a file is broken or has no such metric.
    """
    table = _select(read_metrics(metrics), [_log_mse(job)])
    panels = [Panel(job.of_experiment(name), part, job) for name, part in table.groupby("experiment", sort=False)]
    title = f"log-MSE, squared error {job.convention_text}"
    with plotting.styled():
        figure = draw_dots(panels, job.all_methods, "log-MSE (lower is better)", title, floor=job.floor)
        plotting.save(figure, outputs)


def parameter_errors(metrics: Sequence[Path], outputs: Path | Sequence[Path], job: PlotJob) -> None:
    """Draw the relative error of the expert parameters in %, one panel per parameter; otherwise like :func:`log_mse`.

    Where no method estimates parameters the figure says so.
    """
    table = read_metrics(metrics)
    known = list(dict.fromkeys(table["metric"]))
    names = [name for name in known if metric_of(name).family is RELATIVE_ERROR_OF]
    names = names or [name for name in (RELATIVE_ERROR.name,) if name in known]
    if not names:
        plotting.save_note("no method estimates parameters", outputs)
        return
    panels = []
    for (experiment, metric), part in _select(table, names).groupby(["experiment", "metric"], sort=False):
        parameter, name = plotting.symbol(metric_of(metric).of), job.of_experiment(experiment)
        panels.append(Panel(f"{name}: {parameter}" if parameter else name, part, job))
    title, axis = "relative error of the expert parameters", "relative error [%] (lower is better)"
    with plotting.styled():
        plotting.save(draw_dots(panels, job.all_methods, axis, title, logarithmic=True), outputs)


def _select(table: pd.DataFrame, metrics: Sequence[str]) -> pd.DataFrame:
    """Rows of these metrics on the sets that figures show of each experiment."""
    found = table[table["metric"].isin(metrics) & table["set"].isin(SHOWN_SETS)]
    if not len(found):
        known = ", ".join(dict.fromkeys(table["metric"]))
        raise InputError("metrics", f"no {' or '.join(metrics)} on {', '.join(SHOWN_SETS)}", f"the files hold {known}")
    parts = [part for _, part in found.groupby("experiment", sort=False)]
    return pd.concat([part[part["set"].isin(drawn_sets(part["set"]))] for part in parts])

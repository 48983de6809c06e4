"""The stage data-curves: errors of several experiments against what their data differ in, number or noise."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from expertaug import plotting
from expertaug.errors import InputError
from expertaug.evaluation.metrics import RELATIVE_ERROR, Metric, log_mse_of
from expertaug.evaluation.settings import DataCurvesJob
from expertaug.evaluation.summary import TabledMean, cell_of, in_domain, read_long
from expertaug.evaluation.table import Study, Table, plain
from expertaug.hues import FLOOR
from expertaug.rows import frame, group_by
from expertaug.versions import LINES, Version

AXES = {"samples": "training trajectories", "noise": "standard deviation of the noise"}
UNITS = {"samples": "", "noise": " [the component's unit]"}
CAPTION = (
    "Mean over seeds with its 95 % interval, or ± standard deviation over seeds where samples' errors are not kept. "
    "log-MSE: natural logarithm of the mean squared error of the forecast; lower is better."
)


@dataclass(frozen=True, kw_only=True)
class Point:
    """A metric of a version at a point of a curve.

    Attributes:
        along: what the curve's experiments differ in, a key of :data:`AXES`.
        value: of that.
        mean, low, high: over seeds, and the ends of its 95 % interval, NaN where there is none.
        n, of: number of seeds with a finite value, and of all.
    """

    along: str
    value: float
    experiment: str
    method: str
    label: str
    set: str
    metric: str
    mean: float
    low: float
    high: float
    n: int
    of: int


def run_stage(tables: Sequence[Path], outputs: Sequence[Path], job: DataCurvesJob) -> None:
    """Stage: write the table of the curves and draw them.

    Arguments:
        tables: the long table of every experiment that is a point (:mod:`expertaug.evaluation.tabulate`).
        outputs: any of .csv, .md, .tex, .png and .pdf.

    Raises:
        InputError: a table is missing or broken, a point has none, or an output's suffix is unknown.
    """
    data_curves((mean for path in tables for mean in read_long(path)), job).save(outputs)


def data_curves(long: Iterable[TabledMean], job: DataCurvesJob) -> Study:
    """The table and the figure of the curves.

    Arguments:
        long: rows of the long tables of all experiments that are points.

    Raises:
        InputError: a point has none.
    """
    means = group_by(long, lambda mean: mean.experiment)
    if missing := [name for _, points in job.axes for _, name in points if name not in means]:
        raise InputError(missing[0], "no table of this experiment", "give the long table of every point")
    sets = [in_domain(mean.set for own in means.values() for mean in own), "test"]
    metrics = [log_mse_of(job.convention), RELATIVE_ERROR]
    points = [
        _point(along, value, mean)
        for along, experiments in job.axes
        for value, name in experiments
        for mean in means[name]
        if mean.method in job.label_of and mean.set in sets and mean.metric in {metric.name for metric in metrics}
    ]
    title = f"{job.of_experiment(job.experiment)}: how errors depend on the data"
    curves = [_table(along, job, means, sets, metrics) for along, _ in job.axes]
    label = f"{job.experiment}-data-curves".replace("_", "-")
    first = replace(curves[0], title=title, caption=CAPTION, label=label)
    return Study(frame(Point, points), [first, *curves[1:]], lambda: _draw(points, sets, metrics[0], job, title))


def _point(along: str, value: float, mean: TabledMean) -> Point:
    names = ("experiment", "method", "label", "set", "metric", "mean", "low", "high", "n", "of")
    return Point(along=along, value=value, **{name: getattr(mean, name) for name in names})


def _table(
    along: str,
    job: DataCurvesJob,
    means: dict[str, list[TabledMean]],
    sets: Sequence[str],
    metrics: Sequence[Metric],
) -> Table:
    """A row for each metric, set and version, a column for each point."""
    experiments = dict(job.axes)[along]
    means_by_key = {(m.experiment, m.method, m.metric, m.set): m for _, name in experiments for m in means[name]}
    parts = []
    for metric in metrics:
        for name in sets:
            rows = []
            for version, label in job.labels:
                keys = [(experiment, version, metric.name, name) for _, experiment in experiments]
                cells = [cell_of(means_by_key, key, metric.name) for key in keys]
                rows += [[label, *cells]] if any(cell.of for cell in cells) else []
            parts.append((f"{job.of_set(name)}: {metric.heading()}", rows))
    return Table([AXES[along], *(plain(value) for value, _ in experiments)], parts)


def _draw(points: Sequence[Point], sets: Sequence[str], metric: Metric, job: DataCurvesJob, title: str) -> Figure:
    """A row of panels for what differs, a column for each set, a line for each version; the floor is dotted."""
    named = [version for version, _ in job.labels if any(point.method == version for point in points)]
    floor = [v for v in named if v == job.floor]
    shown = [v for v in named if v not in floor and not Version.parse(v).is_control][: LINES - len(floor)]
    drawn = [*shown, *floor]
    colours = plotting.colours(drawn, dict(job.hues) | dict.fromkeys(floor, FLOOR))
    with plotting.use_style():
        figure = plotting.new_figure(0.6 + 2.3 * len(job.axes))
        axes = figure.subplots(len(job.axes), len(sets), squeeze=False, sharey="row")
        of_metric = [point for point in points if point.metric == metric.name]
        lines = group_by(of_metric, lambda point: (point.along, point.set, point.method))
        for row, (along, experiments) in zip(axes, job.axes, strict=True):
            values = [value for value, _ in experiments]
            for axis, name in zip(row, sets, strict=True):
                for place, version in enumerate(drawn):
                    own = lines.get((along, name, version), [])
                    aside = 0.0 if version in floor else 0.16 * (place / len(shown) - 0.5)
                    _line(axis, values, own, plotting.look(version, colours), aside)
                axis.set_xticks(range(len(values)), [f"{value:g}" for value in values])
                axis.set_xlabel(AXES[along] + UNITS[along])
                axis.grid(axis="y")
            row[0].set_ylabel("log-MSE (lower is better)")
        for axis, name in zip(axes[0], sets, strict=True):
            axis.set_title(plotting.text(job.of_set(name)))
        plotting.heading(figure, title)
        each = [zip(*axis.get_legend_handles_labels(), strict=True) for axis in axes.flat]
        handles = {text: handle for panel in each for handle, text in panel}  # a panel may lack a version
        for text, handle in handles.items():
            handle.set_label(plotting.text(text))
        plotting.legend(figure, list(handles.values()))
    return figure


def _line(axis: Axes, values: Sequence[float], points: Sequence[Point], look: plotting.Look, aside: float) -> None:
    """Means with their intervals; what has no finite value is left out."""
    good = [point for point in points if np.isfinite(point.mean)]
    if not good:
        return
    means = [point.mean for point in good]
    ends = plotting.whiskers(means, [point.low for point in good], [point.high for point in good])
    places = [values.index(point.value) + aside for point in good]
    bars = {"elinewidth": 0.8, "capsize": 1.6}
    axis.errorbar(places, means, ends, label=good[0].label, **look, **bars)

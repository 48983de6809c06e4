"""The stage study: table and figure of one of an experiment's further questions."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from expertaug import plotting
from expertaug.errors import InputError
from expertaug.evaluation import products
from expertaug.evaluation.dots import LOOKS
from expertaug.evaluation.forecasts import Forecasts
from expertaug.evaluation.metrics import DIVERGED, RELATIVE_ERROR, log_mse_of, metric_of
from expertaug.evaluation.samples import Samples
from expertaug.evaluation.settings import Ranges, StudyJob
from expertaug.evaluation.summary import (
    TabledMean,
    any_of,
    cell_of,
    in_domain,
    read_metrics,
    shown_metrics,
    tabled_metrics,
    with_intervals,
)
from expertaug.evaluation.table import Study as Made
from expertaug.evaluation.table import Table
from expertaug.rows import frame
from expertaug.tracking.metrics_csv import MetricRow
from expertaug.versions import LINES, base, choose_compared

DURING_TRAINING_SETS = ("train", "validation", "test")
# Of the model as trained, then of each length of fine-tuning.
ALONG_LINES = tuple(
    {"color": plotting.HUES[hue], "linestyle": dash, "marker": marker, "markersize": size}
    for hue, dash, marker, size in (
        (0, plotting.DASHED, "o", 3),
        (5, "-", "s", 3),
        (6, (0, (1, 1.4)), "*", 6),
        (7, "-.", "^", 4),
        (2, (0, (6, 1.5)), "v", 4),
    )
)
Printed = tuple[list[str], list[list[str]], int]  # header, rows of text, number of columns that are text


def ranges_text(ranges: Mapping[str, Sequence[float]]) -> str:
    """Ranges of parameters as plain text; None: they were found."""
    if ranges is None:
        return "its own ranges"
    return ", ".join(f"{name} ∈ [{low:g}, {high:g}]" for name, (low, high) in ranges.items()).replace("-", "−")


def width_sets(summary: Sequence[TabledMean]) -> tuple[str, str]:
    """Sets that the study of p⁺'s width shows."""
    return in_domain(mean.set for mean in summary), "test"


def by_width(priors: Mapping[str, Ranges | None]) -> list[str]:
    """Names of priors, the one of the smallest volume first; one that found its own ranges last."""

    def volume(name: str) -> float:
        return math.inf if priors[name] is None else math.prod(high - low for low, high in priors[name].values())

    return sorted(priors, key=volume)


def shifts(summary: Sequence[TabledMean], job: StudyJob) -> Figure:
    """The log-MSE against the distance of the shift: a panel for each kind of shift, a line for each method."""
    return _by_set(summary, job, job.options.panels, "distance of the shift")


def horizons(summary: Sequence[TabledMean], job: StudyJob) -> Figure:
    """The log-MSE against the end of the forecast: a panel for each split, a line for each method."""
    panels = [(job.of_set(split), names) for split, names in job.options.panels]
    return _by_set(summary, job, panels, "end of the forecast")


def _by_set(
    summary: Sequence[TabledMean], job: StudyJob, panels: Sequence[tuple[str, Sequence[str]]], xlabel: str
) -> Figure:
    labels = {version: job.label_of[version] for version in choose_compared(list(job.label_of), job.classical)}
    colours = plotting.colours(list(labels), dict(job.hues))
    metric, means = log_mse_of(job.convention).name, by_place(summary)
    with plotting.use_style():
        figure = plotting.new_figure(3.0, plotting.WIDTH if len(panels) > 1 else 4.6)
        grid = figure.subplots(1, len(panels), squeeze=False, sharey=True)[0]
        for axis, (title, names) in zip(grid, panels, strict=True):
            for place, variant in enumerate(labels):
                x = np.arange(len(names)) + _dodge(place, len(labels))
                each = [means.get((metric, name, variant)) for name in names]
                _line(axis, x, each, plotting.look(variant, colours))
            places = zip(job.options.distances, names, strict=True)
            axis.set_xticks(range(len(names)), [_tick(distance, name, job) for distance, name in places])
            axis.set_xlim(-0.4, len(names) - 0.6)
            axis.set(title=plotting.text(title), xlabel=xlabel)
            axis.grid(axis="y")
        grid[0].set_ylabel("log-MSE (lower is better)")
        handles = [Line2D([], [], **plotting.look(v, colours), label=label) for v, label in labels.items()]
        plotting.legend(figure, handles)
        plotting.heading(figure, job.of_experiment(summary[0].experiment))
    return figure


def widths(summary: Sequence[TabledMean], job: StudyJob) -> Figure:
    """Log-MSE and parameters' error against the prior, the narrowest first: a line for each method and set."""
    methods = list(dict.fromkeys(map(base, job.label_of)))[: LINES // len(width_sets(summary))]
    ranges = job.priors[methods[0]]
    priors = by_width(ranges)
    colours = plotting.colours([f"{method}+" for method in methods], dict(job.hues))
    means = by_place(summary)
    metrics, sets = shown_metrics(summary, job.convention), width_sets(summary)
    with plotting.use_style():
        figure = plotting.new_figure(3.0, plotting.WIDTH if len(metrics) > 1 else 4.6)
        grid = figure.subplots(1, len(metrics), squeeze=False)[0]
        for axis, metric in zip(grid, metrics, strict=True):
            for place, method in enumerate(methods):
                for name, line in zip(sets, (plotting.DASHED, "-"), strict=True):
                    variants = [method, *(f"{method}+{prior}" for prior in priors)]
                    each = [means.get((metric, name, variant)) for variant in variants]
                    x = np.arange(len(variants)) + _dodge(place, len(methods))
                    _line(axis, x, each, _of_set(name, line, colours[f"{method}+"]))
            alike = {name: all(job.priors[m][name] == ranges[name] for m in methods) for name in priors}
            extents = [_extent(ranges, name, job.units) if alike[name] else "" for name in priors]
            ticks = ["none", *(f"{name or 'default'}\n{extent}" for name, extent in zip(priors, extents, strict=True))]
            axis.set_xticks(range(len(ticks)), ticks)
            axis.set_xlabel("augmentation prior p⁺")
            what = "relative error [%]" if metric == RELATIVE_ERROR.name else metric_of(metric).heading()
            axis.set_ylabel(f"{what} (lower is better)")
            axis.grid(axis="y")
            if metric == RELATIVE_ERROR.name:
                plotting.plain_log(axis)
        names = {f"{method}+": job.label_of[method] for method in methods}
        handles = [Line2D([], [], color=colours[m], linewidth=3, label=label) for m, label in names.items()]
        for name, line in zip(sets, (plotting.DASHED, "-"), strict=True):
            handles.append(Line2D([], [], label=job.of_set(name), **_of_set(name, line, "0.3")))
        plotting.legend(figure, handles)
        plotting.heading(figure, job.of_experiment(summary[0].experiment))
    return figure


def _of_set(name: str, line: object, colour: object) -> dict:
    """A line of a set, with its marker as in the figures of dots."""
    marker, face = LOOKS[name]
    face = colour if face == "own" else face
    return {"color": colour, "linestyle": line, "marker": marker, "markersize": 3.5, "markerfacecolor": face}


def during_training(summary: Sequence[TabledMean], job: StudyJob) -> Figure:
    """The log-MSE along the training: a panel for each set, a line for each length of fine-tuning."""
    metric, means = log_mse_of(job.convention).name, by_passes(summary)
    epochs = sorted({epoch for _, _, epoch, _ in means})
    lengths = sorted({length for _, _, _, length in means})
    lines = {length: ALONG_LINES[k % len(ALONG_LINES)] for k, length in enumerate(lengths)}
    with plotting.use_style():
        figure = plotting.new_figure(3.0)
        panels = figure.subplots(1, len(DURING_TRAINING_SETS), sharey=True)
        for axis, name in zip(panels, DURING_TRAINING_SETS, strict=True):
            for place, (length, look) in enumerate(lines.items()):
                each = [means.get((metric, name, epoch, length)) for epoch in epochs]
                _line(axis, np.array(epochs) * (1 + 0.3 * _dodge(place, len(lines))), each, look)
            axis.set_xscale("log")
            axis.set_xticks(epochs, map(str, epochs))
            axis.minorticks_off()
            axis.set(title=job.of_set(name), xlabel="passes of the training")
            axis.grid(axis="y")
        panels[0].set_ylabel("log-MSE (lower is better)")
        handles = []
        for length, look in lines.items():
            text = f"fine-tuned, {length} pass{'es' if length > 1 else ''}" if length else "as trained"
            handles.append(Line2D([], [], **look, label=text))
        plotting.legend(figure, handles)
        plotting.heading(figure, job.of_experiment(summary[0].experiment))
    return figure


def _line(axis: Axes, x: np.ndarray, means: Sequence[TabledMean | None], look: plotting.Look) -> None:
    """Means with their 95 % intervals as bars; what has no finite value is left out."""
    good = [(place, mean) for place, mean in zip(x, means, strict=True) if mean is not None and mean.n > 0]
    levels = [mean.mean for _, mean in good]
    spread = plotting.whiskers(levels, [mean.low for _, mean in good], [mean.high for _, mean in good])
    bars = {"elinewidth": 0.8, "capsize": 1.6}
    places = [place for place, _ in good]
    axis.errorbar(places, levels, spread, **look, **bars)


def _dodge(place: int, count: int) -> float:
    """Lines lie a little beside each other, so that their bars can be told apart."""
    return 0.16 * (place / (count - 1) - 0.5) if count > 1 else 0.0


def _tick(distance: str, name: str, job: StudyJob) -> str:
    """The distance, and below it the range of the interaction's parameters."""
    ranges = z_a_of(job, name)
    each = [f"{plotting.symbol(p)}: {low:g} to\n{high:g} {job.units.get(p, '')}" for p, (low, high) in ranges.items()]
    return "\n".join([distance, *map(str.rstrip, each)])


def _extent(priors: Mapping[str, Ranges | None], name: str, units: Mapping[str, str]) -> str:
    """The range of a single parameter; of several the volume as a multiple of the experiment's own prior."""
    if priors[name] is None or priors[""] is None:
        return "its own"
    if len(priors[name]) == 1:
        parameter, (low, high) = next(iter(priors[name].items()))
        return f"{low:g} to {high:g}\n{units.get(parameter, '')}".rstrip()
    own, this = (math.prod(high - low for low, high in priors[key].values()) for key in ("", name))
    return f"volume × {this / own:.2g}" if own else ""


@dataclass(frozen=True)
class Study:
    """One kind of study.

    Attributes:
        title: of the table.
        along: whether it is along a training, and its metrics have columns that say where.
        rows: summary and job → header, rows of text, number of columns that are text.
        draw: summary and job → the figure.
    """

    title: str
    along: bool
    rows: Callable[[Sequence[TabledMean], StudyJob], Printed]
    draw: Callable[[Sequence[TabledMean], StudyJob], Figure]


def run_stage(metrics: Sequence[Path], outputs: Sequence[Path], job: StudyJob, forecasts: Sequence[Path] = ()) -> None:
    """Stage: write the table and draw the figure of a study.

    Arguments:
        metrics: metrics.csv (of the study along training: during_training.csv) of all variants and groups of seeds.
        outputs: any of .csv (mean, std, n, ends of the interval in full precision), .md, .tex, .png and .pdf.
        forecasts: forecasts.npz of the same runs, from which the intervals come; along a training those of the seeds
            alone are shown.

    Raises:
        InputError: a file is broken or lacks what the study compares, or an output's suffix is unknown.
    """
    rows = read_metrics(metrics, KINDS[job.study].along)
    study(rows, job, map(Forecasts.load, forecasts), metrics[0]).save(outputs)


def study(
    rows: Sequence[MetricRow], job: StudyJob, forecasts: Iterable[Forecasts] = (), where: object = "metrics"
) -> Made:
    """The table and the figure of a study.

    Arguments:
        rows: the metrics of all variants and seeds; of the study along training with its passes.
        forecasts: of the same runs, from which the intervals come; along a training those of the seeds alone are shown.
        where: what messages call the metrics.

    Raises:
        InputError: a set that the study compares has no metrics.
    """
    kind, labels = KINDS[job.study], job.label_of
    samples = None if kind.along else Samples(forecasts)
    summary = with_intervals([row for row in rows if row.method in labels], samples)
    _require(summary, where, job)
    name = summary[0].experiment
    caption = _caption(summary, job) + (f" {DIVERGED.note}" if any_of(DIVERGED, summary) else "")
    title, label = f"{name}: {kind.title}", f"{name}-{job.study}".replace("_", "-")
    head, printed, names = kind.rows(summary, job)
    table = Table(head, [("", printed)], names, (), title, caption, label)
    return Made(frame(TabledMean, summary), [table], lambda: kind.draw(summary, job))


def z_a_of(job: StudyJob, name: str) -> Mapping[str, Sequence[float]]:
    """Ranges of the interaction's parameters of a simulated set; none where it is measured."""
    return job.sets[name].z_a if name in job.sets else {}


def by_place(summary: Sequence[TabledMean]) -> dict[tuple[str, str, str], TabledMean]:
    """Means by metric, set and method."""
    return {(mean.metric, mean.set, mean.method): mean for mean in summary}


def by_passes(summary: Sequence[TabledMean]) -> dict[tuple[str, str, int, int], TabledMean]:
    """Means by metric, set and numbers of passes, of training and of fine-tuning."""
    return {(mean.metric, mean.set, mean.epoch or 0, mean.finetune_epochs or 0): mean for mean in summary}


def _require(summary: Sequence[TabledMean], where: object, job: StudyJob) -> None:
    panels = job.options.panels
    evaluated = {mean.set for mean in summary}
    for name in [name for _, names in panels for name in names]:
        if name not in evaluated:
            raise InputError(where, f"no metrics of the set {name!r}", "evaluate again")


def _caption(summary: Sequence[TabledMean], job: StudyJob) -> str:
    seeds, presets = max(len(mean.seeds) for mean in summary), ", ".join(dict.fromkeys(mean.preset for mean in summary))
    start = job.from_s
    window = "the forecast window (t1, t2]" if start is None else f"times from {start:g} s on"
    return (
        f"Preset: {presets}. Mean over {seeds} seed{'s' if seeds > 1 else ''}, {_spread(summary, job)}. log-MSE: "
        f"natural logarithm of the mean squared error over {window}, {job.convention_text}; lower is better."
    )


def _spread(summary: Sequence[TabledMean], job: StudyJob) -> str:
    """What stands beside a mean."""
    if all(math.isnan(mean.low) for mean in summary):
        return "± their standard deviation (n − 1)"
    of = (
        "that their spread gives"
        if KINDS[job.study].along
        else "for which samples and, of several, seeds are resampled"
    )
    return f"with the ends of its 95 % interval, {of}, or else ± their standard deviation (n − 1)"


def shift_rows(summary: Sequence[TabledMean], job: StudyJob) -> Printed:
    """A row for each metric, panel and distance, a column for each method."""
    means = by_place(summary)
    rows = []
    for metric in tabled_metrics(summary, job.convention):
        for title, names in job.options.panels:
            for distance, name in zip(job.options.distances, names, strict=True):
                sampled = ranges_text(z_a_of(job, name))
                values = [cell_of(means, (metric, name, v), metric).text() for v in job.label_of]
                rows.append([metric_of(metric).heading(), title, distance, sampled, *values])
    return ["metric", "shifted", "distance", "z_a of the set", *job.label_of.values()], rows, 4


def horizon_rows(summary: Sequence[TabledMean], job: StudyJob) -> Printed:
    """A row for each metric, split and end of the forecast, a column for each method."""
    means = by_place(summary)
    rows = []
    for metric in tabled_metrics(summary, job.convention):
        for split, names in job.options.panels:
            for end, name in zip(job.options.distances, names, strict=True):
                values = [cell_of(means, (metric, name, v), metric).text() for v in job.label_of]
                rows.append([metric_of(metric).heading(), job.of_set(split), end, *values])
    return ["metric", "set", "until", *job.label_of.values()], rows, 3


def width_rows(summary: Sequence[TabledMean], job: StudyJob) -> Printed:
    """A row for each method and prior, a column for each metric and set."""
    means = by_place(summary)
    columns = [(m, s) for m in tabled_metrics(summary, job.convention) for s in width_sets(summary)]
    header = [f"{job.of_set(name)}: {metric_of(metric).heading()}" for metric, name in columns]
    rows = []
    for method in dict.fromkeys(map(base, job.label_of)):
        priors = job.priors[method]
        ordered = {name: ranges_text(priors[name]) for name in by_width(priors)}
        for name, ranges in {None: "not augmented", **ordered}.items():
            variant = method if name is None else f"{method}+{name}"
            if variant in job.label_of:
                values = [cell_of(means, (*column, variant), column[0]).text() for column in columns]
                rows.append([job.label_of[variant], ranges, *values])
    return ["method", "p⁺", *header], rows, 2


def during_training_rows(summary: Sequence[TabledMean], job: StudyJob) -> Printed:
    """A row for each snapshot and length of fine-tuning, a column for each metric and set."""
    means = by_passes(summary)
    columns = [(m, s) for m in tabled_metrics(summary, job.convention) for s in DURING_TRAINING_SETS]
    header = [f"{job.of_set(name)}: {metric_of(metric).heading()}" for metric, name in columns]
    rows = []
    for epoch, tuned in sorted({key[2:] for key in means}):
        values = [cell_of(means, (*column, epoch, tuned), column[0]).text() for column in columns]
        rows.append([str(epoch), str(tuned) if tuned else "–", *values])
    return ["training passes", "fine-tuning passes", *header], rows, 0


KINDS = {
    kind.name: Study(kind.title, kind.along, globals()[kind.rows], globals()[kind.draw]) for kind in products.STUDIES
}

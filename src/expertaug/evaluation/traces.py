"""Figures over time: forecasts against the truth, and the course of a training."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from expertaug import plotting
from expertaug.errors import InputError
from expertaug.evaluation import fields
from expertaug.evaluation.forecast_file import Forecasts
from expertaug.evaluation.summary import experiment_title, set_title
from expertaug.tracking.log import Log, read_log
from expertaug.versions import Version, ordered

TRUTH = "0.05"
MOST_DIMENSIONS = 4
CURVE_POINTS = 150
# A forecast may run away; the axis shows the truth's range and this share of it on each side.
ROOM = 0.5
METRICS = {"loss": "training loss", "validation_score": "validation log-MSE"}


def forecasts(forecasts: Mapping[str, Path], outputs: Path | Sequence[Path], settings: Mapping | None = None) -> None:
    """Draw the forecasts of several methods for the same samples: a row per state dimension, a column per sample.

    A state that is a field is drawn by :func:`expertaug.evaluation.fields.panel` instead.

    Arguments:
        forecasts: forecasts.npz by method; all of one experiment.
        outputs: .png or .pdf files, or one path without suffix for both.
        settings: all optional: ``labels`` (pairs of a method and what is printed for it), ``all_methods`` (those of the
            configuration, in order), ``set`` (default "test"), ``samples`` (positions among those kept; default the
            first three), ``seed`` (default the first that could be trained), ``set_titles``, ``left_out`` (how many
            versions are not drawn), ``measured`` (whether the states were measured, not simulated).

    Raises:
        InputError: a file is broken, holds other samples than the first one, or lacks the set, the seed or a sample.
    """
    if not forecasts:
        raise InputError("forecasts", "no file", "at least one forecasts.npz")
    found = {method: Forecasts.load(path) for method, path in forecasts.items()}
    with plotting.styled():
        plotting.save(draw_forecasts(found, dict(settings or {}), forecasts), outputs)


def draw_forecasts(found: Mapping[str, Forecasts], settings: Mapping, forecasts: Mapping[str, object]) -> Figure:
    """The figure of :func:`forecasts` from forecasts in memory; messages name them as the last argument does."""
    labels, all_methods = dict(settings.get("labels", ())), settings.get("all_methods", ())
    methods = ordered(found, all_methods)
    found = {method: found[method] for method in methods}
    first, name = found[methods[0]], settings.get("set", "test")
    _check_same(forecasts, found, name)
    samples = settings.get("samples") or list(range(min(3, len(first.index[name]))))
    if max(samples) >= len(first.index[name]):
        raise InputError(forecasts[methods[0]], f"no sample {max(samples)}", f"it keeps {len(first.index[name])}")
    seed = settings.get("seed", _first_trained(found))
    if fields.is_field(first, name):
        for method in methods:
            _seed_position(forecasts[method], found[method], seed)
        return fields.panel(found, name, settings, seed)
    size = first.truth[name].shape[-1]
    spread = np.linspace(0, size - 1, min(size, MOST_DIMENSIONS)).astype(int)
    dimensions = list(dict.fromkeys(spread.tolist()))
    colours = plotting.colours(methods, all_methods)
    gaps = bool(np.isnan(first.truth[name]).any())  # a point between two of them is no line
    with plotting.styled():
        figure = plotting.new_figure(0.85 + 1.25 * len(dimensions), min(plotting.WIDTH, 2.2 + 2.0 * len(samples)))
        grid = figure.subplots(len(dimensions), len(samples), squeeze=False, sharex=True, sharey="row")
        for row, dimension in enumerate(dimensions):
            for axis, sample in zip(grid[row], samples, strict=True):
                axis.axvspan(first.t[0], first.t[first.observed], color="0.92", linewidth=0, zorder=0)
                line = {"color": TRUTH, "linewidth": 1.0, "marker": "." if gaps else "", "markersize": 3, "zorder": 5}
                axis.plot(first.t, first.truth[name][sample, :, dimension], **line)
                for method in methods:
                    place = _seed_position(forecasts[method], found[method], seed)
                    prediction = found[method].prediction[name][place]
                    order = 4 if Version.parse(method).is_augmented else 3
                    line = {"color": colours[method], "linestyle": plotting.dash(method), "zorder": order}
                    axis.plot(first.t, prediction[sample, :, dimension], linewidth=1.2, **line)
                    if name in found[method].band:
                        low, high = found[method].band[name][:, place, sample, :, dimension]
                        times = first.t[len(first.t) - len(low) :]
                        axis.fill_between(times, low, high, color=colours[method], alpha=0.2, linewidth=0, zorder=1)
                if row == 0:
                    axis.set_title(", ".join(first.parameters(name, sample)[:2]), fontsize=7.5)
                if row == len(dimensions) - 1:
                    axis.set_xlabel("t [s]")
            grid[row, 0].set_ylim(*_limits(grid[row], first.truth[name][samples][:, :, dimension]))
            grid[row, 0].set_ylabel(plotting.quantity(first.state_names[dimension], first.state_units[dimension]))
        grid[0, 0].set_xlim(first.t[0], first.t[-1])
        figure.align_ylabels(grid[:, 0])
        told = "measured" if gaps or settings.get("measured") else "truth"
        handles = [Line2D([], [], color=TRUTH, linewidth=1.0, label=told)]
        handles += _handles(methods, labels, colours)
        handles.append(Patch(facecolor="0.92", label="observed window"))
        if any(name in one.band for one in found.values()):
            handles.append(Patch(facecolor="0.5", alpha=0.2, label="90 % band, where a method has one"))
        plotting.legend(figure, handles)
        words = f"forecasts on the {set_title(name, settings)} set, seed {seed}"
        if settings.get("left_out"):
            words += f"; {settings['left_out']} further versions are in the tables"
        plotting.heading(figure, plotting.text(words))
    return figure


def curves(logs: Sequence[Path], outputs: Path | Sequence[Path], settings: Mapping | None = None) -> None:
    """Draw the course of trainings: mean over seeds as a line, all seeds as a band; a row per experiment.

    Arguments:
        logs: log.jsonl of every method and group of seeds.
        outputs: as in :func:`forecasts`.
        settings: all optional: ``all_methods`` (those of the configuration, in order), ``title`` (of a single
            experiment), ``traced`` (the versions to draw; default all).

    Raises:
        InputError: a log is broken or holds none of the metrics.
    """
    settings = dict(settings or {})
    all_methods, labels = settings.get("all_methods", ()), {}
    found: dict[str, dict[str, list[Log]]] = {}
    # The scores of flows are densities.
    read = [log for log in map(read_log, logs) if not Version.parse(log.header.method).is_flow]
    trained = {log.header.method for log in read}
    shown = trained & set(settings.get("traced") or trained) or trained
    for log in (log for log in read if log.header.method in shown):
        labels[log.header.method] = log.header.label
        found.setdefault(log.header.experiment, {}).setdefault(log.header.method, []).append(log)
    known = {
        key
        for group in found.values()
        for logs in group.values()
        for log in logs
        for s in log.steps
        for key in s.metrics
    }
    metrics = {key: title for key, title in METRICS.items() if key in known}
    if not metrics:
        raise InputError("logs", "none of them has the metrics", f"trainings log {', '.join(METRICS)}")
    methods = ordered(labels, all_methods)
    colours = plotting.colours(methods, all_methods)
    with plotting.styled():
        figure = plotting.new_figure(0.6 + 2.1 * len(found), plotting.WIDTH)
        grid = figure.subplots(len(found), len(metrics), squeeze=False)
        for row, (experiment, group) in enumerate(found.items()):
            for axis, (metric, title) in zip(grid[row], metrics.items(), strict=True):
                for method in methods:
                    if method in group:
                        _curve(axis, group[method], metric, colours[method], plotting.dash(method))
                _scale(axis)
                axis.set(title=experiment_title(experiment, settings), xlabel="step", ylabel=title)
                axis.grid(axis="y")
        handles = _handles(methods, labels, colours)
        handles.append(Patch(facecolor="0.85", label="range over seeds (line: mean)"))
        plotting.legend(figure, handles)
        if left_out := len(trained - shown):
            plotting.heading(figure, plotting.text(f"curves of {left_out} more are in the dashboard"))
        plotting.save(figure, outputs)


def _limits(axes: Sequence[Axes], truth: np.ndarray) -> tuple[float, float]:
    """All curves, but not far beyond the truth where one runs away."""
    drawn = np.concatenate([line.get_ydata() for axis in axes for line in axis.lines])
    drawn, truth = drawn[np.isfinite(drawn)], truth[np.isfinite(truth)]
    if not len(truth):  # of a component that nobody measured
        truth = drawn if len(drawn) else np.array([0.0, 1.0])
        drawn = truth
    room = ROOM * (np.ptp(truth) or 1.0)
    low, high = max(drawn.min(), truth.min() - room), min(drawn.max(), truth.max() + room)
    margin = 0.06 * ((high - low) or 1.0)
    return low - margin, high + margin


def _curve(axis: Axes, logs: Sequence[Log], metric: str, colour: tuple, dash: object) -> None:
    """Groups of seeds of one method side by side; a long course is averaged in bins."""
    by_step: dict[int, list[float]] = {}
    for log in logs:
        for line in log.steps:
            if metric in line.metrics:
                values = line.metrics[metric]
                by_step.setdefault(line.step, []).extend(values if isinstance(values, tuple) else [values])
    widest = max(map(len, by_step.values()), default=0)
    steps = np.array(sorted(step for step, values in by_step.items() if len(values) == widest))
    if not len(steps):
        return
    values = np.array([by_step[step] for step in steps])
    values[~np.isfinite(values)] = np.nan
    size = -(-len(steps) // CURVE_POINTS)
    edges = np.arange(0, len(steps), size)
    counts = np.diff(np.append(edges, len(steps)))
    steps = np.add.reduceat(steps, edges) / counts
    values = np.add.reduceat(values, edges) / counts[:, None]
    if widest > 1:
        axis.fill_between(steps, values.min(1), values.max(1), color=colour, alpha=0.25, linewidth=0)
    axis.plot(steps, values.mean(1), color=colour, linestyle=dash, linewidth=1.3)


def _scale(axis: Axes) -> None:
    """A logarithmic axis where values span more than a factor of 30, linear about zero where some are not positive."""
    values = np.concatenate([line.get_ydata() for line in axis.lines] or [np.array([])])
    values = values[np.isfinite(values)]
    if len(values) and values.min() > 0 and values.max() / values.min() > 30:
        axis.set_yscale("log")
    elif len(values) and values.min() <= 0 and values.max() > 30 * (typical := max(np.median(np.abs(values)), 1.0)):
        axis.set_yscale("symlog", linthresh=10 ** np.round(np.log10(typical)))  # ticks within the linear part collide


def _check_same(paths: Mapping[str, object], found: Mapping[str, Forecasts], name: str) -> None:
    one, first = next(iter(found.items()))
    for method, data in found.items():
        if name not in data.truth:
            raise InputError(paths[method], f"no set {name!r}", f"it has {', '.join(data.truth)}")
        same = data.truth[name].shape == first.truth[name].shape and np.array_equal(data.index[name], first.index[name])
        if not same:
            raise InputError(paths[method], f"other samples than {paths[one]}", "evaluate both on the same data")


def _seed_position(path: object, data: Forecasts, seed: int) -> int:
    if seed not in data.seeds:
        raise InputError(path, f"no seed {seed}", f"it has {', '.join(map(str, data.seeds))}")
    return data.seeds.index(seed)


def _first_trained(found: Mapping[str, Forecasts]) -> int:
    """The first seed that could be trained in every file; where there is none the first."""
    first = next(iter(found.values()))
    failed = {seed for data in found.values() for seed in data.failed}
    return next((seed for seed in first.seeds if seed not in failed), first.seeds[0])


def _handles(methods: Sequence[str], labels: Mapping[str, str], colours: Mapping) -> list[Line2D]:
    """Entries of a legend."""
    lines = {m: {"color": colours[m], "linestyle": plotting.dash(m)} for m in methods}
    return [Line2D([], [], label=labels.get(m, m), **line) for m, line in lines.items()]

"""Figures of estimated expert parameters: against the true ones, or their distribution where nobody knows these."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from expertaug import plotting
from expertaug.evaluation.forecasts import Forecasts
from expertaug.evaluation.settings import ParameterReading
from expertaug.evaluation.summary import drawn_sets
from expertaug.versions import order_versions

MARKERS = {"train": "^", "validation": "o", "iid": "s", "test": "D"}  # as those of dots
POINTS = 200  # of one set and seed in a scatter plot
MARGIN = 0.12  # of an axis beyond the ranges that it shows
BINS, TAIL = 25, 0.02  # of a histogram, and the part of all estimates that it leaves out at either end


PLAIN = ParameterReading(labels=[])


def parameters(forecasts: Mapping[str, Forecasts], reading: ParameterReading = PLAIN) -> Figure:
    """Estimated against true expert parameters: a row per parameter, a column per method, all seeds; where no method
    estimates anything the figure says so.

    Arguments:
        forecasts: by method; methods that estimate nothing are left out.
        reading: without a training range that of the forecasts' training values is shaded, and where they have none
            that of their validation values.
    """
    estimating = {method: data for method, data in forecasts.items() if data.estimates}
    if not estimating:
        return plotting.note("no method estimates parameters")
    methods = order_versions(estimating, dict(reading.hues))
    colours = plotting.colours(methods, dict(reading.hues))
    first = estimating[methods[0]]
    count = len(first.parameter_names)
    with plotting.use_style():
        side = min(2.3, (plotting.WIDTH - 0.5) / len(methods))
        before_unit = "\n[" if side < 1.2 else " ["  # two lines where the panels are narrow
        titles = [plotting.wrap_words(plotting.text(reading.printed(method)), side) for method in methods]
        lines = max(title.count("\n") for title in titles)
        height = 0.6 + (side + 0.25) * count + 0.13 * lines
        figure = plotting.new_figure(height, max(4.6, side * len(methods) + 0.5))
        grid = figure.subplots(count, len(methods), squeeze=False, sharex="row", sharey="row")
        for row, name in enumerate(first.parameter_names):
            quantity = plotting.quantity(name, first.parameter_units[row]).replace(" [", before_unit)
            if is_unknown(first, row):
                priors = {method: _prior(reading, method, name) for method in methods}
                axes = dict(zip(methods, grid[row], strict=True))
                _histograms(axes, estimating, row, colours, priors)
                for axis, title in zip(axes.values(), titles, strict=True):
                    axis.set_xlabel(f"estimated {quantity}")
                    axis.set_title(title if row == 0 else "")
                grid[row, 0].set_ylabel("windows\n(truth unknown)")
                continue
            low, high = _show_ranges(dict(zip(methods, grid[row], strict=True)), first, row, name, reading)
            annotated = []
            for axis, method in zip(grid[row], methods, strict=True):
                annotated.append(_scatter(axis, estimating[method], row, (low, high), colours[method]))
                axis.set_xlabel(f"true {quantity}")
            for axis, title in zip(grid[row] if row == 0 else (), titles, strict=False):
                axis.set_title(title, pad=12 if any(annotated) else None)  # above what is told of points outside
            grid[row, 0].set_ylabel(f"estimated {quantity}")
        _parameter_legend(figure, first, reading)
        if first.version is not None:
            title = f"{reading.of_experiment(first.version.experiment)}: expert parameters"
            plotting.heading(figure, plotting.text(title))
    return figure


def is_unknown(data: Forecasts, column: int) -> bool:
    """Whether no sample of the sets that are drawn knows a parameter."""
    return not any(np.isfinite(data.truths[name][:, column]).any() for name in drawn_sets(data.estimates))


def _histograms(
    axes: Mapping[str, Axes],
    by_method: Mapping[str, Forecasts],
    column: int,
    colours: Mapping[str, Sequence[float]],
    priors: Mapping[str, Sequence[float] | None],
) -> None:
    """Histograms of the estimates of one parameter, an axis a method: filled of the test set, of others an outline."""
    each = [
        data.estimates[n][data.places, :, column] for data in by_method.values() for n in drawn_sets(data.estimates)
    ]
    pooled = np.concatenate([values.ravel() for values in each])
    pooled = pooled[np.isfinite(pooled)]
    ends = np.quantile(pooled, [TAIL, 1 - TAIL]) if len(pooled) else np.array([0.0, 1.0])
    shown = [end for prior in priors.values() if prior is not None for end in prior]
    low, high = min([float(ends[0]), *shown]), max([float(ends[1]), *shown])
    margin = 0.05 * ((high - low) or 1.0)
    edges = np.linspace(low - margin, high + margin, BINS + 1)
    for method, axis in axes.items():
        data = by_method[method]
        for name in drawn_sets(data.estimates):
            counts, _ = np.histogram(data.estimates[name][data.places, :, column], edges)
            height = counts / max(counts.max(initial=0), 1)
            test = name == "test"
            axis.stairs(height, edges, fill=test, alpha=0.45 if test else 1.0, color=colours[method])
        for edge in priors[method] or ():
            axis.axvline(edge, color="0.45", linewidth=0.8, linestyle=(0, (4, 2)), zorder=1)
        axis.set(xlim=(edges[0], edges[-1]), ylim=(0, 1.1), yticks=[])


def _show_ranges(
    axes: Mapping[str, Axes], data: Forecasts, column: int, name: str, reading: ParameterReading
) -> tuple[float, float]:
    """Shade the training range, draw each method's p⁺ and set the limits, which are returned."""
    training = reading.training_range.get(name)
    if training is None and (shaded := _choose_shaded(data)) is not None:
        values = data.truths[shaded][:, column]
        training = (np.nanmin(values), np.nanmax(values)) if np.isfinite(values).any() else None
    priors = {method: _prior(reading, method, name) for method in axes}
    ends = [value for limits in (training, *priors.values()) if limits is not None for value in limits]
    shown = [data.truths[name][:, column] for name in drawn_sets(data.estimates)]
    finite = [values[np.isfinite(values)] for values in shown]
    ends += [end for values in finite if len(values) for end in (values.min(), values.max())]
    low, high = min(ends), max(ends)
    margin = MARGIN * ((high - low) or 1.0)
    limits = (float(low - margin), float(high + margin))
    for method, axis in axes.items():
        if training is not None:
            axis.axvspan(*training, color="0.9", linewidth=0, zorder=0)
        for edge in priors[method] or ():
            axis.axvline(edge, color="0.45", linewidth=0.8, linestyle=(0, (4, 2)), zorder=1)
        axis.plot(limits, limits, color="0.25", linewidth=0.8, zorder=1)
        axis.set(xlim=limits, ylim=limits)
    return limits


def _prior(reading: ParameterReading, method: str, name: str) -> tuple[float, float] | None:
    """The range of a parameter under a method's p⁺."""
    return reading.priors.get(method, {}).get(name)


def _choose_shaded(data: Forecasts) -> str | None:
    """The set whose range is shaded where that of the training is not told."""
    return next((name for name in ("train", "validation") if np.isfinite(data.truths.get(name, np.nan)).any()), None)


def _scatter(
    axis: Axes, data: Forecasts, column: int, limits: tuple[float, float], colour: tuple[float, float, float]
) -> bool:
    """Draw a method's estimates; whether some lie outside, which is then told above the panel."""
    outside = total = 0
    for name in reversed(drawn_sets(data.estimates)):  # the narrower sets on top
        truth = data.truths[name][:, column]
        chosen = np.linspace(0, len(truth) - 1, min(POINTS, len(truth))).astype(int)
        for estimate in data.estimates[name][data.places, :, column]:
            inside = (estimate >= limits[0]) & (estimate <= limits[1])
            finite = np.isfinite(truth)
            outside, total = outside + int((~inside & finite).sum()), total + int(finite.sum())
            filled = name == "test"
            axis.scatter(
                truth[chosen],
                estimate[chosen],
                s=6,
                marker=MARKERS.get(name, "s"),
                facecolor=colour if filled else "none",
                edgecolor="0.2" if filled else colour,
                linewidth=0.3 if filled else 0.6,
                alpha=0.7,
                zorder=2,
                rasterized=True,
            )
    if outside:
        share = 100 * outside / total
        text = f"{share:.0f} % outside" if share >= 1 else "< 1 % outside"
        axis.annotate(text, (0.5, 1.02), xycoords="axes fraction", ha="center", va="bottom", fontsize=6.5, color="0.3")
    return bool(outside)


def _parameter_legend(figure: Figure, data: Forecasts, reading: ParameterReading) -> None:
    unknown = [is_unknown(data, row) for row in range(len(data.parameter_names))]
    handles = []
    for name in drawn_sets(data.estimates):
        title, face = reading.of_set(name), "0.6" if name == "test" else "none"
        if all(unknown):
            handles.append(Patch(facecolor=face, edgecolor="0.3", label=title))
            continue
        marker = {"marker": MARKERS.get(name, "s"), "markerfacecolor": face, "markeredgecolor": "0.3"}
        handles.append(Line2D([], [], linestyle="", markersize=4, label=title, **marker))
    if shaded := "train" if reading.training_range else _choose_shaded(data):
        handles.append(Patch(facecolor="0.9", label="training range" if shaded == "train" else "validation range"))
    if any(reading.priors.values()):
        handles.append(Line2D([], [], color="0.45", linewidth=0.8, linestyle=(0, (4, 2)), label="range of p⁺"))
    if not all(unknown):
        handles.append(Line2D([], [], color="0.25", linewidth=0.8, label="estimate = truth"))
    plotting.legend(figure, handles)

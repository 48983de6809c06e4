"""Estimates of parameters whose truth nobody knows: their distribution instead of a comparison."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes

from expertaug.evaluation.forecast_file import Forecasts
from expertaug.evaluation.summary import drawn_sets

BINS, TAIL = 25, 0.02  # of a histogram, and the part of all estimates that it leaves out at either end


def is_unknown(data: Forecasts, column: int) -> bool:
    """Whether no sample of the sets that are drawn knows a parameter."""
    return not any(np.isfinite(data.truths[name][:, column]).any() for name in drawn_sets(data.estimates))


def draw(
    axes: Mapping[str, Axes],
    found: Mapping[str, Forecasts],
    column: int,
    colours: Mapping[str, Sequence[float]],
    priors: Mapping[str, Sequence[float] | None],
) -> None:
    """Histograms of the estimates of one parameter, an axis a method: filled, and of the test set an outline."""
    each = [data.estimates[n][data.places, :, column] for data in found.values() for n in drawn_sets(data.estimates)]
    pooled = np.concatenate([one.ravel() for one in each])
    pooled = pooled[np.isfinite(pooled)]
    ends = np.quantile(pooled, [TAIL, 1 - TAIL]) if len(pooled) else np.array([0.0, 1.0])
    shown = [end for prior in priors.values() if prior is not None for end in prior]
    low, high = min([float(ends[0]), *shown]), max([float(ends[1]), *shown])
    margin = 0.05 * ((high - low) or 1.0)
    edges = np.linspace(low - margin, high + margin, BINS + 1)
    for method, axis in axes.items():
        data = found[method]
        for name in drawn_sets(data.estimates):
            counts, _ = np.histogram(data.estimates[name][data.places, :, column], edges)
            height = counts / max(counts.max(initial=0), 1)
            test = name == "test"
            axis.stairs(height, edges, fill=not test, alpha=1.0 if test else 0.35, color=colours[method])
        for edge in priors[method] or ():
            axis.axvline(edge, color="0.45", linewidth=0.8, linestyle=(0, (4, 2)), zorder=1)
        axis.set(xlim=(edges[0], edges[-1]), ylim=(0, 1.1), yticks=[])

"""Forecasts of a field: a state of several axes over time, truth and methods below each other, and their errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage

from expertaug import plotting
from expertaug.evaluation.forecast_file import Forecasts
from expertaug.evaluation.summary import set_title
from expertaug.versions import paired

TIMES = 4
GAP = 0.25  # between states and errors, in widths of a panel
COLOURS = "RdBu_r"
OVERSHOOT = 0.1  # of the truth's range that the colours reach beyond it
QUANTILE = 99.0  # of the errors that their colours reach to: one forecast that runs away would hide all others


def is_field(data: Forecasts, name: str) -> bool:
    """Whether a state has other axes than its components."""
    return data.truth[name].ndim > 3


def panel(found: Mapping[str, Forecasts], name: str, settings: Mapping, seed: int) -> Figure:
    """Draw one sample's first component: a row for the truth and for each method, a column per time; beside them what
    each forecast is off by, on a scale of its own, and the root mean square of that over the whole forecast.

    Arguments:
        found: forecasts by method, in order; their states are (components, space …).
        name: of the set.
        settings: all optional: ``samples`` (positions among those kept; of these the one whose z_e is farthest outside
            the training set's range is drawn; default all), ``labels`` (pairs of a method and what is printed for it),
            ``set_titles``.
        seed: whose forecasts are drawn.
    """
    methods, labels = paired(found), dict(settings.get("labels", ()))
    first = found[methods[0]]
    sample = farthest(first, name, settings.get("samples") or range(len(first.index[name])))
    times = np.linspace(0, len(first.t) - 1, min(TIMES, len(first.t))).round().astype(int)
    later = [k for k in times if k > first.observed]
    truth = first.truth[name][sample, :, 0]
    states = {m: found[m].prediction[name][found[m].seeds.index(seed), sample, :, 0] for m in methods}
    errors = [values - truth for values in states.values()]
    with plotting.styled():
        side = (plotting.WIDTH - 1.3) / (len(times) + len(later) + GAP)
        figure = plotting.new_figure(1.4 + side * (1 + len(methods)))
        figure.get_layout_engine().set(h_pad=0.03, w_pad=0.03, hspace=0, wspace=0)
        widths = [1] * len(times) + [GAP] + [1] * len(later)
        grid = figure.subplots(1 + len(methods), len(widths), squeeze=False, width_ratios=widths)
        left, right = grid[:, : len(times)], grid[1:, len(times) + 1 :]
        for axis in (*grid[:, len(times)], *grid[0, len(times) + 1 :]):
            axis.set_axis_off()
        image = _draw_all(left, [[row[k] for k in times] for row in (truth, *states.values())], _limits(truth))
        for axis, k in zip(left[0], times, strict=True):
            axis.set_title(f"t = {first.t[k]:.3g} s\n{'observed' if k <= first.observed else 'forecast'}", fontsize=7)
        rms = [f"\n{_rms(error[first.observed + 1 :]):.2g}" for error in errors]
        names = ["truth", *(plotting.text(labels.get(m, m)) + off for m, off in zip(methods, rms, strict=True))]
        for axis, words in zip(left[:, 0], names, strict=True):
            axis.set_ylabel(words, rotation=0, ha="right", va="center", labelpad=6)
        quantity = plotting.quantity(first.state_names[0], first.state_units[0])
        if image is not None:
            figure.colorbar(image, ax=left, location="bottom", shrink=0.7, aspect=28, label=quantity, extend="both")
        if later:
            shown = [[error[k] for k in later] for error in errors]
            finite = np.abs(shown)[np.isfinite(shown)]
            most = (float(np.percentile(finite, QUANTILE)) if finite.size else 0.0) or 1.0
            image = _draw_all(right, shown, (-most, most))
            for axis, k in zip(grid[0, len(times) + 1 :], later, strict=True):
                head = f"t = {first.t[k]:.3g} s\nerror"
                axis.text(0.5, 0.02, head, ha="center", va="bottom", fontsize=7, transform=axis.transAxes)
            if image is not None:
                label = f"{quantity}, forecast − truth"
                figure.colorbar(image, ax=right, location="bottom", shrink=0.8, aspect=22, label=label, extend="both")
        title = f"{_title(first, name, sample, settings)}, seed {seed}; below a method, root mean square of its error"
        plotting.heading(figure, title)
    return figure


def farthest(data: Forecasts, name: str, samples: Sequence[int]) -> int:
    """The sample whose z_e lies farthest outside the training set's range, in units of it; the first where none does.

    Chosen by its parameters alone, not by how well anything forecasts it.
    """
    if "train" not in data.truths:
        return samples[0]
    low, high = data.truths["train"].min(0), data.truths["train"].max(0)
    z_e = data.truths[name][data.index[name][list(samples)]]
    outside = np.maximum(0, np.maximum(low - z_e, z_e - high)) / np.where(high > low, high - low, 1)
    return samples[int(outside.sum(-1).argmax())]


def _rms(error: np.ndarray) -> float:
    return float(np.sqrt(np.square(error, dtype=float).mean()))


def _limits(truth: np.ndarray) -> tuple[float, float]:
    """Of the colours: the truth's range and some room, with white at zero where zero is inside."""
    low, high = float(truth.min()), float(truth.max())
    if low < 0 < high:
        low, high = -max(-low, high), max(-low, high)
    room = OVERSHOOT * ((high - low) or 1.0)
    return low - room, high + room


def _draw_all(axes: np.ndarray, rows: Sequence[Sequence[np.ndarray]], limits: tuple[float, float]) -> AxesImage | None:
    """Draw a field on each of the axes (rows, columns); the last image, None where fields are lines."""
    image = None
    for line, row in zip(axes, rows, strict=True):
        for axis, field in zip(line, row, strict=True):
            image = _draw(axis, field, limits)
    return image


def _draw(axis: Axes, field: np.ndarray, limits: tuple[float, float]) -> AxesImage | None:
    """A field over one axis as a line, over two as an image, over more by its middle slice."""
    while field.ndim > 2:
        field = field[len(field) // 2]
    axis.set(xticks=[], yticks=[])
    if field.ndim == 1:
        axis.plot(field, color="0.1")
        axis.set_ylim(*limits)
        return None
    for side in axis.spines.values():
        side.set_visible(False)
    return axis.imshow(field, vmin=limits[0], vmax=limits[1], cmap=COLOURS, interpolation="nearest")


def _title(data: Forecasts, name: str, sample: int, settings: Mapping) -> str:
    return f"a sample of the {set_title(name, settings)} set ({', '.join(data.parameters(name, sample))})"

"""Forecasts of a field: what a state of several axes looks like over time, truth and methods below each other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.image import AxesImage

from expertaug.evaluation import style
from expertaug.evaluation.forecast_file import Forecasts
from expertaug.evaluation.summary import set_title
from expertaug.variants import base_label, is_augmented

TIMES = 6
COLOURS = "RdBu_r"
OVERSHOOT = 0.1  # of the truth's range that the colours reach beyond it


def is_field(data: Forecasts, name: str) -> bool:
    """Whether a state has other axes than its components."""
    return data.truth[name].ndim > 3


def pairs(labels: Sequence[str]) -> list[str]:
    """The methods with an augmented version and these versions; all where there is none."""
    bases = {base_label(label) for label in labels if is_augmented(label)}
    return [label for label in labels if base_label(label) in bases] or list(labels)


def panel(
    found: Mapping[str, Forecasts], name: str, outputs: Path | Sequence[Path], settings: Mapping, seed: int
) -> None:
    """Draw one sample's first component: a row for the truth and for each method, a column per time.

    Arguments:
        found: forecasts by label, in order; their states are (components, space …).
        name: of the set.
        outputs: .png or .pdf files, or one path without suffix for both.
        settings: all optional: ``samples`` (the first is drawn; default the first), ``component`` (default 0),
            ``times`` (indices; default six, evenly spread), ``set_titles``.
        seed: whose forecasts are drawn.
    """
    labels = pairs(list(found))
    first = found[labels[0]]
    sample, component = (settings.get("samples") or [0])[0], int(settings.get("component", 0))
    times = settings.get("times") or np.linspace(0, len(first.t) - 1, min(TIMES, len(first.t))).round().astype(int)
    truth = first.truth[name][sample, :, component]
    rows = {"truth": truth}
    for label in labels:
        rows[label] = found[label].prediction[name][found[label].seeds.index(seed), sample, :, component]
    low, high = float(truth.min()), float(truth.max())
    if low < 0 < high:  # white is zero
        low, high = -max(-low, high), max(-low, high)
    room = OVERSHOOT * ((high - low) or 1.0)
    limits = low - room, high + room
    with style.styled():
        side = (style.WIDTH - 1.4) / len(times)
        figure = style.new_figure(0.55 + side * len(rows))
        figure.get_layout_engine().set(h_pad=0.03, w_pad=0.03, hspace=0, wspace=0)
        grid = figure.subplots(len(rows), len(times), squeeze=False)
        image = None
        for line, (label, states) in zip(grid, rows.items(), strict=True):
            for axis, k in zip(line, times, strict=True):
                image = _draw(axis, states[k], limits) or image
                if label == "truth":
                    seen = "observed" if k <= first.observed else "forecast"
                    axis.set_title(f"t = {first.t[k]:.3g} s\n{seen}", fontsize=7)
            line[0].set_ylabel(style.text(label), rotation=0, ha="right", va="center", labelpad=6)
        quantity = style.quantity(first.state_names[component], first.state_units[component])
        if image is not None:
            figure.colorbar(image, ax=grid, shrink=0.6, aspect=28, label=quantity, extend="both")
        figure.suptitle(f"{_title(first, name, sample, settings)}, seed {seed}", fontsize=7.5, color="0.35")
        style.save(figure, outputs)


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
    values = data.truths[name][data.index[name][sample]]
    parts = [
        f"{style.symbol(parameter)} = {value:.3g} {unit}".strip()
        for parameter, unit, value in zip(data.parameter_names, data.parameter_units, values, strict=True)
    ]
    return f"a sample of the {set_title(name, settings)} set ({', '.join(parts)})".replace("-", "−")

"""Bars: a group for each set, a bar for each method, as high as the mean over seeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.patches import Patch

from expertaug import plotting
from expertaug.evaluation.summary import labels_of, order_sets, set_title, summarise
from expertaug.labels import ordered


@dataclass(frozen=True)
class Panel:
    """One panel.

    Attributes:
        title: above it.
        table: rows of metrics.csv, of one metric.
        settings: ``set_titles`` (how the sets are printed; optional).
    """

    title: str
    table: pd.DataFrame
    settings: Mapping


def draw_bars(
    panels: Sequence[Panel],
    outputs: Path | Sequence[Path],
    settings: Mapping,
    axis_label: str,
    title: str,
) -> None:
    """Draw panels of bars with one legend.

    Arguments:
        settings: ``all_methods`` (those of the configuration, in order).
        axis_label: of the values.
        title: above all panels; presets and number of seeds are added.
    """
    everything = pd.concat([panel.table for panel in panels])
    labels, all_methods = labels_of(everything), settings.get("all_methods", ())
    methods = ordered(everything["method"], all_methods)
    colours = plotting.colours(methods, all_methods)
    columns = min(len(panels), 3)
    rows = -(-len(panels) // columns)
    with plotting.styled():
        figure = plotting.new_figure(0.75 + 2.35 * rows, plotting.WIDTH if columns > 1 else 5.2)
        grid = figure.subplots(rows, columns, squeeze=False)
        for axis, panel in zip(grid.flat, panels, strict=False):
            _bar_panel(axis, panel.table, methods, colours, panel.settings)
            axis.set_title(panel.title)
        for axis in grid.flat[len(panels) :]:
            axis.set_axis_off()
        for axis in grid[:, 0]:
            axis.set_ylabel(axis_label)
        presets = ", ".join(dict.fromkeys(everything["preset"]))
        seeds = everything.groupby(["experiment", "method"])["seed"].nunique()
        number = "1 seed" if set(seeds) == {1} else f"{seeds.min()} seeds" if seeds.nunique() == 1 else "all seeds"
        number = number if number == "1 seed" else f"mean ± std over {number}"
        plotting.heading(figure, f"{title}{'; ' if columns > 1 else chr(10)}{number}; preset {presets}")
        looks = {m: {"facecolor": colours[m], "edgecolor": "0.25", "hatch": plotting.hatch(m)} for m in methods}
        handles = [Patch(**looks[m], linewidth=0.5, label=labels[m]) for m in methods]
        plotting.legend(figure, handles)
        plotting.save(figure, outputs)


def _bar_panel(axis: Axes, part: pd.DataFrame, methods: Sequence[str], colours: Mapping, settings: Mapping) -> None:
    """Groups of bars, one group per set; a method keeps its place in the group."""
    sets = order_sets(part["set"])
    shown = [method for method in methods if method in set(part["method"])]
    step = 0.84 / len(shown)
    values = summarise(part).set_index(["method", "set"])
    axis.axhline(0, color="0.25", linewidth=0.7, zorder=3)
    for place, method in enumerate(shown):
        for group, name in enumerate(sets):
            x = group + (place - (len(shown) - 1) / 2) * step
            if (method, name) not in values.index:
                continue
            cell = values.loc[(method, name)]
            cell = cell.iloc[0] if isinstance(cell, pd.DataFrame) else cell
            if cell["n"] == 0:
                axis.annotate("not finite", (x, 0), rotation=90, ha="center", va="bottom", fontsize=6, color="0.3")
                continue
            look = {"color": colours[method], "edgecolor": "0.25", "hatch": plotting.hatch(method)}
            axis.bar(x, cell["mean"], 0.9 * step, **look, linewidth=0.5, zorder=2)
            if cell["n"] > 1:
                seeds = part.loc[(part["method"] == method) & (part["set"] == name), "value"]
                spread = np.linspace(-0.22, 0.22, len(seeds)) * step
                dots = {"markersize": 2.2, "markerfacecolor": "white", "markeredgecolor": "0.1", "markeredgewidth": 0.4}
                axis.plot(x + spread, seeds, "o", zorder=6, **dots)
                axis.errorbar(x, cell["mean"], cell["std"], color="0.1", linewidth=0.9, capsize=1.8, zorder=5)
    axis.set_xticks(range(len(sets)), [plotting.text(set_title(name, settings)).replace(" (", "\n(") for name in sets])
    axis.tick_params(axis="x", length=0)
    axis.set_xlim(-0.5, len(sets) - 0.5)
    axis.grid(axis="y")
    for edge in range(1, len(sets)):
        axis.axvline(edge - 0.5, color="0.85", linewidth=0.6, zorder=0)

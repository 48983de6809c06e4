"""Tables and figure of the power that models of a pendulum dissipate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.lines import Line2D

from expertaug import plotting
from expertaug.evaluation.formats import DASH, booktabs, escape, grid, number_format
from expertaug.evaluation.summary import experiment_title, order_sets, set_title
from expertaug.labels import is_refined

CAPTION = (
    "Loss of mechanical energy E per inertia (of the first arm, where there are two), in s⁻³, on measured states. "
    "Measured: −dE/dt, the mean "
    "over chunks of the median slope of E (± its standard error, by recording). Dissipated: the mean of "
    "−∇E · (F_e + F_a) on the same states, mean ± standard deviation (n − 1) over seeds; an expert without friction "
    "conserves E, so this is the power that F_a dissipates. E has the constants of each method's own expert. "
    "Correlation: of the two over recordings."
)
TITLE = "loss of energy"


def markdown(table: pd.DataFrame, settings: Mapping) -> str:
    """A table of methods and one of recordings."""
    first, second = _of_methods(table, settings), _of_recordings(table, settings)
    lines = [f"## {settings['experiment']}: {TITLE}", "", CAPTION, ""]
    lines += grid(first[0], [[escape(cell) for cell in row] for row in first[1]], 2)
    lines += ["", "By recording:", "", *grid(second[0], [[escape(cell) for cell in row] for row in second[1]], 2)]
    return "\n".join(lines) + "\n"


def latex(table: pd.DataFrame, settings: Mapping) -> str:
    """The table of methods."""
    header, rows = _of_methods(table, settings)
    name = str(settings["experiment"])
    return booktabs(header, rows, 2, CAPTION, f"{name}-dissipation".replace("_", "-"), f"{name}: {TITLE}")


def over_recordings(table: pd.DataFrame) -> pd.DataFrame:
    """Mean over chunks of all recordings, and the correlation over recordings: a row for each version, set and seed."""
    rows = []
    for keys, part in table.groupby(["method", "label", "set", "seed"], sort=False):
        weights = part["chunks"] / part["chunks"].sum()
        known = part["dissipated"].notna().all() and len(part) > 2 and part["dissipated"].std() > 0
        rows.append(
            {
                **dict(zip(("method", "label", "set", "seed"), keys, strict=True)),  # type: ignore[arg-type]
                "measured": (weights * part["measured"]).sum(),
                "dissipated": (weights * part["dissipated"]).sum(skipna=False),
                "correlation": np.corrcoef(part["measured"], part["dissipated"])[0, 1] if known else np.nan,
            }
        )
    return pd.DataFrame(rows)


def _of_methods(table: pd.DataFrame, settings: Mapping) -> tuple[list[str], list[list[str]]]:
    """A row for each set and version."""
    overall, rows = over_recordings(table), []
    for name in order_sets(table["set"]):
        for version, label, _ in settings["versions"]:
            part = overall[(overall["set"] == name) & (overall["method"] == version)]
            cells = [_text(part["measured"].iloc[:1]), _text(part["dissipated"]), _text(part["correlation"])]
            rows.append([set_title(name, settings), label, *(cell.replace("-", "−") for cell in cells)])
    return ["set", "method", "measured", "dissipated", "correlation"], rows


def _of_recordings(table: pd.DataFrame, settings: Mapping) -> tuple[list[str], list[list[str]]]:
    """A row for each set and recording, a column for each expert's measured loss and each version."""
    experts = list(dict.fromkeys(table["expert"]))
    rows = []
    for (name, recording), part in table.groupby(["set", "recording"], sort=False):
        firsts = [part[part["expert"] == expert].iloc[0] for expert in experts]
        measured = [_number(row["measured"], row["measured_se"]) for row in firsts]
        each = [_text(part.loc[part["method"] == version, "dissipated"]) for version, *_ in settings["versions"]]
        cells = [cell.replace("-", "−") for cell in (*measured, *each)]
        rows.append([set_title(str(name), settings), str(recording), str(firsts[0]["chunks"]), *cells])
    columns = ["measured"] if len(experts) == 1 else [f"measured, {expert}" for expert in experts]
    return ["set", "recording", "chunks", *columns, *(label for _, label, _ in settings["versions"])], rows


def _text(values: pd.Series) -> str:
    """Mean ± standard deviation over the seeds that have a value."""
    known = values.dropna()
    if not len(known):
        return DASH
    text = _number(known.mean(), known.std() if len(known) > 1 else None)
    return text + (f" ({len(known)}/{len(values)})" if len(known) < len(values) else "")


def _number(mean: float, spread: float | None) -> str:
    """Three digits of a mean, and its spread as exactly."""
    text = number_format("dissipated", mean)
    return text(mean) if spread is None else f"{text(mean)} ± {text(spread)}"


def draw(table: pd.DataFrame, outputs: Sequence[Path], settings: Mapping) -> None:
    """Dissipated against measured loss: a panel for each expert and set, a point for each recording, a colour for each
    method."""
    experts, sets = list(dict.fromkeys(table["expert"])), order_sets(table["set"])
    labels = {version: label for version, label, _ in settings["versions"]}
    colours = plotting.colours(list(labels), settings["all_methods"])
    looks = {v: _look(v, colours[v]) for v in labels}
    with plotting.styled():
        figure = plotting.new_figure(0.6 + 2.4 * len(experts))
        panels = figure.subplots(len(experts), len(sets), squeeze=False)
        for row, expert in zip(panels, experts, strict=True):
            for axis, name in zip(row, sets, strict=True):
                part = table[(table["expert"] == expert) & (table["set"] == name)]
                ends = [min(0.0, part["measured"].min()), part["measured"].max()]
                axis.plot(ends, ends, color="0.6", linewidth=0.8, zorder=1)
                for version, look in looks.items():
                    own = part[part["method"] == version].groupby("recording", sort=False)
                    means = own[["measured", "dissipated"]].mean()
                    axis.plot(means["measured"], means["dissipated"], **look)
                title = set_title(name, settings)
                axis.set_title(title if len(experts) == 1 else f"{title}, expert {expert.replace('_', ' ')}")
                axis.grid()
            row[0].set_ylabel("dissipated by the model [s⁻³]")
        for axis in panels[-1]:
            axis.set_xlabel("measured loss [s⁻³]")
        handles = [Line2D([], [], label=label, **looks[version]) for version, label in labels.items()]
        plotting.legend(figure, handles)
        title = experiment_title(settings["experiment"], settings)
        plotting.heading(figure, f"{title}: loss of energy per inertia; a point is a recording, mean over seeds")
        plotting.save(figure, outputs)


def _look(version: str, colour: object) -> dict:
    """A point; hollow where estimates are refined."""
    filled = "none" if is_refined(version) else colour
    return {"color": colour, "marker": "o", "markersize": 3.2, "markerfacecolor": filled, "linestyle": "none"}

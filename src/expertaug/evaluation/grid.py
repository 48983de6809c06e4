"""The stage grid: table and figure of a sweep over hyperparameters, by the score on the validation set alone."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from expertaug import plotting
from expertaug.errors import InputError
from expertaug.evaluation.metrics import LOG_MSE
from expertaug.evaluation.settings import GridJob
from expertaug.evaluation.table import Cell, Study, Table
from expertaug.models import store


def grid(models: Sequence[Path], outputs: Sequence[Path], job: GridJob) -> None:
    """Write the table and draw the figure of a sweep.

    Arguments:
        models: model files of all points and groups of seeds; only what they say of their training is used.
        outputs: any of .csv (mean, std, n in full precision), .md, .tex, .png and .pdf.

    Raises:
        InputError: a model is of no point, a point has no model, or an output's suffix is unknown.
    """
    table = read_scores(models, [name for name, _ in job.points])
    summary = summarise(table, job)
    keys, caption = job.keys, _caption(table, job)
    title = f"{job.experiment}: grid over {', '.join(keys)}"
    header = ["point", *keys, "selection score", "best pass", "minutes"]
    rows = [_row(row, keys) for _, row in summary.sort_values("mean", na_position="last").iterrows()]
    label = f"{job.experiment}-grid".replace("_", "-")
    printed = Table(header, [("", rows)], 1 + len(keys), (), title, caption, label)
    Study(summary, [printed], lambda: _draw(table, summary, job)).save(outputs)


def read_scores(models: Sequence[Path], names: Sequence[str]) -> pd.DataFrame:
    """Selection score of every seed of every point: columns point, seed, score, epoch, minutes."""
    rows = []
    for path in models:
        card = store.read_card(Path(path))
        if card.method not in names:
            raise InputError(path, f"a model of '{card.method}'", "give the models of the grid")
        scores = zip(card.seeds, card.best_score or [], card.best_epoch or [], strict=True)
        minutes = card.wall_s / 60
        rows += [  # a seed that could not be trained has no score
            (card.method, seed, math.nan if score is None else score, epoch, minutes) for seed, score, epoch in scores
        ]
    table = pd.DataFrame(rows, columns=["point", "seed", "score", "epoch", "minutes"])
    missing = [name for name in names if name not in set(table["point"])]
    if missing:
        raise InputError(missing[0], "no model of this point", "give a model of every point")
    return table


def summarise(table: pd.DataFrame, job: GridJob) -> pd.DataFrame:
    """A row for each point, in the order of the grid: its values, mean, std (n − 1), n (finite seeds) and of."""
    finite = table.assign(score=table["score"].where(np.isfinite(table["score"])))
    groups = finite.groupby("point")
    summary = groups["score"].agg(mean="mean", std="std", n="count", of="size")
    summary = summary.join(groups.agg(best_epoch=("epoch", "median"), minutes=("minutes", "sum")))
    summary = summary.loc[[name for name, _ in job.points]].reset_index()
    for place, key in enumerate(job.keys):
        summary.insert(1 + place, key, [_text(values[place]) for _, values in job.points])
    return summary


def _row(row: pd.Series, keys: Sequence[str]) -> list[str]:
    score = Cell.of_row(LOG_MSE["sum"], row).text()
    return [row["point"], *(row[key] for key in keys), score, f"{row['best_epoch']:g}", f"{row['minutes']:.1f}"]


def _caption(table: pd.DataFrame, job: GridJob) -> str:
    seeds = table["seed"].nunique()
    return (
        f"{job.label}, best first. Selection score: that on the validation set by which a training's best pass "
        f"is chosen, mean ± standard deviation (n − 1) over {seeds} seed{'s' * (seeds > 1)}; lower is better. "
        "The test set is not read."
    )


def _draw(table: pd.DataFrame, summary: pd.DataFrame, job: GridJob) -> Figure:
    """The score against each key's values: a dot for each seed of each point, a line through the best of each value."""
    keys = job.keys
    scores = {name: part["score"].to_numpy() for name, part in table.groupby("point")}
    with plotting.styled():
        figure = plotting.new_figure(3.0, plotting.WIDTH if len(keys) > 1 else 4.6)
        panels = figure.subplots(1, len(keys), squeeze=False, sharey=True)[0]
        for axis, key in zip(panels, keys, strict=True):
            values = list(dict.fromkeys(summary[key]))
            best = summary.groupby(key)["mean"].min().reindex(values)
            for _, row in summary.iterrows():
                y = scores[row["point"]]
                axis.plot(np.full(len(y), values.index(row[key])), y, "o", color="#7A7A7A", markersize=3, alpha=0.6)
            axis.plot(range(len(values)), best, "-o", color="#0072B2", markersize=4)
            axis.set_xticks(range(len(values)), [plotting.text(value) for value in values])
            axis.set_xlim(-0.4, len(values) - 0.6)
            axis.set_xlabel(plotting.text(key))
            axis.grid(axis="y")
        panels[0].set_ylabel("validation score (lower is better)")
    return figure


def _text(value: object) -> str:
    """A key's value as it is printed."""
    if isinstance(value, float) and math.isfinite(value):
        return f"{value:g}"
    return "null" if value is None else str(value)

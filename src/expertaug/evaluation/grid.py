"""The stage grid: table and figure of a sweep over hyperparameters, by the score on the validation set alone."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from expertaug import plotting
from expertaug.errors import InputError
from expertaug.evaluation.metrics import LOG_MSE
from expertaug.evaluation.settings import GridJob
from expertaug.evaluation.summary import spread_of
from expertaug.evaluation.table import Cell, Study, Table
from expertaug.models import store
from expertaug.models.card import ModelCard
from expertaug.rows import frame


@dataclass(frozen=True)
class SeedScore:
    """The selection score of a seed of a point; NaN where it could not be trained."""

    point: str
    seed: int
    score: float
    epoch: int
    minutes: float


@dataclass(frozen=True)
class Point:
    """A point of the grid, over its seeds.

    Attributes:
        point: its name.
        mean, std, n, of: of the scores, as of :class:`expertaug.evaluation.summary.Spread`.
        best_epoch: the median.
        minutes: of all seeds' trainings.
    """

    point: str
    mean: float
    std: float
    n: int
    of: int
    best_epoch: float
    minutes: float


def run_stage(models: Sequence[Path], outputs: Sequence[Path], job: GridJob) -> None:
    """Stage: write the table and draw the figure of a sweep.

    Arguments:
        models: model files of all points and groups of seeds; only what they say of their training is read.
        outputs: any of .csv (mean, std, n in full precision), .md, .tex, .png and .pdf.

    Raises:
        InputError: a file is broken, as of :func:`grid`, or an output's suffix is unknown.
    """
    grid({str(path): store.read_card(path) for path in models}, job).save(outputs)


def grid(cards: Mapping[str, ModelCard], job: GridJob) -> Study:
    """The table and the figure of a sweep.

    Arguments:
        cards: of the models of all points and groups of seeds, by what messages call these.

    Raises:
        InputError: a model is of no point, or a point has no model.
    """
    scores = scores_of(cards, [name for name, _ in job.points])
    points, values = summarise(scores, job), values_of(job)
    title = f"{job.experiment}: grid over {', '.join(job.keys)}"
    header = ["point", *job.keys, "selection score", "best pass", "minutes"]
    best_first = sorted(points, key=lambda point: math.inf if math.isnan(point.mean) else point.mean)
    rows = [_row(point, values[point.point]) for point in best_first]
    label = f"{job.experiment}-grid".replace("_", "-")
    printed = Table(header, [("", rows)], 1 + len(job.keys), (), title, _caption(scores, job), label)
    numbers = frame(Point, points)
    for place, key in enumerate(job.keys):
        numbers.insert(1 + place, key, [values[point.point][place] for point in points])
    return Study(numbers, [printed], lambda: _draw(scores, points, job))


def scores_of(cards: Mapping[str, ModelCard], names: Sequence[str]) -> list[SeedScore]:
    """Selection score of every seed of every point."""
    rows: list[SeedScore] = []
    for where, card in cards.items():
        if card.method not in names:
            raise InputError(where, f"a model of '{card.method}'", "give the models of the grid")
        scores = zip(card.seeds, card.best_score or [], card.best_epoch or [], strict=True)
        minutes = card.wall_s / 60
        rows += [
            SeedScore(card.method, seed, math.nan if score is None else score, epoch, minutes)
            for seed, score, epoch in scores
        ]
    scored = {row.point for row in rows}
    if missing := [name for name in names if name not in scored]:
        raise InputError(missing[0], "no model of this point", "give a model of every point")
    return rows


def summarise(scores: Sequence[SeedScore], job: GridJob) -> list[Point]:
    """The points in the order of the grid."""
    spreads = spread_of([score.point for score in scores], [score.score for score in scores])
    points = []
    for name, _ in job.points:
        own = [score for score in scores if score.point == name]
        epochs, minutes = float(np.median([score.epoch for score in own])), math.fsum(score.minutes for score in own)
        points.append(Point(name, *spreads[name], epochs, minutes))
    return points


def values_of(job: GridJob) -> dict[str, list[str]]:
    """Values of the keys, as they are printed, by point."""
    return {name: list(map(_text, values)) for name, values in job.points}


def _row(point: Point, values: Sequence[str]) -> list[str]:
    score = Cell(LOG_MSE["sum"], point.mean, point.std, point.n, point.of).text()
    return [point.point, *values, score, f"{point.best_epoch:g}", f"{point.minutes:.1f}"]


def _caption(scores: Sequence[SeedScore], job: GridJob) -> str:
    seeds = len({score.seed for score in scores})
    return (
        f"{job.label}, best first. Selection score: that on the validation set by which a training's best pass "
        f"is chosen, mean ± standard deviation (n − 1) over {seeds} seed{'s' * (seeds > 1)}; lower is better. "
        "The test set is not read."
    )


def _draw(scores: Sequence[SeedScore], points: Sequence[Point], job: GridJob) -> Figure:
    """The score against each key's values: a dot for each seed of each point, a line through the best of each value."""
    keys, values = job.keys, values_of(job)
    with plotting.use_style():
        figure = plotting.new_figure(3.0, plotting.WIDTH if len(keys) > 1 else 4.6)
        panels = figure.subplots(1, len(keys), squeeze=False, sharey=True)[0]
        for place, (axis, key) in enumerate(zip(panels, keys, strict=True)):
            ticks = list(dict.fromkeys(values[point.point][place] for point in points))
            for point in points:
                y = [score.score for score in scores if score.point == point.point]
                x = [ticks.index(values[point.point][place])] * len(y)
                axis.plot(x, y, "o", color="#7A7A7A", markersize=3, alpha=0.6)
            means = [[point.mean for point in points if values[point.point][place] == tick] for tick in ticks]
            best = [min((mean for mean in each if math.isfinite(mean)), default=math.nan) for each in means]
            axis.plot(range(len(ticks)), best, "-o", color="#0072B2", markersize=4)
            axis.set_xticks(range(len(ticks)), [plotting.text(tick) for tick in ticks])
            axis.set_xlim(-0.4, len(ticks) - 0.6)
            axis.set_xlabel(plotting.text(key))
            axis.grid(axis="y")
        panels[0].set_ylabel("selection score (lower is better)")
    return figure


def _text(value: object) -> str:
    """A key's value as it is printed."""
    if isinstance(value, float) and math.isfinite(value):
        return f"{value:g}"
    return "null" if value is None else str(value)

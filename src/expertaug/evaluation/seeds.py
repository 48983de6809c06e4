"""The stage seeds: each seed of every version, and the median of their forecasts, which no failing seed moves far."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from expertaug import plotting
from expertaug.evaluation.forecasts import Forecasts
from expertaug.evaluation.intervals import interval, log_mean, units_of
from expertaug.evaluation.metrics import log_mse_of
from expertaug.evaluation.settings import Titles, WindowStudyJob
from expertaug.evaluation.table import Cell, Study, Table
from expertaug.evaluation.windows import VersionWindows, windows_of
from expertaug.rows import frame, group_by
from expertaug.versions import LINES

SEED, MEAN, MEDIAN = "seed", "mean", "median"
LOG_MSE = log_mse_of("sum")
EMPTY = "No version has several seeds."
SEED_LOOK: plotting.Look = {
    "color": plotting.HUES[5],
    "marker": "o",
    "markersize": 4,
    "linestyle": "",
    "markerfacecolor": "none",
}
MEDIAN_LOOK: plotting.Look = {"color": plotting.HUES[7], "marker": "D", "markersize": 5, "linestyle": ""}
ROW = 0.3  # inches of a version's row
CAPTION = (
    "log-MSE of the forecasts, errors summed over the observed quantities; lower is better. Mean: over seeds, with its "
    "95 % interval over windows and seeds. Best and worst: single seeds. Median of the forecasts: at each time and of "
    "each quantity the median over the seeds of a group is the forecast, with its 95 % interval over windows. It needs "
    "no truth and is not chosen by any score."
)


@dataclass(frozen=True)
class SeedScore:
    """The log-MSE of a version on a set.

    Attributes:
        method, label, set: of which version and set.
        of: a seed, the mean over seeds, or the median of their forecasts.
        log_mse: natural logarithm of the mean squared error, summed over the observed quantities.
        low, high: ends of the 95 % interval; NaN of a seed.
        seed: which; None of those of all.
    """

    method: str
    label: str
    set: str
    of: str
    log_mse: float
    low: float = math.nan
    high: float = math.nan
    seed: int | None = None


def run_stage(forecasts: Sequence[Path], outputs: Sequence[Path], job: WindowStudyJob) -> None:
    """Stage: write the table of an experiment's seeds and draw it.

    Arguments:
        forecasts: forecasts.npz of all versions and groups of seeds.
        outputs: any of .csv, .md, .tex, .png and .pdf.
        job: see :func:`seeds`.

    Raises:
        InputError: a file is broken, or an output's suffix is unknown.
    """
    seeds(map(Forecasts.load, forecasts), job).save(outputs)


def seeds(forecasts: Iterable[Forecasts], job: WindowStudyJob) -> Study:
    """The table and the figure of an experiment's seeds; where no version has several they say so.

    Arguments:
        forecasts: of all versions and groups of seeds.
        job: ``traced`` are drawn before others.

    Raises:
        InputError: as of :func:`windows_of`.
    """
    versions, labels = windows_of(forecasts), job.label_of
    several = {v: versions[v] for v in labels if v in versions and _differ(versions[v])}
    scores = [score for v, version in several.items() for score in _scores(v, labels[v], version)]
    title = f"{job.of_experiment(next(iter(versions.values())).experiment)}: seeds"
    return Study(frame(SeedScore, scores), [_table(scores, job, title)], lambda: _draw(scores, job, title))


def _differ(version: VersionWindows) -> bool:
    """Whether there are several seeds with forecasts of their own: those of least squares are all the same."""
    return any(bool(np.ptp(version.sets[name].errors, axis=0).any()) for name in _sets(version))


def _sets(version: VersionWindows) -> list[str]:
    return [name for name in version.judged if version.sets[name].median is not None]


def _scores(method: str, label: str, version: VersionWindows) -> Iterator[SeedScore]:
    for name in _sets(version):
        window_set, whose = version.sets[name], (method, label, name)
        assert window_set.median is not None
        unit = units_of(window_set.id, window_set.errors.shape[1])
        each = log_mean(window_set.errors, unit)
        for seed, value in zip(version.seeds, each.value, strict=True):
            yield SeedScore(*whose, SEED, float(value), seed=seed)
        for of, resampled in ((MEAN, each), (MEDIAN, log_mean(window_set.median, unit))):
            estimate = interval(resampled)
            yield SeedScore(*whose, of, estimate.mean, estimate.low, estimate.high)


def _table(scores: Sequence[SeedScore], titles: Titles, title: str) -> Table:
    """A part for each set, a row for each version."""
    parts = []
    for name, of_set in group_by(scores, lambda score: score.set).items():
        rows = []
        for part in group_by(of_set, lambda score: score.method).values():
            (mean,), (median,) = ([score for score in part if score.of == of] for of in (MEAN, MEDIAN))
            single = [score.log_mse for score in part if score.of == SEED]
            ends = [LOG_MSE.format(value)(value).replace("-", "−") for value in (min(single), max(single))]
            rows.append([mean.label, _cell(mean), *ends, _cell(median)])
        parts.append((titles.of_set(name), rows))
    head = ["method", "mean over seeds", "best seed", "worst seed", "median of the forecasts"]
    return Table(head, parts, 1, (), title, CAPTION, "seeds", empty=EMPTY)


def _cell(score: SeedScore) -> Cell:
    return Cell(LOG_MSE, score.log_mse, n=1, of=1, low=score.low, high=score.high)


def _draw(scores: Sequence[SeedScore], job: WindowStudyJob, title: str) -> Figure:
    """A panel for each set, a row for each version: its seeds, and the median of their forecasts."""
    named = list(dict.fromkeys(score.method for score in scores))
    first = sorted(named, key=lambda v: v not in job.traced)[:LINES]
    shown = [v for v in named if v in first]
    if not shown:
        return plotting.note(EMPTY)
    sets = group_by((score for score in scores if score.method in shown), lambda score: score.set)
    with plotting.use_style():
        figure = plotting.new_figure(1.3 + ROW * len(shown))
        axes = figure.subplots(1, len(sets), sharey=True, squeeze=False)[0]
        for axis, (name, of_set) in zip(axes, sets.items(), strict=True):
            for score in of_set:
                row = shown.index(score.method)
                if score.of == SEED:
                    axis.plot([score.log_mse], [row], zorder=3, **SEED_LOOK)  # not behind the diamond
                elif score.of == MEDIAN:
                    axis.plot([score.low, score.high], [row, row], color=MEDIAN_LOOK["color"], linewidth=1.0)
                    axis.plot([score.log_mse], [row], **MEDIAN_LOOK)
            axis.set(title=job.of_set(name), xlabel="log-MSE", ylim=(len(shown) - 0.5, -0.5))
            axis.grid(axis="x")
            axis.tick_params(axis="y", length=0)
        axes[0].set_yticks(range(len(shown)), [plotting.text(job.label_of[v]) for v in shown])
        looks = {"a seed": SEED_LOOK, "median of the seeds' forecasts, 95 % interval": MEDIAN_LOOK}
        plotting.legend(figure, [Line2D([], [], label=label, **look) for label, look in looks.items()])
        plotting.heading(figure, plotting.text(title))
    return figure

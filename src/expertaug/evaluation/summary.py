"""Metrics of many runs in long format, and their mean and spread over seeds."""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from operator import attrgetter
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np
import pandas as pd

from expertaug.errors import InputError
from expertaug.evaluation.forecasts import VersionKey
from expertaug.evaluation.intervals import Interval, interval, of_seeds
from expertaug.evaluation.metrics import METRICS, Metric, Shown, first_metrics, metric_of
from expertaug.evaluation.samples import Samples
from expertaug.evaluation.table import Cell
from expertaug.rows import group_by, read_csv
from expertaug.tracking.metrics_csv import MetricRow, read_rows
from expertaug.versions import SHOWN_SETS

K = TypeVar("K", bound=Hashable)


@dataclass(frozen=True, kw_only=True)
class Mean:
    """A metric of a version on a set: mean and standard deviation over seeds.

    Attributes:
        experiment, system, preset, method, label: whose; ``method`` names the version, ``label`` is what is printed.
        epoch, finetune_epochs: of a study during training: passes of training, and of fine-tuning.
        mean, std: over the seeds with a finite value; divided by n − 1, NaN of one seed.
        n, of: number of seeds with a finite value, and of all.
    """

    experiment: str
    system: str
    preset: str
    method: str
    label: str
    set: str
    metric: str
    epoch: int | None = None
    finetune_epochs: int | None = None
    mean: float
    std: float
    n: int
    of: int

    @property
    def version(self) -> VersionKey:
        """Whose it is among samples' errors."""
        return VersionKey(self.experiment, self.preset, self.method)

    @property
    def row(self) -> str:
        """What tells the rows of a table apart: method and preset."""
        return f"{self.method} {self.preset}"

    def cell(self, marked: bool = False) -> Cell:
        """As it is printed."""
        return Cell(metric_of(self.metric), self.mean, self.std, self.n, self.of, marked=marked)


@dataclass(frozen=True, kw_only=True)
class TabledMean(Mean):
    """A mean in an experiment's table.

    Attributes:
        seeds: of the version.
        low, high: ends of its 95 % interval, NaN where no samples' errors are kept.
        gain, difference: how much better an augmented version is than its control, and than its base.
        values: of each seed, NaN of one without; None in files from before they were kept.
        behind: of a version that may be chosen, its log-MSE on the validation set: how far behind the best one it is.
        behind_error: the standard error of that.
    """

    seeds: tuple[int, ...]
    low: float
    high: float
    gain: Interval | None = None
    difference: Interval | None = None
    values: tuple[float, ...] | None = None
    behind: float | None = None
    behind_error: float | None = None

    @property
    def as_good(self) -> bool:
        """Whether this is the best that may be chosen, or within one standard error of it, where that is known."""
        has_error = self.behind_error is not None and np.isfinite(self.behind_error)
        return self.behind is not None and self.behind <= (self.behind_error if has_error else 0.0)

    def seeds_behind(self, by: float) -> int:
        """How many seeds are worse than the best by more than so much, or have no finite value; of a metric of which
        less is better."""
        finite = [value for value in self.values or () if np.isfinite(value)]
        return len(self.values or ()) - sum(value <= min(finite) + by for value in finite)

    def cell(self, marked: bool = False) -> Cell:
        """As it is printed, with its interval."""
        return Cell(metric_of(self.metric), self.mean, self.std, self.n, self.of, self.low, self.high, marked)


IDENTITY = tuple(field.name for field in fields(Mean) if field.name not in ("mean", "std", "n", "of"))


class Spread(NamedTuple):
    """Mean and standard deviation (divided by n − 1) of the n finite values of ``of``."""

    mean: float
    std: float
    n: int
    of: int


def spread_of(groups: Sequence[K], values: Sequence[float]) -> dict[K, Spread]:
    """Mean and spread of the values of each group, in order of appearance."""
    numbers = {group: k for k, group in enumerate(dict.fromkeys(groups))}
    series = pd.Series(np.asarray(values, dtype=float))
    grouped = series.where(np.isfinite(series)).groupby([numbers[group] for group in groups], sort=False)
    each = grouped.agg(["mean", "std", "count", "size"]).itertuples(index=False, name=None)
    return {group: Spread(*of_group) for group, of_group in zip(numbers, each, strict=True)}


def mean_of(values: Iterable[float]) -> float:
    """Of those that are numbers; NaN where none is."""
    numbers = [value for value in values if not np.isnan(value)]
    return float(np.mean(numbers)) if numbers else np.nan


def read_metrics(paths: Sequence[str | Path], along: bool = False) -> list[MetricRow]:
    """The rows of several metrics.csv.

    Arguments:
        along: whether they are of a study during training.

    Raises:
        InputError: a file is missing or broken, or two files hold the same value.
    """
    if not paths:
        raise InputError("metrics", "no file", "at least one metrics.csv")
    rows: dict[tuple, MetricRow] = {}
    for path in paths:
        for row in read_rows(path, along):
            key = (row.experiment, row.method, row.preset, row.seed, row.set, row.metric)
            if along:
                key = (*key, row.epoch, row.finetune_epochs)
            if key in rows:
                what = f"{row.metric} of {row.label}, seed {row.seed}, on {row.set} is there twice"
                raise InputError(path, what, "give each group of seeds once")
            rows[key] = row
    return list(rows.values())


def summarise(rows: Sequence[MetricRow]) -> list[Mean]:
    """Mean and standard deviation over the seeds with a finite value, of each experiment, preset, method, set and
    metric (and, during training, of each number of passes), in order of appearance."""
    of_row = attrgetter(*IDENTITY)
    each = spread_of([of_row(row) for row in rows], [row.value for row in rows])
    return [Mean(**dict(zip(IDENTITY, key, strict=True)), **spread._asdict()) for key, spread in each.items()]


def with_intervals(rows: Sequence[MetricRow], samples: Samples | None) -> list[TabledMean]:
    """As :func:`summarise`, with the value of each seed and the 95 % interval, which tables and figures show.

    Arguments:
        samples: errors of all samples; a mean of which none are kept has no interval. None: intervals are of the seeds
            alone.
    """
    seeds = {version: tuple(sorted({row.seed for row in of})) for version, of in group_by(rows, _version).items()}
    scores = {(attrgetter(*IDENTITY)(row), row.seed): row.value for row in rows}
    tabled = []
    for mean in summarise(rows):
        key, own = attrgetter(*IDENTITY)(mean), seeds[mean.version]
        values = tuple(scores.get((key, seed), math.nan) for seed in own)
        low, high = _ends(mean, values, samples)
        tabled.append(TabledMean(**vars(mean), seeds=own, low=low, high=high, values=values))
    return tabled


def _version(row: MetricRow) -> VersionKey:
    return VersionKey(row.experiment, row.preset, row.method)


def _ends(mean: Mean, values: Sequence[float], samples: Samples | None) -> tuple[float, float]:
    """Ends of the interval round a mean; NaN where there is none."""
    not_negative = metric_of(mean.metric).not_negative
    if samples is None:
        alone = of_seeds(np.array([value for value in values if np.isfinite(value)]), not_negative)
        return alone.low, alone.high
    resampled = samples.resampled(mean.version, mean.set, mean.metric)
    if resampled is None:
        return math.nan, math.nan
    ends = interval(resampled, not_negative)
    shift = 0.0 if not_negative else mean.mean - ends.mean  # of a convention from the other
    return ends.low + shift, ends.high + shift


def read_long(path: str | Path, remedy: str = "make it again with tabulate") -> list[TabledMean]:
    """The long table of an experiment (:mod:`expertaug.evaluation.tabulate`).

    Raises:
        InputError: it is missing or broken.
    """
    return read_csv(path, TabledMean, remedy)


def cell_of(means: Mapping[K, Mean], key: K, metric: str, marked: bool = False) -> Cell:
    """A mean as it is printed; a dash where there is none."""
    return means[key].cell(marked) if key in means else Cell(metric_of(metric))


def labels_of(rows: Iterable[MetricRow | Mean]) -> dict[str, str]:
    """What is printed for each version of a method."""
    return {row.method: row.label for row in rows}


def order_sets(sets: Iterable[str]) -> list[str]:
    """Train, validation, IID test, test, then others in order of appearance."""
    unique = list(dict.fromkeys(sets))
    return [name for name in SHOWN_SETS if name in unique] + [name for name in unique if name not in SHOWN_SETS]


def in_domain(sets: Iterable[str]) -> str:
    """The set that says how good a method is in its training's domain: the IID test set, on which nothing was chosen;
    validation where there is none."""
    return "iid" if "iid" in set(sets) else "validation"


def drawn_sets(sets: Iterable[str]) -> list[str]:
    """Sets that figures show, in order: validation only where there is no IID test set."""
    ordered = order_sets(sets)
    return [name for name in ordered if name != "validation" or in_domain(ordered) == name]


def shown_metrics(means: Iterable[Mean], convention: str) -> list[str]:
    """The log-MSE in a convention, and the parameters' error where a method estimates any."""
    return first_metrics((mean.metric for mean in means), convention)


def tabled_metrics(means: Sequence[Mean], convention: str) -> list[str]:
    """Those that figures show, and the share of diverged forecasts where there is any."""
    return [
        *shown_metrics(means, convention),
        *(m.name for m in METRICS if m.shown is Shown.WHERE_ANY and any_of(m, means)),
    ]


def last_columns(means: Sequence[Mean]) -> list[tuple[str, str]]:
    """Set and metric of the columns that say what an estimate costs: of the last set that is shown, if any has it."""
    last = [metric.name for metric in METRICS if metric.shown is Shown.LAST]
    each = [(order_sets(mean.set for mean in means if mean.metric == name), name) for name in last]
    return [(sets[-1], name) for sets, name in each if sets]


def any_of(metric: Metric, means: Iterable[Mean]) -> bool:
    """Whether a metric is above 0 anywhere, as the share of forecasts that diverged."""
    return any(mean.mean > 0 for mean in means if mean.metric == metric.name)

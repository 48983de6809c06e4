"""The stage compare: this run's numbers beside the paper's, with a verdict for each."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

from expertaug.errors import InputError
from expertaug.evaluation.forecasts import Forecasts
from expertaug.evaluation.intervals import Interval, Resampled, against, interval
from expertaug.evaluation.metrics import metric_of
from expertaug.evaluation.samples import Samples
from expertaug.evaluation.settings import CompareJob, Titles
from expertaug.evaluation.summary import Mean, in_domain, read_metrics, summarise
from expertaug.evaluation.table import DASH, Cell, Study, Table
from expertaug.rows import frame, read_csv
from expertaug.tracking.metrics_csv import MetricRow

NUMBERS = Path(__file__).with_name("paper.csv")
# The paper's tables (labels of its source), by metric.
TITLES = {
    "log_mse_sum": "log-MSE (paper, table synth_log_mse)",
    "relative_error": "relative error of the expert parameters in % (paper, table param_acc)",
}
HEADER = ["experiment", "set", "method", "published", "ours", "seeds", "p", "verdict"]
NO_VALUE, NOT_APART = "not run", "no clear difference"


@dataclass(frozen=True)
class Published:
    """One number of the paper: mean ± std over n runs, printed with ``decimals`` decimals."""

    table: str
    system: str
    label: str
    set: str
    metric: str
    mean: float
    std: float
    n: int
    decimals: int

    @property
    def spread(self) -> float:
        """One standard deviation; where it is printed as zero, the half of the last digit that it may still be."""
        return max(self.std, 0.5 * 10**-self.decimals)


@dataclass(frozen=True, kw_only=True)
class Compared:
    """A number of ours beside a published one.

    Attributes:
        table, label, metric: of the paper.
        experiment, preset, set: of ours; no preset of an experiment that was not run.
        published_mean, published_std, published_n: theirs.
        mean, std, low, high: ours, with the ends of its 95 % interval; NaN where there is none.
        p: of no difference.
        n, of: number of seeds with a finite value, and of all.
        at_or_below: whether ours is at or below the published mean and one standard deviation; None of no value.
        verdict: see :func:`verdict`.
    """

    table: str
    experiment: str
    preset: str | None
    set: str
    label: str
    metric: str
    published_mean: float
    published_std: float
    published_n: int
    mean: float
    std: float
    low: float
    high: float
    p: float
    n: int
    of: int
    at_or_below: bool | None
    verdict: str

    def cell(self) -> Cell:
        """Ours, as it is printed."""
        return Cell(metric_of(self.metric), self.mean, self.std, self.n, self.of, self.low, self.high)

    def published(self, digits: int) -> str:
        """Theirs, as it is printed."""
        return f"{self.published_mean:.{digits}f} ± {self.published_std:.{digits}f}".replace("-", "−")


def published_numbers(path: Path = NUMBERS) -> list[Published]:
    """The numbers of the paper's tables synth_log_mse and param_acc."""
    return read_csv(path, Published, "install the package again")


def difference_of(published: Published, resampled: Resampled) -> Interval:
    """How far a mean of ours is above a published one, with the spread of both: of ours over seeds and samples, of
    theirs over runs, and of the digits that are not printed."""
    return against(resampled, published.mean, published.spread, published.n, 10**-published.decimals)


def verdict(mean: float, difference: Interval | None) -> str:
    """better (lower) or worse where the difference is told apart from 0; both metrics are errors.

    Arguments:
        mean: ours; one that is not finite is worse.
        difference: of :func:`difference_of`; None where no seed has a finite value.
    """
    if difference is None or not math.isfinite(mean):
        return "worse"
    if not difference.told_apart:
        return NOT_APART
    return "better" if difference.mean < 0 else "worse"


def run_stage(metrics: Sequence[Path], outputs: Sequence[Path], job: CompareJob, forecasts: Sequence[Path]) -> None:
    """Stage: write tables of published and own numbers.

    Arguments:
        metrics: metrics.csv of every method and group of seeds, of one experiment or of several.
        outputs: any of .csv (full precision), .md and .tex.
        forecasts: forecasts.npz of the same runs, which have the errors of every sample.

    Raises:
        InputError: a file is broken, a system is unknown, samples' errors are missing, or an output's suffix.
    """
    compare(read_metrics(metrics), map(Forecasts.load, forecasts), job).save(outputs)


def compare(rows: Sequence[MetricRow], forecasts: Iterable[Forecasts], job: CompareJob) -> Study:
    """Tables of published and own numbers.

    Arguments:
        rows: the metrics of every method and seed, of one experiment or of several.
        forecasts: of the same runs, which have the errors of every sample.

    Raises:
        InputError: a system is unknown, or samples' errors are missing.
    """
    compared = comparison(summarise(rows), Samples(forecasts), job)
    return Study(frame(Compared, compared), _tables(compared))


def comparison(means: Sequence[Mean], samples: Samples, job: CompareJob) -> list[Compared]:
    """One row per published number and experiment that is compared with it, in the paper's order.

    Numbers of the paper's validation set, which is of the training's domain, are compared with those of the IID test
    set where there is one.
    """
    numbers = published_numbers()
    ours = {(mean.experiment, mean.label, mean.set, mean.metric): mean for mean in means}
    presets = {mean.experiment: mean.preset for mean in means}
    rows = []
    for experiment, system in job.published:
        of_system = [number for number in numbers if number.system == system]
        if not of_system:
            systems = ", ".join(dict.fromkeys(number.system for number in numbers))
            raise InputError(f"published numbers of {experiment}", f"no system '{system}'", f"known: {systems}")
        near = in_domain(mean.set for mean in means if mean.experiment == experiment)
        for number in of_system:
            name = near if number.set == "validation" else number.set
            mean = ours.get((experiment, number.label, name, number.metric))
            rows.append(_compare(number, mean, samples, experiment, presets.get(experiment), name))
    return rows


def _compare(
    number: Published, mean: Mean | None, samples: Samples, experiment: str, preset: str | None, name: str
) -> Compared:
    difference, low, high = None, math.nan, math.nan
    if mean is not None and mean.n:
        resampled = samples.resampled(mean.version, mean.set, mean.metric)
        if resampled is None:
            what = f"{mean.label} of {mean.experiment}"
            raise InputError(what, f"no errors of the samples of {mean.set}", "give the forecasts.npz of every run")
        own = interval(resampled, metric_of(mean.metric).not_negative)
        low, high, difference = own.low, own.high, difference_of(number, resampled)
    return Compared(
        table=number.table,
        experiment=experiment,
        preset=preset,
        set=name,
        label=number.label,
        metric=number.metric,
        published_mean=number.mean,
        published_std=number.std,
        published_n=number.n,
        mean=math.nan if mean is None else mean.mean,
        std=math.nan if mean is None else mean.std,
        low=low,
        high=high,
        p=math.nan if difference is None else difference.p,
        n=0 if mean is None else mean.n,
        of=0 if mean is None else mean.of,
        at_or_below=None if mean is None else mean.mean <= number.mean + number.spread,
        verdict=NO_VALUE if mean is None else verdict(mean.mean, difference),
    )


def _rows(part: Sequence[Compared]) -> list[list[str]]:
    """Printed cells; a number of ours has one digit more than the published one."""
    digits = max(number.decimals for number in published_numbers() if number.metric == part[0].metric)
    return [
        [
            row.experiment,
            Titles().of_set(row.set),
            row.label,
            row.published(digits),
            row.cell().text(),
            str(row.of),
            DASH if math.isnan(row.p) else f"{row.p:.3f}",
            row.verdict,
        ]
        for row in part
    ]


def _counts(part: Sequence[Compared]) -> str:
    run = [row for row in part if row.verdict != NO_VALUE]
    counts = [f"{sum(row.verdict == name for row in run)} {name}" for name in ("better", NOT_APART, "worse")]
    good = sum(bool(row.at_or_below) for row in run)
    below = f"At or below the published mean plus one standard deviation: {good} of {len(run)}."
    return f"Of {len(run)} cells {', '.join(counts)}. {below}"


def _caption(part: Sequence[Compared]) -> str:
    presets = ", ".join(f"{e}: {p}" for e, p in {row.experiment: row.preset for row in part}.items())
    runs = ", ".join(str(n) for n in sorted({row.published_n for row in part}))
    return (
        f"Preset of {presets}. Published: mean ± standard deviation over {runs} runs, of validation and test. Ours: "
        "mean over seeds [95 % interval, for which seeds and samples both are resampled]. better (lower), worse: the "
        "means differ with p < 0.05 by a test that weighs this spread of ours and the standard error of theirs. "
        f"{_counts(part)}"
    )


def _tables(rows: Sequence[Compared]) -> list[Table]:
    """One for each metric; in LaTeX a rule stands between experiments."""
    tables = []
    for metric, title in TITLES.items():
        if part := [row for row in rows if row.metric == metric]:
            printed = [("", list(each)) for _, each in groupby(_rows(part), key=lambda row: row[0])]
            tables.append(Table(HEADER, printed, 3, (), title, _caption(part), part[0].table))
    return tables

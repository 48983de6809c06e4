"""The stage compare: this run's numbers beside the paper's, with a verdict for each."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import pandas as pd

from expertaug.errors import InputError
from expertaug.evaluation.forecasts import VersionKey, read_forecasts
from expertaug.evaluation.intervals import Interval, Resampled, against, interval
from expertaug.evaluation.metrics import metric_of
from expertaug.evaluation.samples import Samples
from expertaug.evaluation.settings import CompareJob, Titles
from expertaug.evaluation.summary import in_domain, read_metrics, summarise
from expertaug.evaluation.table import DASH, Cell, Study, Table

NUMBERS = Path(__file__).with_name("paper.csv")
# The paper's tables (labels of its source), by metric.
TITLES = {
    "log_mse_sum": "log-MSE (paper, table synth_log_mse)",
    "relative_error": "relative error of the expert parameters in % (paper, table param_acc)",
}
HEADER = ["experiment", "set", "method", "published", "ours", "seeds", "p", "verdict"]
NO_VALUE, NOT_APART = "not run", "not told apart"


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


def published_numbers(path: Path = NUMBERS) -> list[Published]:
    """The numbers of the paper's tables synth_log_mse and param_acc."""
    with Path(path).open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    return [
        Published(
            **{key: row[key] for key in ("table", "system", "label", "set", "metric")},
            mean=float(row["mean"]),
            std=float(row["std"]),
            n=int(row["n"]),
            decimals=len(row["mean"].partition(".")[2]),
        )
        for row in rows
    ]


def difference_of(published: Published, found: Resampled) -> Interval:
    """How far a mean of ours is above a published one, with the spread of both: of ours over seeds and samples, of
    theirs over runs, and of the digits that are not printed."""
    return against(found, published.mean, published.spread, published.n, 10**-published.decimals)


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


def compare(metrics: Sequence[Path], outputs: Sequence[Path], job: CompareJob, forecasts: Sequence[Path]) -> None:
    """Write tables of published and own numbers.

    Arguments:
        metrics: metrics.csv of every method and group of seeds, of one experiment or of several.
        outputs: any of .csv (full precision), .md and .tex.
        forecasts: forecasts.npz of the same runs, which have the errors of every sample.

    Raises:
        InputError: a file is broken, a system is unknown, samples' errors are missing, or an output's suffix.
    """
    table = comparison(summarise(read_metrics(metrics)), Samples(read_forecasts(forecasts)), job)
    Study(table, _tables(table)).save(outputs)


def comparison(summary: pd.DataFrame, samples: Samples, job: CompareJob) -> pd.DataFrame:
    """One row per published number and experiment that is compared with it, in the paper's order.

    Numbers of the paper's validation set, which is of the training's domain, are compared with those of the IID test
    set where there is one.
    """
    numbers = published_numbers()
    ours = {(row["experiment"], row["label"], row["set"], row["metric"]): row for _, row in summary.iterrows()}
    presets = dict(zip(summary["experiment"], summary["preset"], strict=True))
    rows = []
    for experiment, system in job.published:
        found = [number for number in numbers if number.system == system]
        if not found:
            known = ", ".join(dict.fromkeys(number.system for number in numbers))
            raise InputError(f"published numbers of {experiment}", f"no system '{system}'", f"known: {known}")
        near = in_domain(summary.loc[summary["experiment"] == experiment, "set"])
        for one in found:
            name = near if one.set == "validation" else one.set
            cell = ours.get((experiment, one.label, name, one.metric))
            rows.append(
                {
                    "table": one.table,
                    "experiment": experiment,
                    "preset": presets.get(experiment),
                    "set": name,
                    "label": one.label,
                    "metric": one.metric,
                    "published_mean": one.mean,
                    "published_std": one.std,
                    "published_n": one.n,
                    **_ours(one, cell, samples),
                }
            )
    return pd.DataFrame(rows)


def _ours(one: Published, cell: pd.Series | None, samples: Samples) -> dict[str, object]:
    """Columns of our number: mean, std, n, of, low and high of its interval, p, whether it is at or below the published
    mean and one standard deviation, and the verdict."""
    if cell is None:
        nothing = dict.fromkeys(("mean", "std", "low", "high", "p"), math.nan)
        return nothing | {"n": 0, "of": 0, "at_or_below": None, "verdict": NO_VALUE}
    mean, difference, ends = float(cell["mean"]), None, (math.nan, math.nan)
    if cell["n"]:
        found = samples.resampled(
            VersionKey(cell["experiment"], cell["preset"], cell["method"]), cell["set"], cell["metric"]
        )
        if found is None:
            what = f"{cell['label']} of {cell['experiment']}"
            raise InputError(what, f"no errors of the samples of {cell['set']}", "give the forecasts.npz of every run")
        own, difference = interval(found, metric_of(cell["metric"]).not_negative), difference_of(one, found)
        ends = own.low, own.high
    return {
        "mean": mean,
        "std": cell["std"],
        "low": ends[0],
        "high": ends[1],
        "p": math.nan if difference is None else difference.p,
        "n": int(cell["n"]),
        "of": int(cell["of"]),
        "at_or_below": mean <= one.mean + one.spread,
        "verdict": verdict(mean, difference),
    }


def _parts(table: pd.DataFrame) -> list[tuple[str, pd.DataFrame]]:
    return [(metric, part) for metric in TITLES if len(part := table[table["metric"] == metric])]


def _rows(part: pd.DataFrame) -> list[list[str]]:
    """Printed cells; a number of ours has one digit more than the published one."""
    rows, decimals = [], {(n.metric, n.system): n.decimals for n in published_numbers()}
    digits = max(d for (metric, _), d in decimals.items() if metric == part["metric"].iloc[0])
    for _, row in part.iterrows():
        published = f"{row['published_mean']:.{digits}f} ± {row['published_std']:.{digits}f}".replace("-", "−")
        ours = Cell.of_row(metric_of(row["metric"]), row).text()
        p = DASH if math.isnan(row["p"]) else f"{row['p']:.3f}"
        name = Titles().of_set(row["set"])
        rows.append([row["experiment"], name, row["label"], published, ours, str(row["of"]), p, row["verdict"]])
    return rows


def _counts(part: pd.DataFrame) -> str:
    run = part[part["verdict"] != NO_VALUE]
    found = [f"{int((run['verdict'] == name).sum())} {name}" for name in ("better", NOT_APART, "worse")]
    good = f"At or below the published mean plus one standard deviation: {int(run['at_or_below'].sum())} of {len(run)}."
    return f"Of {len(run)} cells {', '.join(found)}. {good}"


def _caption(part: pd.DataFrame) -> str:
    presets = ", ".join(f"{e}: {p}" for e, p in dict(zip(part["experiment"], part["preset"], strict=True)).items())
    runs = ", ".join(str(n) for n in sorted(set(part["published_n"])))
    return (
        f"Preset of {presets}. Published: mean ± standard deviation over {runs} runs, of validation and test. Ours: "
        "mean over seeds [95 % interval, for which seeds and samples both are resampled]. better (lower), worse: the "
        "means differ with p < 0.05 by a test that weighs this spread of ours and the standard error of theirs. "
        f"{_counts(part)}"
    )


def _tables(table: pd.DataFrame) -> list[Table]:
    """One for each metric; in LaTeX a rule stands between experiments."""
    tables = []
    for metric, part in _parts(table):
        rows = [("", list(each)) for _, each in groupby(_rows(part), key=lambda row: row[0])]
        tables.append(Table(HEADER, rows, 3, (), TITLES[metric], _caption(part), part["table"].iloc[0]))
    return tables

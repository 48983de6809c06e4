"""Tables of the page, made of the tidy CSV files of a run: nothing is read from what was printed."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from expertaug.errors import InputError
from expertaug.evaluation import estimates, summary
from expertaug.evaluation.estimates import TabledEstimate
from expertaug.evaluation.intervals import Interval
from expertaug.evaluation.metrics import COST, metric_of
from expertaug.evaluation.published import Compared
from expertaug.evaluation.settings import Reading, ReportJob, TabulateJob, Titles
from expertaug.evaluation.summary import Mean, TabledMean, cell_of, tabled_metrics
from expertaug.evaluation.table import Table, plain
from expertaug.evaluation.tabulate import (
    OVER_CONTROL,
    choice_table,
    further_table,
    gain_cell,
    gains_table,
    main_table,
    seeds_table,
)
from expertaug.rows import columns, group_by, read_csv
from expertaug.tracking.metrics_csv import ALONG
from expertaug.versions import SHOWN_SETS

AGAIN = "make it again: delete it and run the workflow"
RECORDING = {
    "recording": "recording",
    "duration_s": "duration [s]",
    "tracked_share": "tracked [%]",
    "usable_share": "usable [%]",
    "arm1_px": "arm 1 [px]",
    "arm2_px": "arm 2 [px]",
    "noise1_deg": "noise 1 [°]",
    "noise2_deg": "noise 2 [°]",
    "rate_hz": "rate [Hz]",
    "implied_rate_hz": "implied rate [Hz]",
    "refused": "left out",
}
# Columns that say nothing beside the others, or that a label says better.
UNSAID = ("experiment", "system", "preset", "method")
HEADS = {"label": "method", "auroc": "AUROC"}  # columns of CSV files that are not printed by their own names


class Numbers(ABC):
    """What a table's CSV holds."""

    @abstractmethod
    def table(self, reading: Reading, job: ReportJob) -> Table:
        """As the page shows it.

        Arguments:
            reading: of its experiment.
            job: of the page.
        """


def read_numbers(path: Path) -> Numbers:
    """The numbers of any table but those that are printed in a way of their own.

    Raises:
        InputError: the file is missing or broken.
    """
    frame = _read(path)
    for kind in (TabledMean, Mean):
        if {column.name for column in columns(kind) if column.needed} <= set(frame):
            return Means(read_csv(path, kind, AGAIN))
    return Frame(frame)


def read_published(path: Path) -> Published:
    """This run's numbers beside the paper's.

    Raises:
        InputError: the file is missing or broken.
    """
    return Published(read_csv(_there(path), Compared, AGAIN))


def read_stated(path: Path) -> Stated:
    """The estimates of an experiment's versions.

    Raises:
        InputError: the file is missing or broken.
    """
    return Stated(read_csv(_there(path), TabledEstimate, AGAIN))


def read_recordings(path: Path) -> Recordings:
    """What was measured in each recording.

    Raises:
        InputError: the file is missing or broken.
    """
    return Recordings(_read(path))


def read_long(path: Path) -> list[TabledMean]:
    """The long table of an experiment (:mod:`expertaug.evaluation.tabulate`).

    Raises:
        InputError: it is missing or broken.
    """
    return summary.read_long(_there(path), AGAIN)


def _read(path: Path) -> pd.DataFrame:
    try:
        return pd.read_csv(_there(path), dtype={"seeds": str, "refused": str})
    except (OSError, ValueError) as error:
        raise InputError(path, f"is no table ({error})", AGAIN) from error


def _there(path: Path) -> Path:
    if not path.exists():
        raise InputError(path, "no such file", "run the workflow to its end first")
    return path


def main(long: Sequence[TabledMean], job: TabulateJob) -> Table:
    """An experiment's methods by sets and metrics, those that know the form of F_a in a part of their own.

    Arguments:
        long: see :func:`read_long`.
    """
    return main_table(_choose_shown(long), job)


def gains(long: Sequence[TabledMean], job: TabulateJob) -> Table | None:
    """What augmented versions gain over their controls, and their difference from the base model; None of none."""
    return gains_table(_choose_shown(long), job, _leaves_0_out, all_kinds=False)


def gain(mean: TabledMean | None) -> str:
    """A gain over the control with its interval, a star behind one that is told apart from 0; empty where there is
    none."""
    cell = gain_cell(mean, OVER_CONTROL, _leaves_0_out)
    return "" if cell is None else cell.text(star=True)


def choice(long: Sequence[TabledMean], job: TabulateJob) -> Table | None:
    """The version that validation chooses, among the others that it may choose; None where there is no choice."""
    return choice_table(_choose_shown(long), job)


def worst_seeds(long: Sequence[TabledMean], job: TabulateJob) -> Table | None:
    """The worst seed of each version; None where no version has several."""
    return seeds_table(_choose_shown(long), job)


def further(long: Sequence[TabledMean], job: TabulateJob) -> Table:
    """All other metrics, a row for each and each method, a column for each set that is shown."""
    shown = _choose_shown(long)
    return further_table(shown, job, (*tabled_metrics(shown, job.convention), COST.name))


def _choose_shown(long: Sequence[TabledMean]) -> list[TabledMean]:
    return [mean for mean in long if mean.set in SHOWN_SETS]


def _leaves_0_out(difference: Interval) -> bool:
    return difference.low > 0 or difference.high < 0


@dataclass(frozen=True)
class Means(Numbers):
    """A study's means."""

    rows: Sequence[Mean]

    def table(self, reading: Reading, job: ReportJob) -> Table:
        """A row for each metric, set and number of passes, where it has these, a column for each label."""
        metrics = tabled_metrics(self.rows, reading.convention)
        shown = [mean for mean in self.rows if mean.metric in metrics]
        passes = [name for name in ALONG if any(getattr(mean, name) is not None for mean in shown)]
        names, rows = list(dict.fromkeys(mean.label for mean in shown)), []
        values = {(_place(mean), mean.label): mean for mean in shown}
        for place in dict.fromkeys(map(_place, shown)):
            metric, name, *numbers = place
            first = [metric_of(metric).heading(), reading.of_set(name), *map(plain, numbers[: len(passes)])]
            rows.append([*first, *(cell_of(values, (place, label), metric).text() for label in names)])
        head = ["metric", "set", *(name.replace("_", " ") for name in passes)]
        return Table([*head, *names], [("", rows)], len(head))


def _place(mean: Mean) -> tuple[str, str, int | None, int | None]:
    return mean.metric, mean.set, mean.epoch, mean.finetune_epochs


@dataclass(frozen=True)
class Frame(Numbers):
    """The numbers of any other table, as they are in its file."""

    numbers: pd.DataFrame

    def table(self, reading: Reading, job: ReportJob) -> Table:
        """Row by row, averaged over seeds."""
        kept = self.numbers.drop(columns=[c for c in UNSAID if c in self.numbers and "label" in self.numbers])
        kept = kept.dropna(axis="columns", how="all")
        if "seed" in kept:
            kept = _over_seeds(kept)
        if "set" in kept:
            kept["set"] = [reading.of_set(str(name)) for name in kept["set"]]
        texts = [name for name in kept if not pd.api.types.is_numeric_dtype(kept[name])]
        in_order = [*texts, *(name for name in kept if name not in texts)] if "label" in texts else list(kept)
        names = len(texts) if "label" in texts else 1
        head = [HEADS.get(str(name), str(name).replace("_", " ")) for name in in_order]
        rows = [[plain(value) for value in row] for row in kept[in_order].itertuples(index=False)]
        return Table(head, [("", rows)], names)


@dataclass(frozen=True)
class Stated(Numbers):
    """The estimates of an experiment's versions."""

    rows: Sequence[TabledEstimate]

    def table(self, reading: Reading, job: ReportJob) -> Table:
        return estimates.table(self.rows)


@dataclass(frozen=True)
class Published(Numbers):
    """This run's numbers beside the paper's (:mod:`expertaug.evaluation.published`)."""

    rows: Sequence[Compared]

    def table(self, reading: Reading, job: ReportJob) -> Table:
        """Of the methods that were run, a part for each experiment and metric."""
        titles = {experiment.name: experiment.of_experiment(experiment.name) for experiment in job.experiments}
        run, parts = [row for row in self.rows if row.of > 0], []
        for (experiment, metric), part in group_by(run, lambda row: (row.experiment, row.metric)).items():
            digits = int(any(row.published_mean % 1 != 0 for row in part))  # as printed in the paper's table of it
            rows = [
                [
                    row.label,
                    Titles().of_set(row.set),
                    row.published(digits),
                    row.cell().text(),
                    str(row.of),
                    f"{row.p:.3f}",
                    row.verdict,
                ]
                for row in part
            ]
            parts.append((f"{titles.get(experiment, experiment)}: {metric_of(metric).heading()}", rows))
        return Table(["method", "set", "published", "ours", "seeds", "p", "verdict"], parts, 2)


@dataclass(frozen=True)
class Recordings(Numbers):
    """What was measured in each recording."""

    numbers: pd.DataFrame

    def table(self, reading: Reading, job: ReportJob) -> Table:
        """A few columns of many."""
        percent = [name for name in ("tracked_share", "usable_share") if name in self.numbers]
        table = self.numbers.assign(**{name: 100 * self.numbers[name] for name in percent})
        shown = [name for name in RECORDING if name in table]
        rows = [[plain(value) for value in row] for row in table[shown].itertuples(index=False)]
        return Table([RECORDING[name] for name in shown], [("", rows)])


def _over_seeds(table: pd.DataFrame) -> pd.DataFrame:
    """Means over seeds of the rows that differ in nothing else that is no number."""
    keys = [name for name in table if not pd.api.types.is_numeric_dtype(table[name])]
    means = table.drop(columns="seed").groupby(keys, sort=False, dropna=False).mean(numeric_only=True)
    return means.reset_index()[[name for name in table if name != "seed"]]

"""Tables of the page, made of the tidy CSV files of a run: nothing is read from what was printed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd

from expertaug.errors import InputError
from expertaug.evaluation import estimates, summary
from expertaug.evaluation.estimates import TabledEstimate
from expertaug.evaluation.intervals import Interval
from expertaug.evaluation.metrics import COST, metric_of
from expertaug.evaluation.published import Compared
from expertaug.evaluation.settings import Reading, TabulateJob, Titles
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
from expertaug.rows import columns, grouped, read_csv
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


def read(path: Path) -> pd.DataFrame:
    """A CSV file of the run.

    Raises:
        InputError: it is missing or broken.
    """
    try:
        return pd.read_csv(_there(path), dtype={"seeds": str, "refused": str})
    except (OSError, ValueError) as error:
        raise InputError(path, f"is no table ({error})", AGAIN) from error


def read_long(path: Path) -> list[TabledMean]:
    """The long table of an experiment (:mod:`expertaug.evaluation.tabulate`).

    Raises:
        InputError: it is missing or broken.
    """
    return summary.read_long(_there(path), AGAIN)


def _there(path: Path) -> Path:
    if not path.exists():
        raise InputError(path, "no such file", "run the workflow to its end first")
    return path


def main(long: Sequence[TabledMean], job: TabulateJob) -> Table:
    """An experiment's methods by sets and metrics, those that know the form of F_a in a part of their own.

    Arguments:
        long: see :func:`read_long`.
    """
    return main_table(_shown(long), job)


def gains(long: Sequence[TabledMean], job: TabulateJob) -> Table | None:
    """What augmented versions gain over their controls, and their difference from the base model; None of none."""
    return gains_table(_shown(long), job, _leaves_0_out, all_kinds=False)


def gain(mean: TabledMean | None) -> str:
    """A gain over the control with its interval, a star behind one that is told apart from 0; empty where there is
    none."""
    cell = gain_cell(mean, OVER_CONTROL, _leaves_0_out)
    return "" if cell is None else cell.text(star=True)


def choice(long: Sequence[TabledMean], job: TabulateJob) -> Table | None:
    """The version that validation chooses, among the others that it may choose; None where there is no choice."""
    return choice_table(_shown(long), job)


def worst_seeds(long: Sequence[TabledMean], job: TabulateJob) -> Table | None:
    """The worst seed of each version; None where no version has several."""
    return seeds_table(_shown(long), job)


def further(long: Sequence[TabledMean], job: TabulateJob) -> Table:
    """All other metrics, a row for each and each method, a column for each set that is shown."""
    shown = _shown(long)
    return further_table(shown, job, (*tabled_metrics(shown, job.convention), COST.name))


def _shown(long: Sequence[TabledMean]) -> list[TabledMean]:
    return [mean for mean in long if mean.set in SHOWN_SETS]


def _leaves_0_out(difference: Interval) -> bool:
    return difference.low > 0 or difference.high < 0


def by_label(means: Sequence[Mean], reading: Reading) -> Table:
    """A study's means: a row for each metric, set and number of passes, where it has these, a column for each label."""
    metrics = tabled_metrics(means, reading.convention)
    shown = [mean for mean in means if mean.metric in metrics]
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


def of_file(path: Path, reading: Reading) -> Table:
    """The table of any CSV file of the run: means over seeds as such, others row by row, averaged over seeds.

    Raises:
        InputError: the file is missing or broken.
    """
    table = read(path)
    for kind in (TabledMean, Mean):
        if {column.name for column in columns(kind) if column.needed} <= set(table):
            return by_label(read_csv(path, kind, AGAIN), reading)
    kept = table.drop(columns=[c for c in UNSAID if c in table and "label" in table])
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


def stated(path: Path) -> Table:
    """The estimates of an experiment's versions.

    Raises:
        InputError: the file is missing or broken.
    """
    return estimates.table(read_csv(_there(path), TabledEstimate, AGAIN))


def published(path: Path, titles: Mapping[str, str]) -> Table:
    """This run's numbers beside the paper's (:mod:`expertaug.evaluation.published`), of the methods that were run.

    Arguments:
        titles: of the experiments.

    Raises:
        InputError: the file is missing or broken.
    """
    run, parts = [row for row in read_csv(_there(path), Compared, AGAIN) if row.of > 0], []
    for (experiment, metric), part in grouped(run, lambda row: (row.experiment, row.metric)).items():
        digits = int(any(row.published_mean % 1 != 0 for row in part))  # as printed in the paper's table of this metric
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


def recordings(path: Path) -> Table:
    """What was measured in each recording, a few columns of many.

    Raises:
        InputError: the file is missing or broken.
    """
    table = read(path)
    table = table.assign(**{name: 100 * table[name] for name in ("tracked_share", "usable_share") if name in table})
    shown = [name for name in RECORDING if name in table]
    rows = [[plain(value) for value in row] for row in table[shown].itertuples(index=False)]
    return Table([RECORDING[name] for name in shown], [("", rows)])


def _over_seeds(table: pd.DataFrame) -> pd.DataFrame:
    """Means over seeds of the rows that differ in nothing else that is no number."""
    keys = [name for name in table if not pd.api.types.is_numeric_dtype(table[name])]
    means = table.drop(columns="seed").groupby(keys, sort=False, dropna=False).mean(numeric_only=True)
    return means.reset_index()[[name for name in table if name != "seed"]]

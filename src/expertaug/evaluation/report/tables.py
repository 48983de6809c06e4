"""Tables of the page, made of the tidy CSV files of a run: nothing is read from what was printed."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from expertaug.errors import InputError
from expertaug.evaluation.metrics import COST, metric_of
from expertaug.evaluation.settings import Reading, TabulateJob, Titles
from expertaug.evaluation.summary import tabled_metrics
from expertaug.evaluation.table import Cell, Table, plain
from expertaug.evaluation.tabulate import NAMES, OVER_CONTROL, further_table, gain_cell, gains_table, main_table
from expertaug.versions import SHOWN_SETS

SUMMARY = ("metric", "mean", "std", "n", "of")  # columns of a file of means over seeds
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


def read(path: Path) -> pd.DataFrame:
    """A CSV file of the run.

    Raises:
        InputError: it is missing or broken.
    """
    try:
        return pd.read_csv(path, dtype={"seeds": str, "refused": str})
    except FileNotFoundError as error:
        raise InputError(path, "no such file", "run the workflow to its end first") from error
    except (OSError, ValueError) as error:
        raise InputError(path, f"is no table ({error})", "make it again: delete it and run the workflow") from error


def read_long(path: Path) -> pd.DataFrame:
    """The long table of an experiment (:mod:`expertaug.evaluation.tabulate`).

    Raises:
        InputError: it is missing or broken.
    """
    table = read(path)
    if missing := [name for name in (*SUMMARY, "label", "set", "seeds", "low", "high") if name not in table]:
        raise InputError(path, f"no column {missing[0]!r}", "make it again: delete it and run the workflow")
    return table


def main(long: pd.DataFrame, job: TabulateJob) -> Table:
    """An experiment's methods by sets and metrics, those that know the form of F_a in a part of their own.

    Arguments:
        long: see :func:`read_long`.
    """
    return main_table(_shown(long), job)


def gains(long: pd.DataFrame, job: TabulateJob) -> Table | None:
    """What augmented versions gain over their controls, and their difference from the base model; None of none."""
    return gains_table(_shown(long), job, _told_apart, all_kinds=False)


def gain(row: Mapping | None) -> str:
    """A gain over the control with its interval, a star behind one that is told apart from 0; empty where there is
    none."""
    cell = None if row is None else gain_cell(row, OVER_CONTROL, _told_apart(row, OVER_CONTROL))
    return "" if cell is None else cell.text(star=True)


def further(long: pd.DataFrame, job: TabulateJob) -> Table:
    """All other metrics, a row for each and each method, a column for each set that is shown."""
    shown = _shown(long)
    return further_table(shown, job, (*tabled_metrics(shown, job.convention), COST.name))


def _shown(long: pd.DataFrame) -> pd.DataFrame:
    return long[long["set"].isin(SHOWN_SETS)]


def _told_apart(row: Mapping | pd.Series, kind: str) -> bool:
    """Whether the interval of a difference leaves 0 out."""
    low, high = (row.get(f"{NAMES[kind]}_{end}", 0.0) for end in ("low", "high"))
    return bool(low > 0 or high < 0)


def by_label(summary: pd.DataFrame, reading: Reading) -> Table:
    """A study's means: a row for each metric, set and what else its file tells apart, a column for each label."""
    shown = summary[summary["metric"].isin(tabled_metrics(summary, reading.convention))]
    keys = ["metric", "set", *(c for c in shown if c not in (*SUMMARY, *UNSAID, "label", "set"))]
    names, rows = list(dict.fromkeys(shown["label"])), []
    for key, part in shown.groupby(keys, sort=False):
        values = {row["label"]: row for _, row in part.iterrows()}
        first = [metric_of(str(key[0])).heading(), reading.of_set(str(key[1])), *map(plain, key[2:])]
        rows.append([*first, *(Cell.of_row(metric_of(str(key[0])), values.get(name)).text() for name in names)])
    return Table([*(key.replace("_", " ") for key in keys), *names], [("", rows)], len(keys))


def of_file(path: Path, reading: Reading) -> Table:
    """The table of any CSV file of the run: means over seeds as such, others row by row, averaged over seeds.

    Raises:
        InputError: the file is missing or broken.
    """
    table = read(path)
    if set(SUMMARY) <= set(table) and "label" in table:
        return by_label(table, reading)
    kept = table.drop(columns=[c for c in UNSAID if c in table and "label" in table])
    kept = kept.dropna(axis="columns", how="all")
    if "seed" in kept:
        kept = _over_seeds(kept)
    if "set" in kept:
        kept["set"] = [reading.of_set(str(name)) for name in kept["set"]]
    texts = [name for name in kept if not pd.api.types.is_numeric_dtype(kept[name])]
    columns = [*texts, *(name for name in kept if name not in texts)] if "label" in texts else list(kept)
    names = len(texts) if "label" in texts else 1
    head = [name.replace("label", "method").replace("_", " ") for name in columns]
    rows = [[plain(value) for value in row] for row in kept[columns].itertuples(index=False)]
    return Table(head, [("", rows)], names)


def published(path: Path, titles: Mapping[str, str]) -> Table:
    """This run's numbers beside the paper's (:mod:`expertaug.evaluation.published`), of the methods that were run.

    Arguments:
        titles: of the experiments.

    Raises:
        InputError: the file is missing or broken.
    """
    table, parts = read(path), []
    for (experiment, metric), part in table[table["of"] > 0].groupby(["experiment", "metric"], sort=False):
        digits = int((part["published_mean"] % 1 != 0).any())  # as printed in the paper's table of this metric
        rows = [
            [
                row["label"],
                Titles().of_set(row["set"]),
                f"{row['published_mean']:.{digits}f} ± {row['published_std']:.{digits}f}".replace("-", "−"),
                Cell.of_row(metric_of(metric), row).text(),
                str(row["of"]),
                f"{row['p']:.3f}",
                row["verdict"],
            ]
            for _, row in part.iterrows()
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


def by_cell(summary: pd.DataFrame) -> dict[tuple[str, str, str], pd.Series]:
    """Rows of a summary by label, set and metric."""
    return {(row["label"], row["set"], row["metric"]): row for _, row in summary.iterrows()}


def _over_seeds(table: pd.DataFrame) -> pd.DataFrame:
    """Means over seeds of the rows that differ in nothing else that is no number."""
    keys = [name for name in table if not pd.api.types.is_numeric_dtype(table[name])]
    means = table.drop(columns="seed").groupby(keys, sort=False, dropna=False).mean(numeric_only=True)
    return means.reset_index()[[name for name in table if name != "seed"]]

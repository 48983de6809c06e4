"""Metrics of many runs in long format, and their mean and spread over seeds."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from expertaug.errors import InputError
from expertaug.evaluation.metrics import METRICS, Metric, Shown, first_metrics
from expertaug.tracking.metrics_csv import COLUMNS, read_rows
from expertaug.versions import SHOWN_SETS


def read_metrics(paths: Sequence[str | Path], further: Sequence[str] = ()) -> pd.DataFrame:
    """The rows of several metrics.csv in one table; columns as in the files, with ``further`` ones of whole numbers.

    Raises:
        InputError: a file is missing or broken, or two files hold the same value.
    """
    if not paths:
        raise InputError("metrics", "no file", "at least one metrics.csv")
    parts = []
    for path in paths:
        part = pd.DataFrame(read_rows(path, bool(further)))
        parts.append(part[[*COLUMNS, *further]].assign(file=str(path)))
    table = pd.concat(parts, ignore_index=True)
    same = table.duplicated(["experiment", "method", "preset", "seed", "set", "metric", *further])
    if same.any():
        row = table[same].iloc[0]
        what = f"{row['metric']} of {row['label']}, seed {row['seed']}, on {row['set']} is there twice"
        raise InputError(row["file"], what, "give each group of seeds once")
    return table.drop(columns="file")


def summarise(table: pd.DataFrame, further: Sequence[str] = ()) -> pd.DataFrame:
    """Mean and standard deviation (divided by n − 1) over the seeds with a finite value.

    Returns:
        one row per experiment, preset, method, set, metric (and ``further`` columns), with mean, std (NaN for one
        seed), n (finite seeds) and of (all seeds).
    """
    finite = table.assign(value=table["value"].where(np.isfinite(table["value"])))
    keys = ["experiment", "system", "preset", "method", "label", "set", "metric", *further]
    groups = finite.groupby(keys, sort=False)["value"]
    return groups.agg(mean="mean", std="std", n="count", of="size").reset_index()


def labels_of(table: pd.DataFrame) -> dict[str, str]:
    """What is printed for each version of a method."""
    return dict(zip(table["method"], table["label"], strict=True))


def order_sets(sets: Iterable[str]) -> list[str]:
    """Train, validation, IID test, test, then others in order of appearance."""
    known = list(dict.fromkeys(sets))
    return [name for name in SHOWN_SETS if name in known] + [name for name in known if name not in SHOWN_SETS]


def in_domain(sets: Iterable[str]) -> str:
    """The set that says how good a method is in its training's domain: the IID test set, on which nothing was chosen;
    validation where there is none."""
    return "iid" if "iid" in set(sets) else "validation"


def drawn_sets(sets: Iterable[str]) -> list[str]:
    """Sets that figures show, in order: validation only where there is no IID test set."""
    return [name for name in order_sets(sets) if name != "validation" or in_domain(sets) == name]


def shown_metrics(table: pd.DataFrame, convention: str) -> list[str]:
    """The log-MSE in a convention, and the parameters' error where a method estimates any."""
    return first_metrics(table["metric"], convention)


def tabled_metrics(table: pd.DataFrame, convention: str) -> list[str]:
    """Those that figures show, and the share of diverged forecasts where there is any."""
    return [
        *shown_metrics(table, convention),
        *(m.name for m in METRICS if m.shown is Shown.WHERE_ANY and any_of(m, table)),
    ]


def last_columns(table: pd.DataFrame) -> list[tuple[str, str]]:
    """Set and metric of the columns that say what an estimate costs: of the last set that is shown, if any has it."""
    each = [(order_sets(table.loc[table["metric"] == m.name, "set"]), m.name) for m in METRICS if m.shown is Shown.LAST]
    return [(sets[-1], name) for sets, name in each if sets]


def any_of(metric: Metric, table: pd.DataFrame) -> bool:
    """Whether a metric is above 0 anywhere in a summary, as the share of forecasts that diverged."""
    return bool((table.loc[table["metric"] == metric.name, "mean"] > 0).any())

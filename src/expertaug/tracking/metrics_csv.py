"""The long table of one evaluation's metrics, metrics.csv, read back."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

from expertaug import files
from expertaug.errors import InputError
from expertaug.tracking.log import End, Header, Log, Step

COLUMNS = ("experiment", "system", "method", "label", "preset", "seed", "set", "metric", "value")


def read_rows(path: str | Path) -> list[dict[str, str]]:
    """Rows of a long metrics.csv, checked: every column is there, seed and value are numbers (an empty value is nan).

    Raises:
        InputError: the file is missing, empty or broken.
    """
    try:
        with Path(path).open(encoding="utf-8", newline="") as stream:
            rows = list(csv.DictReader(stream))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(path, f"cannot be read ({error})", "make it again with evaluate") from error
    if not rows:
        raise InputError(path, "no rows", "make it again with evaluate")
    for index, row in enumerate(rows, 2):
        if missing := [name for name in COLUMNS if row.get(name) is None]:
            raise InputError(path, f"line {index} has no {missing[0]!r}", f"columns {', '.join(COLUMNS)}")
        try:
            int(row["seed"]), float(row["value"] or "nan")
        except ValueError as error:
            raise InputError(path, f"line {index}: {error}", "seed and value are numbers") from error
        row["value"] = row["value"] or "nan"
    return rows


def metrics_by_seed(path: str | Path, seeds: Sequence[int]) -> dict[str, list[float]]:
    """A long metrics.csv as ``set/metric`` → one number per seed.

    Raises:
        InputError: the file is missing or broken, or a metric lacks a seed.
    """
    by_name: dict[str, dict[int, float]] = {}
    for row in read_rows(path):
        by_name.setdefault(f"{row['set']}/{row['metric']}", {})[int(row["seed"])] = float(row["value"])
    for name, values in by_name.items():
        if set(values) != set(seeds):
            raise InputError(path, f"{name} has seeds {sorted(values)}", f"one row for each of {list(seeds)}")
    return {name: [values[seed] for seed in seeds] for name, values in by_name.items()}


def log_of_table(path: Path) -> Log:
    """The log that the evaluation would have written, made from its table alone."""
    rows = read_rows(path)
    made = path.stat().st_mtime
    seeds = tuple(dict.fromkeys(int(row["seed"]) for row in rows))
    identity = {name: rows[0][name] for name in ("experiment", "method", "label", "system", "preset")}
    header = Header(**identity, stage="evaluate", seeds=seeds, params={}, id=files.sha256(path)[:32], time=made)
    step = Step(step=0, time=made, **metrics_by_seed(path, seeds))
    return Log(header, (step, End(time=made, status="FINISHED")))

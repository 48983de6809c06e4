"""The long table of one evaluation's metrics, metrics.csv: one row, its writer and its reader."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from expertaug import files
from expertaug.errors import InputError
from expertaug.tracking.log import End, Header, Log, Step

REMEDY = "make it again with evaluate"
COLUMNS = ("experiment", "system", "method", "label", "preset", "seed", "set", "metric", "value")
ALONG = ("epoch", "finetune_epochs")  # further columns of a study during training


@dataclass(frozen=True)
class MetricRow:
    """A metric of a seed on a set.

    Attributes:
        experiment, system, method, label, preset: whose; ``method`` names the version, ``label`` is what is printed.
        value: NaN where there is none.
        epoch, finetune_epochs: of a study during training: passes of training, and of fine-tuning.
    """

    experiment: str
    system: str
    method: str
    label: str
    preset: str
    seed: int
    set: str
    metric: str
    value: float
    epoch: int | None = None
    finetune_epochs: int | None = None


def write_rows(path: Path, rows: Sequence[MetricRow]) -> None:
    """Write a metrics.csv; nothing stands for a number that is none."""
    columns = (*COLUMNS, *(name for name in ALONG if any(getattr(row, name) is not None for row in rows)))
    with files.atomic(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as stream:
        table = csv.writer(stream, lineterminator="\n")
        table.writerow(columns)
        for row in rows:
            cells = {name: getattr(row, name) for name in columns}
            table.writerow((cells | ({"value": ""} if math.isnan(row.value) else {})).values())


def read_rows(path: str | Path, along: bool = False) -> list[MetricRow]:
    """Rows of a metrics.csv, checked: every column is there, seed and value are numbers (an empty value is NaN).

    Arguments:
        along: whether it is of a study during training, and has its columns.

    Raises:
        InputError: the file is missing, empty or broken.
    """
    try:
        with Path(path).open(encoding="utf-8", newline="") as stream:
            table = csv.DictReader(stream)
            lines = list(table)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(path, f"cannot be read ({error})", REMEDY) from error
    if not lines:
        raise InputError(path, "no rows", REMEDY)
    if along and (missing := [name for name in ALONG if name not in lines[0]]):
        raise InputError(path, f"no column {missing[0]!r}", "make it again with its stage")
    return [_row(path, number, line, along) for number, line in enumerate(lines, 2)]


def _row(path: str | Path, number: int, line: dict[str, str], along: bool) -> MetricRow:
    if missing := [name for name in COLUMNS if line.get(name) is None]:
        raise InputError(path, f"line {number} has no {missing[0]!r}", f"columns {', '.join(COLUMNS)}")
    texts = {name: line[name] for name in COLUMNS if name not in ("seed", "value")}
    try:
        further = {name: int(line[name]) for name in ALONG} if along else {}
        return MetricRow(**texts, seed=int(line["seed"]), value=float(line["value"] or "nan"), **further)
    except ValueError as error:
        raise InputError(path, f"line {number}: {error}", "seed and value are numbers") from error


def metrics_by_seed(path: str | Path, seeds: Sequence[int]) -> dict[str, list[float]]:
    """A metrics.csv as ``set/metric`` → one number per seed.

    Raises:
        InputError: the file is missing or broken, or a metric lacks a seed.
    """
    return _by_seed(path, read_rows(path), seeds)


def log_of_table(path: Path) -> Log:
    """The log that the evaluation would have written, made from its table alone."""
    rows = read_rows(path)
    made, first = path.stat().st_mtime, rows[0]
    seeds = tuple(dict.fromkeys(row.seed for row in rows))
    identity = {name: getattr(first, name) for name in ("experiment", "method", "label", "system", "preset")}
    header = Header(**identity, stage="evaluate", seeds=seeds, params={}, id=files.sha256(path)[:32], time=made)
    step = Step(step=0, time=made, **_by_seed(path, rows, seeds))
    return Log(header, (step, End(time=made, status="FINISHED")))


def _by_seed(path: str | Path, rows: Iterable[MetricRow], seeds: Sequence[int]) -> dict[str, list[float]]:
    by_name: dict[str, dict[int, float]] = {}
    for row in rows:
        by_name.setdefault(f"{row.set}/{row.metric}", {})[row.seed] = row.value
    for name, values in by_name.items():
        if set(values) != set(seeds):
            raise InputError(path, f"{name} has seeds {sorted(values)}", f"one row for each of {list(seeds)}")
    return {name: [values[seed] for seed in seeds] for name, values in by_name.items()}

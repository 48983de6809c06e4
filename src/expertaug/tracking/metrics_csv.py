"""The long table of one evaluation's metrics, metrics.csv: one row, and its reader."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from expertaug import files
from expertaug.errors import InputError
from expertaug.rows import read_csv
from expertaug.tracking.log import End, Header, Log, Step

REMEDY = "make it again with evaluate"
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


def read_rows(path: str | Path, along: bool = False) -> list[MetricRow]:
    """Rows of a metrics.csv, checked: every column is there, seed and value are numbers (an empty value is NaN).

    Arguments:
        along: whether it is of a study during training, and has its columns.

    Raises:
        InputError: the file is missing, empty or broken.
    """
    rows = read_csv(path, MetricRow, REMEDY)
    if along and (missing := [name for name in ALONG if any(getattr(row, name) is None for row in rows)]):
        raise InputError(path, f"no column {missing[0]!r}", "make it again with its stage")
    return rows


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

"""The JSON lines of a run log, read back; and the lines that a table of metrics stands for."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from expertaug import files
from expertaug.errors import InputError

HEADER = ("id", "time", "experiment", "method", "label", "system", "preset", "stage", "seeds", "params", "tags")
COLUMNS = ("experiment", "system", "method", "label", "preset", "seed", "set", "metric", "value")


@dataclass(frozen=True)
class Log:
    """What a run log holds: its header and every complete line after it."""

    header: dict[str, Any]
    lines: list[dict[str, Any]] = field(default_factory=list)

    @property
    def steps(self) -> list[dict[str, Any]]:
        """The lines that hold metrics."""
        return [line for line in self.lines if "event" not in line]


def read_log(path: str | Path) -> Log:
    """Read a run log; a last line that a kill left incomplete is ignored.

    Raises:
        InputError: the file is missing, is no run log, or a line inside it is broken.
    """
    try:
        raw = Path(path).read_bytes().split(b"\n")[:-1]
    except OSError as error:
        raise InputError(path, f"cannot be read ({error.strerror})", "run the stage that makes it") from error
    lines = []
    for row, text in enumerate(raw, 1):
        try:
            line = json.loads(text)
        except ValueError as error:
            raise InputError(path, f"line {row} is not JSON", "make the log again with its stage") from error
        if not isinstance(line, dict):
            raise InputError(path, f"line {row} is no JSON object", "make the log again with its stage")
        lines.append(line)
    missing = [key for key in HEADER if not lines or key not in lines[0]]
    if missing:
        raise InputError(path, f"the header has no {missing[0]!r}", "give a log that a training wrote")
    for line in lines[1:]:
        if line.get("event") == "runs":
            lines[0] |= {"runs": line["runs"], "parent": line["parent"]}
    return Log(lines[0], lines[1:])


def log_of_table(path: Path) -> Log:
    """The log that the evaluation would have written, made from its table (metrics.csv) alone."""
    rows = read_rows(path)
    made = path.stat().st_mtime
    seeds = list(dict.fromkeys(int(row["seed"]) for row in rows))
    fields = {name: rows[0][name] for name in ("experiment", "method", "label", "system", "preset")}
    header = {"id": files.sha256(path)[:32], "time": made, **fields, "stage": "evaluate"}
    header |= {"seeds": seeds, "params": {}, "tags": {}}
    end = {"event": "end", "time": made, "status": "FINISHED"}
    return Log(header, [{"step": 0, "time": made, **table_metrics(path, seeds)}, end])


def table_metrics(path: str | Path, seeds: Sequence[int]) -> dict[str, list[float | str]]:
    """A long metrics.csv as ``set/metric`` → one number per seed.

    Raises:
        InputError: the file is missing or broken, or a metric lacks a seed.
    """
    found: dict[str, dict[int, float | str]] = {}
    for row in read_rows(path):
        found.setdefault(f"{row['set']}/{row['metric']}", {})[int(row["seed"])] = number(row["value"])
    for name, values in found.items():
        if set(values) != set(seeds):
            raise InputError(path, f"{name} has seeds {sorted(values)}", f"one row for each of {list(seeds)}")
    return {name: [values[seed] for seed in seeds] for name, values in found.items()}


def number(value: Any) -> float | str:
    """A number as JSON holds it: non-finite ones as text that ``float`` reads."""
    value = float(value)
    return value if math.isfinite(value) else str(value)


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

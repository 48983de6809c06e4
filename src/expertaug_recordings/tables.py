"""The tables of a recording, markers.csv and angles.csv: their columns, and reading them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from expertaug.errors import InputError

PLACES = ("pivot_x", "pivot_y", "joint_x", "joint_y", "tip_x", "tip_y")  # columns of markers.csv: px, x right, y down
MARKERS = ("frame", "t", *PLACES, "quality", "reason")  # all of them
BLENDED = "blended"  # reason of a frame in which a moving marker is seen twice
LARGEST = 1e12  # of any number: its powers must not overflow
ALWAYS_KNOWN = ("frame", "t", "quality")  # columns in which no cell may be empty


def read_table(
    path: str | Path, numbers: Sequence[str], texts: Sequence[str] = (), made_by: str = "measure_angles"
) -> pd.DataFrame:
    """Columns of a table.

    Arguments:
        path: CSV with a header.
        numbers: columns to read as float64 (``frame`` as int64); NaN where a cell is empty.
        texts: columns to read as texts; empty where a cell is.
        made_by: the stage that makes the table.

    Raises:
        InputError: the file is missing or no table, or lacks a column, or a cell holds no number that can be used; with
            row (the header is the first) and column.
    """
    wanted = (*numbers, *texts)
    try:
        table = pd.read_csv(path, usecols=lambda name: name in wanted, dtype=dict.fromkeys(texts, str), index_col=False)
    except FileNotFoundError as error:
        raise InputError(path, "no such file", f"run {made_by}") from error
    except (ValueError, OSError, OverflowError) as error:
        raise InputError(path, f"not a table ({error})", f"run {made_by} again") from error
    if missing := [name for name in wanted if name not in table]:
        raise InputError(path, f"column {missing[0]} is missing", f"expected {','.join(wanted)}")
    for name in numbers:
        table[name] = _numbers(path, table[name], name)
    for name in texts:
        table[name] = table[name].fillna("").astype(object)
    return table


def _numbers(path: str | Path, column: pd.Series, name: str) -> np.ndarray:
    kind = np.int64 if name == "frame" else np.float64
    if column.dtype.kind not in "iuf":
        values = pd.to_numeric(column.astype(str).where(column.notna()), errors="coerce").astype(float)
        _refuse(path, column, name, (values.isna() & column.notna()).to_numpy(), "is no number")
    else:
        values = column.astype(float)
    values = values.to_numpy()
    if name in ALWAYS_KNOWN:
        _refuse(path, column, name, np.isnan(values), "is no number")
    _refuse(path, column, name, np.abs(values) > LARGEST, "is out of range")
    if name == "frame":
        _refuse(path, column, name, values != np.rint(values), "is no frame's number")
    return values.astype(kind)


def _refuse(path: str | Path, column: pd.Series, name: str, bad: np.ndarray, why: str) -> None:
    if bad.any():
        row = int(np.argmax(bad))
        cell = "" if pd.isna(column.iloc[row]) else column.iloc[row]
        raise InputError(path, f"row {row + 2}, column {name}: '{cell}' {why}", "expected numbers")

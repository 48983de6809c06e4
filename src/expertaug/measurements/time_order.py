"""Times that are not what they would be taken for: that go back, or that count something else than seconds.

Rows that are merely out of order may be sorted, times that begin anew never.

Sorting the rows of several experiments, sensors or days that follow each other in one table mixes them, and a mean over
rows of one time then averages what was never measured together.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

import numpy as np

from expertaug.errors import InputError
from expertaug.measurements.table import Table

NEARBY = 5  # steps back, at most, of a row that is merely out of order
PIECE = 4  # rows that follow each other in time between two steps back, in the mean: of shuffled rows fewer
KINDS = 200  # of rows of one time, told apart by a column, at most
SINCE_1970 = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}
EPOCH = (6e8, 4.1e9)  # from 1989 to 2099, in s since 1970
SERIAL, SERIAL_STEP = (32874.0, 73050.0), 1e-3  # the same years in a spreadsheet's days, and 86 s of such
OF_TIME = re.compile(r"\b(date|day|datum|tag)\b", re.IGNORECASE)  # a column that is a part of the time itself
REMEDY = (
    "name the column that tells trajectories apart (--trajectory) or save a file for each; where it is one trajectory, "
    "join date and time in one column, or unwrap the counter or clock"
)


def check_sortable(table: Table, t: np.ndarray, groups: Iterable[np.ndarray]) -> None:
    """Refuse times that begin anew.

    Arguments:
        t: times (n,) of the table's rows in s, NaN where there is none.
        groups: rows of each trajectory, in the table's order.

    Raises:
        InputError: the times of a trajectory go back otherwise than rows out of order do: at which row, by how much.
    """
    for group in groups:
        rows = group[np.isfinite(t[group])]
        steps = np.diff(t[rows])
        back = np.flatnonzero(steps < 0)
        if not len(back) or len(rows) < PIECE * (len(back) + 1):
            # Nothing goes back, or rows are shuffled (or the last comes first); what then has one time is not averaged.
            if len(back) and len(np.unique(t[rows])) < len(rows):
                raise InputError(table.path, "times go back and come again", REMEDY)
            continue
        if (-steps[back]).max() <= NEARBY * np.median(np.abs(steps[steps != 0])):
            continue
        first = back[np.argmax(-steps[back])]
        ends = f"from {t[rows[first]]:.6g} to {t[rows[first + 1]]:.6g} s"
        jump = f"row {table.line[rows[first + 1]]}: the time goes back by {-steps[first]:.6g} s, {ends}"
        raise InputError(table.path, f"{jump}, as if {len(back) + 1} trajectories followed each other", REMEDY)


def check_one_row_a_time(table: Table, t: np.ndarray, used: Iterable[str]) -> None:
    """Refuse a table with a row for each time and sensor: rows of one time that a further column tells apart.

    Arguments:
        used: columns that have a meaning already.

    Raises:
        InputError: such a column is there; it is named.
    """
    rows = np.flatnonzero(np.isfinite(t))
    times, counts = np.unique(t[rows], return_counts=True)
    taken = set(used)
    for name in (n for n in table.names if n not in taken and not OF_TIME.search(n)):
        texts = table.texts(name)[rows]
        kinds = len(set(texts.tolist()))
        pairs = len(set(zip(t[rows].tolist(), texts.tolist(), strict=True)))
        if 1 < kinds <= min(KINDS, len(times)) and pairs == len(rows) and counts.max() > 1:
            found = f"column '{name}' tells up to {counts.max()} rows of one time apart"
            remedy = (
                f"give each '{name}' a column of its own (a pivot), or name it as --trajectory if they are trajectories"
            )
            raise InputError(table.path, found, remedy)


def check_seconds(table: Table, name: str, t: np.ndarray) -> None:
    """Refuse numbers without a unit that are a moment in time, counted otherwise than in seconds.

    Arguments:
        name: the column of times.
        t: its numbers (n,).

    Raises:
        InputError: they count milli-, micro- or nanoseconds since 1970, are days of a spreadsheet, or dates.
    """
    values = t[np.isfinite(t)]
    if not len(values):
        return
    first, steps = float(values[0]), np.abs(np.diff(values))
    step = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    epoch = next((unit for unit, factor in SINCE_1970.items() if EPOCH[0] <= first * factor <= EPOCH[1]), None)
    if epoch is not None:
        found, unit = f"starts at {first:.15g} without a unit, as if it counted {epoch} since 1970", epoch
    elif SERIAL[0] <= first <= SERIAL[1] and 0 < step < SERIAL_STEP:
        found, unit = (
            f"starts at {first:.10g} and goes on in steps of {step:.3g} without a unit, as a spreadsheet's days do",
            "d",
        )
    elif (values == values.round()).all() and all(_is_date(value) for value in values[[0, -1]].astype(int)):
        found = f"starts at {first:.0f}, as if it held dates (yyyymmdd)"
        raise InputError(table.path, f"column '{name}' {found}", "write them as 2024-05-31")
    else:
        return
    raise InputError(table.path, f"column '{name}' {found}", f"say which unit it is: --unit '{name}={unit}' (or s)")


def _is_date(value: int) -> bool:
    """Whether a whole number is a date yyyymmdd of this century or the last."""
    return 1900 <= value // 10000 <= 2100 and 1 <= value // 100 % 100 <= 12 and 1 <= value % 100 <= 31

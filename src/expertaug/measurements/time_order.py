"""Times that are not what they would be taken for: that go back, or that count something else than seconds.

Rows that are merely out of order may be sorted, times that begin anew never.

Sorting the rows of several experiments, sensors or days that follow each other in one table mixes them, and a mean over
rows of one time then averages what was never measured together.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable

import numpy as np

from expertaug.errors import InputError
from expertaug.measurements.table import Table

FAR_APART = 0.1  # of a column's standard deviation
SHARED = 0.2  # of the times have several rows, above which these are not single repeats
NEARBY = 5  # steps back, at most, of a row that is merely out of order
PIECE = 4  # rows that follow each other in time between two steps back, in the mean: of shuffled rows fewer
KINDS = 200  # of rows of one time, told apart by a column, at most
SINCE_1970 = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}
EPOCH = (6e8, 4.1e9)  # from 1989 to 2099, in s since 1970
# The same years in days, and 86 s of such.
SERIALS = {
    "a spreadsheet's": (32874.0, 73050.0),
    "MATLAB's": (726834.0, 767011.0),
    "Julian": (2447892.0, 2488070.0),
}
SERIAL_STEP = 1e-3
DAY = 86400
COUNTERS = {"frame", "frames", "index", "row", "rows", "sample", "samples", "count", "counter", "tick", "ticks"}
OF_TIME = re.compile(r"\b(date|day|datum|tag)\b", re.IGNORECASE)  # a column that is a part of the time itself
REMEDY = (
    "name the column that tells trajectories apart (trajectory; inspect-data: --trajectory) or save a file for "
    "each; where it is one trajectory, join date and time in one column, or unwrap the counter or clock"
)


def check_sortable(table: Table, t: np.ndarray, groups: Iterable[np.ndarray], apart: bool = False) -> None:
    """Refuse times that begin anew, or whose clock was set back.

    Arguments:
        t: times (n,) of the table's rows in s, NaN where there is none.
        groups: rows of each trajectory, in the table's order.
        apart: whether pieces that do not overlap in time may be put in order, as somebody asks for.

    Raises:
        InputError: the times of a trajectory go back otherwise than rows out of order do: at which row, by how much.
    """
    for group in groups:
        rows = group[np.isfinite(t[group])]
        steps = np.diff(t[rows])
        back = np.flatnonzero(steps < 0)
        if apart and not _overlap(t[rows], back):
            continue
        if not len(back) or len(rows) < PIECE * (len(back) + 1):
            # Nothing goes back, or rows are shuffled (or the last comes first); what then has one time is not averaged.
            if len(back) and len(np.unique(t[rows])) < len(rows):
                raise InputError(table.path, "times go back and come again", REMEDY)
            continue
        usual = float(np.median(np.abs(steps[steps != 0])))
        if (-steps[back]).max() <= NEARBY * usual and not any(_is_crowded(t[rows], k, usual) for k in back):
            continue
        first = back[np.argmax(-steps[back])]
        ends = f"from {t[rows[first]]:.6g} to {t[rows[first + 1]]:.6g} s"
        jump = f"row {table.line[rows[first + 1]]}: the time goes back by {-steps[first]:.6g} s, {ends}"
        raise InputError(table.path, f"{jump}, as if {len(back) + 1} trajectories followed each other", REMEDY)


def _overlap(t: np.ndarray, back: np.ndarray) -> bool:
    """Whether pieces of times (n,), which end where these go back, lie within one another."""
    pieces = sorted((piece.min(), piece.max()) for piece in np.split(t, back + 1) if len(piece))
    return any(later[0] <= earlier[1] for earlier, later in itertools.pairwise(pieces))


def _is_crowded(t: np.ndarray, k: int, usual: float) -> bool:
    """Whether more rows than usual lie between two times of which the second goes back: the clock was set back, and no
    row came late."""
    near = t[max(0, k - 4 * NEARBY) : k + 4 * NEARBY + 2]
    between = int(((near >= t[k + 1]) & (near <= t[k])).sum())
    return between > 1.5 * ((t[k] - t[k + 1]) / usual + 1)


def check_repeats(table: Table, t: np.ndarray, columns: Iterable[np.ndarray]) -> None:
    """Refuse to average the rows of one time where many times have several that are far apart: they were not measured
    at one moment, or not of one thing.

    Arguments:
        t: times (n,) of the rows of a table in s.
        columns: numbers (n,) of each.

    Raises:
        InputError: how many rows a time has.
    """
    times, moment, counts = np.unique(t[np.isfinite(t)], return_inverse=True, return_counts=True)
    if len(times) < 2 or (counts > 1).mean() <= SHARED:
        return
    for values in columns:
        present = np.isfinite(values[np.isfinite(t)])
        y, of = values[np.isfinite(t)][present], moment[present]
        total, number = (np.bincount(of, weights, len(times)) for weights in (y, np.ones(len(y))))
        within = np.sqrt(np.mean(np.square(y - (total / np.maximum(number, 1))[of]))) if len(y) else 0.0
        if within <= FAR_APART * np.std(y):
            continue
        problem = f"{np.mean(counts):.3g} rows have the same time in the mean, and differ"
        remedy = "give finer times, or name the column that tells trajectories apart (--trajectory); where they are "
        raise InputError(table.path, problem, f"{remedy}repeated measurements of one moment: --set duplicates=mean")


def check_one_row_a_time(table: Table, t: np.ndarray, used: Iterable[str]) -> None:
    """Refuse a table with a row for each time and sensor: rows of one time that a further column tells apart.

    Arguments:
        used: columns that have a meaning already.

    Raises:
        InputError: such a column is there; it is named.
    """
    rows = np.flatnonzero(np.isfinite(t))
    times, moment, counts = np.unique(t[rows], return_inverse=True, return_counts=True)
    taken = set(used)
    for name in (n for n in table.names if n not in taken and not OF_TIME.search(n)):
        kind = table.kinds(name).of_row[rows]
        kinds = len(np.unique(kind))
        pairs = len(np.unique(moment * len(table) + kind))
        if 1 < kinds <= min(KINDS, len(times)) and pairs == len(rows) and counts.max() > 1:
            problem = f"column '{name}' tells up to {counts.max()} rows of one time apart"
            remedy = (
                f"give each '{name}' a column of its own (a pivot), or name it as --trajectory if they are trajectories"
            )
            raise InputError(table.path, problem, remedy)


def check_seconds(table: Table, name: str, t: np.ndarray) -> None:
    """Refuse numbers without a unit that are a moment in time, counted otherwise than in seconds.

    Arguments:
        name: the column of times.
        t: its numbers (n,).

    Raises:
        InputError: they count milli-, micro- or nanoseconds since 1970, days, rows, or are dates or times of day.
    """
    values = t[np.isfinite(t)]
    if not len(values):
        return
    first, steps, whole = float(values[0]), np.abs(np.diff(values)), bool((values == values.round()).all())
    step = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    epoch = is_since_1970(first)
    if whole and (pattern := _find_format(values)) is not None:
        problem = f"starts at {first:.0f}, as if it held {'dates' if 'y' in pattern else 'times of day'} ({pattern})"
        raise InputError(table.path, f"column '{name}' {problem}", "write them as 2024-05-31 10:59:50")
    if epoch is not None:
        problem, unit = f"starts at {first:.15g} without a unit, as if it counted {epoch} since 1970", epoch
    elif (of := _days_of(first)) and (step < SERIAL_STEP or _is_part_of_day(step) or OF_TIME.search(name)):
        problem, unit = (
            f"starts at {first:.10g} and goes on in steps of {step:.3g} without a unit, as {of} days do",
            "d",
        )
    elif values.min() >= 0 and values.max() <= 2 and _is_part_of_day(step):
        problem, unit = f"goes on in steps of {step:.6g} without a unit, {step * DAY:.3g} s of a day", "d"
    elif whole and step == 1 and COUNTERS & set(re.split(r"[\W_\d]+", name.lower())):
        problem = "counts rows, as its name and its steps of 1 say"
        remedy = f"give times; or a step in s, as time: {{name: {name}, factor: 0.02}} in data.files"
        raise InputError(table.path, f"column '{name}' {problem}", f"{remedy}; where it is a second, unit: s")
    else:
        return
    remedy = f"time: {{name: {name}, unit: {unit}}} in data.files (inspect-data: --unit '{name}={unit}')"
    raise InputError(table.path, f"column '{name}' {problem}", f"say which unit it is, {unit} or s: {remedy}")


def _days_of(value: float) -> str | None:
    """Whose days a number may be, from 1990 to 2099; None of others."""
    return next((of for of, (low, high) in SERIALS.items() if low <= value <= high), None)


def is_since_1970(value: float) -> str | None:
    """What a number counts since 1970, ms, us or ns, if it lies in those years; None of others."""
    return next((unit for unit, factor in SINCE_1970.items() if EPOCH[0] <= value * factor <= EPOCH[1]), None)


def _is_part_of_day(step: float) -> bool:
    """Whether a step is a whole number of seconds as a part of a day, and not a decimal number such as 0.01."""
    seconds = step * DAY
    whole = round(seconds)
    return 1 <= whole <= DAY // 2 and abs(seconds - whole) < 1e-2 and abs(step / float(f"{step:.2g}") - 1) > 1e-4


def _find_format(values: np.ndarray) -> str | None:
    """How whole numbers (n,) may be dates or times of day; None of others."""
    ends = [int(value) for value in values[[0, -1]]]
    for pattern, clock in (("yyyymmdd", 1), ("yyyymmddhhmm", 10**4), ("yyyymmddhhmmss", 10**6)):
        if all(_is_date(value // clock) and (clock == 1 or _is_clock(value % clock, clock)) for value in ends):
            return pattern
    jumps = np.diff(values)  # from 10:00:59 to 10:01:00, and from 10:59:59 to 11:00:00
    of_day = values.min() >= 0 and values.max() < 240000 and bool(((jumps == 41) | (jumps == 4041)).any())
    return "hhmmss" if of_day and all(_is_clock(int(value), 10**6) for value in values) else None


def _is_date(value: int) -> bool:
    """Whether a whole number is a date yyyymmdd of this century or the last."""
    return 1900 <= value // 10000 <= 2100 and 1 <= value // 100 % 100 <= 12 and 1 <= value % 100 <= 31


def _is_clock(value: int, of: int) -> bool:
    """Whether a whole number is a time of day hhmmss, or hhmm (of 10⁴)."""
    parts = (value // 100, value % 100) if of == 10**4 else (value // 10000, value // 100 % 100, value % 100)
    return parts[0] < 24 and max(parts[1:]) < 60

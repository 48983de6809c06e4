"""What the numbers of a column tell of its sensor: its resolution, marks for nothing measured, turns, saturation."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from expertaug.errors import InputError
from expertaug.measurements.table import Table

# Numbers that stand for nothing measured: of nines (999, -9999.9) and the like, ends of integers, fill values.
MARK = re.compile(r"-?(9{2,}(\.9+)?|999\.25|8{3,}|7{3,}|32767|32768|65535|2147483647|2147483648)")
HUGE = 1e20
MOST_MARKS = 3  # of one column
REPEATED = 3  # rows with one value far from all others that are no coincidence
LEVELS = 20  # different values, below which a column's extremes say nothing
ROUNDING = 1e-6  # of a column's range: differences below are none
COUNTS = (*(2.0**bits for bits in range(8, 33)), 1.0, 100.0, 400.0, 1e3, 3600.0, 1e4, 36000.0)  # of one turn
STILL = 0.2  # share of the rows that are as the one before
STUCK = 5  # rows in succession at one end of a sensor's range
FROZEN = 10  # rows of one number that are no chance where hardly any others repeat
RARELY, MOSTLY = 0.05, 0.8  # share of the rows that repeat by chance, and of the readings that are held equally long
SPIKE, SPIKES = 5.0, 0.05  # times what lies beside it, and four times that of what is usual; share of the rows
CROWDED = 4  # times as many rows as at the level beside it


class Marked(InputError):
    """A column has numbers that stand for nothing measured.

    Attributes:
        marks: these, and the column of each.
    """

    def __init__(self, path: Path, line: int, marks: Mapping[float, str]) -> None:
        self.marks = dict(marks)
        mark, name = next(iter(self.marks.items()))
        listed = ", ".join(f"{number:.10g}" for number in self.marks)
        problem = f"row {line}, column {name}: {mark:.10g} is far from all others, as what stands for nothing measured"
        super().__init__(path, problem, f"set data.files.missing to [{listed}], or to [] where it was measured")


def check_marks(table: Table, columns: Iterable[str]) -> None:
    """Refuse numbers that stand for nothing measured, where ``missing`` says nothing.

    Raises:
        Marked: there are some.
    """
    marks: dict[float, str] = {}
    line = 0
    for name in columns if table.keys.missing is None else ():
        values = table.mostly(name)
        for mark in marks_of_nothing(values) if values is not None else ():
            line = line or int(table.line[np.argmax(values == mark)])
            marks.setdefault(mark, name)
    if marks:
        raise Marked(table.path, line, marks)


def marks_of_nothing(values: np.ndarray) -> list[float]:
    """Numbers (n,) that stand far from all others, and either look as what loggers write where nothing was measured or
    come several times."""
    rest, marks = np.sort(values[np.isfinite(values)]), []
    for _ in range(MOST_MARKS):
        for end in (rest[-1], rest[0]) if len(rest) else ():
            others = rest[rest != end]
            looks = bool(MARK.fullmatch(f"{end:.10g}")) or abs(end) >= HUGE
            if len(others) < 2 or not (looks or _comes_again(end, rest, others)):
                continue
            far = 1 if looks and abs(end) >= 999 else 2  # times the range of the others
            if np.abs(others - end).min() > far * (others[-1] - others[0]) > 0:
                marks.append(float(end))
                rest = others
                break
        else:
            break
    return marks


def _comes_again(end: float, rest: np.ndarray, others: np.ndarray) -> bool:
    """Whether a value is that of several rows, of few beside the others, which have many."""
    count = len(rest) - len(others)
    return REPEATED <= count < len(others) and len(np.unique(others)) >= LEVELS


def resolution(values: np.ndarray) -> float | None:
    """The step q of which all differences of numbers (n,) are multiples, or None."""
    levels = np.unique(values[np.isfinite(values)])
    if len(levels) < 2:
        return None
    steps = np.diff(levels)
    steps = steps[steps > ROUNDING * (levels[-1] - levels[0])]
    q = float(steps.min())
    counts = (levels - levels[0]) / q
    counts = counts[counts < 1e4]  # further away q is not known well enough
    if np.abs(counts - np.rint(counts)).max() > 0.02:
        return None
    return float((levels[-1] - levels[0]) / round((levels[-1] - levels[0]) / q))


def last_digit(values: np.ndarray) -> float | None:
    """The place of the last digit, such as 0.001, with which numbers (n,) are written; None of finer ones."""
    finite = values[np.isfinite(values)]
    for places in range(7):
        counts = finite * 10.0**places
        if np.abs(counts - np.rint(counts)).max(initial=0.0) < 1e-3:
            return 10.0**-places
    return None


def stands_still(values: np.ndarray) -> bool:
    """Whether numbers (n,) often stay the same from row to row, as those of a coarse sensor do and noisy ones do not:
    how rough they are then says nothing of their noise."""
    finite = values[np.isfinite(values)]
    return len(finite) > 1 and bool((np.diff(finite) == 0).mean() > STILL and np.ptp(finite) > 0)


def jumps_by_turns(series: Sequence[np.ndarray], turn: float = 2 * math.pi) -> bool:
    """Whether an angle's numbers, (n,) of each trajectory, stay within one turn and jump from one end to the other."""
    finite = [values[np.isfinite(values)] for values in series]
    within = [
        values for values in finite if len(values) and np.ptp(values) <= 1.01 * turn
    ]  # of others somebody took them out
    steps = np.abs(np.concatenate([np.zeros(0), *(np.diff(values) for values in within)])) / turn
    return bool((steps > 0.7).any() and not ((steps > 0.35) & (steps < 0.7)).any())


def starts_again_at(series: Sequence[np.ndarray]) -> float | None:
    """At how many counts a counter's numbers, (n,) of each trajectory, start again; None of others."""
    several = [len(np.unique(values[np.isfinite(values)])) for values in series]
    if max(several, default=0) < LEVELS:  # on and off
        return None
    return next((counts for counts in COUNTS if jumps_by_turns(series, counts)), None)


def rows_stuck(values: np.ndarray) -> tuple[int, float] | None:
    """Where numbers (n,) stick at their largest or least value, as a sensor's do beyond its range: the longest time in
    rows, and the value.

    A smooth motion turns at its extremes and stays there a little longer than elsewhere, even as a coarse sensor sees
    it; one that is cut off stays far longer.
    """
    finite = values[np.isfinite(values)]
    levels = np.unique(finite)
    if len(levels) < LEVELS:
        return None
    width = max(0.01 * np.ptp(levels), 1.5 * float(np.median(np.diff(levels))))
    for end in (levels[-1], levels[0]):
        at = finite == end
        beside = int(((np.abs(finite - end) <= width) & ~at).sum())
        changes = np.flatnonzero(np.diff(np.concatenate(([0], at.astype(np.int8), [0]))))
        longest = int((changes[1::2] - changes[::2]).max())
        if longest >= STUCK and at.sum() > CROWDED * beside:
            return longest, float(end)
    return None


def is_wrapped(series: Sequence[np.ndarray]) -> bool:
    """Whether numbers, (n,) of each trajectory, jump as an angle, a direction or a counter does that starts again."""
    turns = any(jumps_by_turns(series, turn) for turn in (math.pi, 2 * math.pi, 360.0))
    return turns or starts_again_at(series) is not None


def rows_held(values: np.ndarray) -> int | None:
    """Every how many rows numbers (n,) change, where a sensor's reading is repeated until the next; None where they may
    change in every row."""
    begins, places = _runs(values)
    lengths, steps = np.diff(begins)[1:-1], np.abs(np.diff(values[places[begins[:-1]]]))
    one_step = len(steps) > 0 and (steps <= 1.5 * steps.min()).mean() >= MOSTLY  # of a coarse sensor on a ramp
    if len(lengths) < LEVELS or one_step:
        return None
    usual = int(np.median(lengths))
    return usual if usual > 1 and (np.abs(lengths - usual) <= usual // 4).mean() >= MOSTLY else None


def rows_frozen(values: np.ndarray) -> tuple[int, int, float] | None:
    """Where numbers (n,) that otherwise change from row to row stay the same: the longest time in rows, the first of
    them, and the value."""
    begins, places = _runs(values)
    lengths = np.diff(begins)
    long = lengths >= FROZEN
    others = lengths[~long]
    if not long.any() or len(others) < LEVELS or (others - 1).sum() > RARELY * others.sum():
        return None
    longest = int(np.argmax(lengths))
    first = int(places[begins[longest]])
    return int(lengths[longest]), first, float(values[first])


def _runs(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where runs of one number begin among those (m,) that are finite, with m at the end; and the places of these."""
    places = np.flatnonzero(np.isfinite(values))
    changes = np.flatnonzero(np.diff(values[places])) + 1
    return np.concatenate(([0], changes, [len(places)])), places


def spikes(values: np.ndarray) -> np.ndarray:
    """Rows whose number, of (n,), is far from those beside it, which are near each other: glitches of a sensor.

    A corner, such as that of a bounce, or a jump is none.
    """
    places = np.flatnonzero(np.isfinite(values))
    y = values[places]
    if len(y) < LEVELS:
        return places[:0]
    before, here, after = y[1:-3], y[2:-2], y[3:-1]
    off = np.abs(here - (before + after) / 2)
    beside = np.maximum(np.abs(before - y[:-4]), np.abs(y[4:] - after))
    steps = np.abs(np.diff(y))
    usual = max(1.4826 * float(np.median(off)), float(steps[steps > 0].min(initial=np.inf)))
    found = places[2:-2][(off > SPIKE * np.maximum(beside, np.abs(after - before) / 2)) & (off > 4 * SPIKE * usual)]
    return found if len(found) <= SPIKES * len(y) else found[:0]


def rows_of_a_period(series: Sequence[np.ndarray]) -> float | None:
    """Rows from one swing to the next, in the mean, of numbers (n,) of each trajectory; None where they swing less than
    twice.

    Counted are the passages from a quarter of the standard deviation below the mean to as much above it.
    """
    rows, passages = 0, 0
    for values in series:
        finite = values[np.isfinite(values)]
        if len(finite) < 3 or not np.std(finite):
            continue
        apart = (finite - finite.mean()) / finite.std()
        sides = np.sign(apart[np.abs(apart) > 0.25])
        rows += len(finite)
        passages += int((np.diff(sides) > 0).sum())
    return rows / passages if passages > 1 else None

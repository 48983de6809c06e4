"""Measured rows on a grid of even times: where they lie on one, or resampled onto one with a stated error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from expertaug.errors import InputError
from expertaug.measurements.settings import MeasurementSettings
from expertaug.measurements.trajectory import WHERE, Rows
from expertaug.settings import MANY

LYING = 0.7  # part of the rows on a grid, or of its points that have one, below which rows fit it badly
FITTING = 0.5  # part of the steps from row to row that must lie on a grid
WELL, PARTS = 0.9, 5  # part that lies on one where rows are missing, and of how many of its steps the usual one is
SEVERAL = 10  # steps whose mean tells how many rows there are where none is missing
NEAR = 1e-6  # relative distance of a step from a number of few digits that is taken for it


@dataclass(frozen=True)
class Series:
    """A trajectory on a grid; where it has a gap that no chunk may span, one empty point stands for it.

    Attributes:
        rows: what it was made of.
        t: measured or interpolated times in s, (n,), NaN of points without a row.
        row: row of each point, (n,), -1 where there is none.
        y: states, (n, K), NaN where nothing was measured.
        u: known inputs, (n, U), NaN where they are not.
        usable: points that chunks may span, (n,).
        level, label: as of :class:`Rows`, on the grid.
    """

    rows: Rows
    t: np.ndarray
    row: np.ndarray
    y: np.ndarray
    u: np.ndarray
    usable: np.ndarray
    level: np.ndarray | None
    label: np.ndarray | None

    @property
    def name(self) -> str:
        return self.rows.name


@dataclass(frozen=True)
class Grid:
    """All trajectories on one grid.

    Attributes:
        series: in the trajectories' order.
        row_s: time from point to point of the grid in s.
        step: points of the grid from one of a chunk's points to the next.
        broken: steps from row to row that lie off the grid and end a stretch.
        error: rms error of the interpolation (K,), of every other row from its neighbours; None where rows were taken
            as they are.
        share: part of the points that have a row where none is missing: less than 1 on a grid finer than the rows.
        moved: most that a row was moved in time to lie on a finer grid, in s.
        rate_hz: a chunk's points per second, where that number is what their times were made by.
        lying: part of the steps from row to row that lie on the grid; or, where fewer, of the points that have a row.
    """

    series: list[Series]
    row_s: float
    step: int
    broken: int
    error: np.ndarray | None
    share: float = 1.0
    moved: float = 0.0
    rate_hz: float | None = None
    lying: float = 1.0

    @property
    def step_s(self) -> float:
        """Time from point to point of a chunk in s."""
        return self.row_s * self.step

    def times(self, points: int) -> np.ndarray:
        """Times of a chunk's points in s, (points,)."""
        return times_of(points, self.step_s) if self.rate_hz is None else np.arange(points) / self.rate_hz


def describe_uneven(grid: Grid) -> str:
    """What is said of rows that lie off the grid and end a stretch, or on few of its points; else empty."""
    remedy = "set uneven to own to keep their times"
    if grid.broken:
        share = max(100 * (1 - grid.lying), 0.1)
        return f"{share:.2g} % of the rows lie off the grid of {grid.row_s:.6g} s: {remedy}"
    if grid.lying < LYING:
        return f"rows lie on {100 * grid.lying:.0f} % of the points of the grid of {grid.row_s:.6g} s: {remedy}"
    return ""


def on_grid(trajectories: Sequence[Rows], settings: MeasurementSettings) -> Grid:
    """Put trajectories on a grid, as ``uneven`` says.

    Raises:
        InputError: the rows fit no grid, or ``step_s`` is no multiple of their step.
    """
    median = own_step(trajectories)
    if settings.whole:
        settings = settings.model_copy(update={"longest_gap": MANY})
    make = {"mask": _of_rows, "interpolate": _interpolate, "own": _at_own_times}[settings.uneven]
    grid = make(trajectories, settings, median)
    usual = grid.row_s if settings.uneven == "mask" else median
    if settings.whole:
        if grid.broken:
            raise InputError(f"{WHERE}.whole", "trajectories fall apart", describe_uneven(grid))
        points = (settings.length - 1) * grid.step + 1
        return replace(grid, series=[_whole(trajectory, points) for trajectory in grid.series])
    longest = (settings.longest_gap + 1.5) * usual / grid.row_s
    return replace(
        grid, series=[replace(trajectory, usable=_without_gaps(trajectory, longest)) for trajectory in grid.series]
    )


def _whole(series: Series, points: int) -> Series:
    """The first points of a series, and as many without a row behind it as it has fewer."""

    def fill(values: np.ndarray | None, empty: object) -> np.ndarray | None:
        if values is None:
            return None
        more = np.full((max(points - len(values), 0), *values.shape[1:]), empty, dtype=values.dtype)
        return np.concatenate((values[:points], more))

    floats = {name: fill(getattr(series, name), np.nan) for name in ("t", "y", "u", "level")}
    usable = np.ones(points, dtype=bool)
    return replace(series, **floats, row=fill(series.row, -1), label=fill(series.label, ""), usable=usable)


def _without_gaps(series: Series, longest: float) -> np.ndarray:
    """The usable points but for those of long gaps: rows in which nothing was measured are as good as missing."""
    measured_at = np.concatenate(([-1], np.flatnonzero(np.isfinite(series.y).any(1)), [len(series.y)]))
    usable = series.usable.copy()
    for place in np.flatnonzero(np.diff(measured_at) > longest):
        usable[measured_at[place] + 1 : measured_at[place + 1]] = False
    return usable


def _of_rows(trajectories: Sequence[Rows], settings: MeasurementSettings, median: float) -> Grid:
    """Rows at the points of a grid as far apart as they are themselves."""
    row_s = fit_step(trajectories, settings, median)
    step = 1 if settings.step_s is None else round(settings.step_s / row_s)
    if settings.step_s is not None:
        if step < 1 or abs(settings.step_s / row_s - step) > 0.01 * step:
            problem = f"found {settings.step_s:g}, rows are {row_s:.6g} s apart"
            raise InputError(f"{WHERE}.step_s", problem, "give a multiple of that, or set uneven to interpolate")
        row_s = settings.step_s / step
    series, broken = [], 0
    for rows in trajectories:
        made, off = _place(rows, row_s, settings)
        series.append(made)
        broken += off
    on = 1 - broken / max(sum(len(trajectory.t) - 1 for trajectory in trajectories), 1)
    filled = np.concatenate([trajectory.row[trajectory.usable] >= 0 for trajectory in series])
    return Grid(series, row_s, step, broken, None, lying=min(on, float(filled.mean()) if on == 1 else on))


def own_step(trajectories: Sequence[Rows]) -> float:
    """The usual time from row to row in s: the median over all trajectories."""
    steps = np.concatenate([np.diff(rows.t) for rows in trajectories])
    if not len(steps):
        raise InputError(f"{WHERE}.time", "every trajectory has one row", "name the trajectory column, or none")
    return float(np.median(steps))


def fit_step(trajectories: Sequence[Rows], settings: MeasurementSettings, median: float) -> float:
    """The step in s that fits the rows best: the usual one or, where many rows are missing, a part of it."""
    steps = np.concatenate([np.diff(rows.t) for rows in trajectories]) / median

    def on(parts: int) -> np.ndarray:
        whole = np.rint(steps * parts)
        close = np.abs(steps * parts - whole) <= settings.tolerance
        return close & (whole >= 1) & (whole <= settings.longest_gap + 1)

    parts = 1
    if on(1).mean() < WELL:
        parts = max(range(1, PARTS + 1), key=lambda k: (on(k).mean(), -k))
        parts = parts if on(parts).mean() >= WELL else 1
    good, whole = on(parts), np.rint(steps * parts)
    if good.mean() < FITTING:
        problem = (
            f"times from row to row are {median * steps.min():.3g} to {median * steps.max():.3g} s, usually "
            f"{median:.3g}: {100 * (1 - good.mean()):.0f} % lie more than {settings.tolerance:g} of that off a grid"
        )
        raise InputError(f"{WHERE}.time", problem, "set uneven to own or interpolate, or a larger tolerance")
    return round_step(median * steps[good].sum() / whole[good].sum())


def round_step(step_s: float) -> float:
    """A step, or its rate, of few digits where one is near: times that are written with few digits are meant so."""
    for candidate in (float(f"{step_s:.5g}"), 1 / float(f"{1 / step_s:.5g}")):
        if abs(candidate / step_s - 1) < NEAR:
            return candidate
    return float(f"{step_s:.9g}")


def times_of(points: int, step_s: float) -> np.ndarray:
    """Times of a chunk's points in s, (points,): counts over a rate of few digits: 35 · .01 is not .35."""
    rate = float(f"{1 / step_s:.5g}")
    counts = np.arange(points)
    return counts / rate if abs(rate * step_s - 1) < 1e-12 else counts * step_s


def _place(rows: Rows, row_s: float, settings: MeasurementSettings) -> tuple[Series, int]:
    """Rows at their points; and how many steps lie off the grid."""
    steps = np.diff(rows.t) / row_s
    whole = np.maximum(np.rint(steps), 1)
    off = np.abs(steps - whole) > settings.tolerance
    ends = off | (whole > settings.longest_gap + 1)
    row, usable = _points(whole, ends)
    return _series(rows, row, usable), int((off & (whole <= settings.longest_gap + 1)).sum())


def _points(steps: np.ndarray, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The row of each point, -1 for none, and which points chunks may span; behind the end of a stretch stands one that
    they may not.

    Arguments:
        steps: points from each row to the next, (rows - 1,).
        ends: where a stretch ends instead.
    """
    place = np.concatenate(([0], np.cumsum(np.where(ends, 2, steps)))).astype(int)
    row = np.full(int(place[-1]) + 1, -1)
    row[place] = np.arange(len(place))
    usable = np.ones(len(row), dtype=bool)
    usable[place[1:][ends] - 1] = False
    return row, usable


def _series(rows: Rows, row: np.ndarray, usable: np.ndarray) -> Series:
    there = row >= 0

    def spread(values: np.ndarray | None) -> np.ndarray | None:
        if values is None:
            return None
        empty = np.nan if values.dtype.kind == "f" else ""
        made = np.full((len(row), *values.shape[1:]), empty, dtype=values.dtype)
        made[there] = values[row[there]]
        return made

    t, y, u = spread(rows.t), spread(rows.y), spread(rows.u)
    assert t is not None and y is not None and u is not None
    return Series(rows, t, row, y, u, usable, spread(rows.level), spread(rows.label))


def _interpolate(trajectories: Sequence[Rows], settings: MeasurementSettings, median: float) -> Grid:
    """Points every ``step_s`` by cubic splines through the rows of each stretch without a long gap."""
    step_s = round_step(median) if settings.step_s is None else settings.step_s
    longest = (settings.longest_gap + 1.5) * median
    series, squares, counts = [], 0.0, 0.0
    for rows in trajectories:
        begins = np.concatenate(([0], np.flatnonzero(np.diff(rows.t) > longest) + 1, [len(rows.t)]))
        parts = []
        for first, last in pairwise(begins):
            if len(parts):
                parts.append((np.array([np.nan]), np.full((1, rows.y.shape[1]), np.nan), np.array([-1])))
            own = slice(int(first), int(last))
            parts.append(_resample(rows, own, step_s, 1.5 * median))
            error, count = _leave_out(rows.t[own], rows.y[own], 2.5 * median)
            squares, counts = squares + error, counts + count
        t, y, row = (np.concatenate([part[k] for part in parts]) for k in range(3))
        usable = np.isfinite(t)
        made = _series(rows, row, usable)
        u = np.full_like(made.u, np.nan)
        u[usable] = _lines(rows, t[usable], 1.5 * median)
        series.append(Series(rows, t, row, y, u, usable, made.level, made.label))
    error = np.sqrt(np.asarray(squares) / np.maximum(counts, 1))
    return Grid(series, step_s, 1, 0, error)


def _at_own_times(trajectories: Sequence[Rows], settings: MeasurementSettings, median: float) -> Grid:
    """Rows at the nearest points of a finer grid, ``step_s`` apart, or a tenth of the usual time from row to row."""
    step_s = round_step(median / 10) if settings.step_s is None else settings.step_s
    if step_s > median:
        problem = f"found {step_s:g}, rows are usually {median:.6g} s apart"
        raise InputError(f"{WHERE}.step_s", problem, "with uneven: own it is how exact times are kept: give less")
    series, moved = [], 0.0
    for rows in trajectories:
        gaps = np.diff(rows.t)
        ends = gaps > (settings.longest_gap + 1.5) * median
        begin = np.concatenate(([0], np.maximum.accumulate(np.where(ends, np.arange(1, len(rows.t)), 0)))).astype(int)
        within = np.rint((rows.t - rows.t[begin]) / step_s).astype(int)
        moved = max(moved, float(np.abs(rows.t - rows.t[begin] - within * step_s).max()))
        steps = np.diff(within)
        shared = ~ends & (steps < 1)
        if shared.any():
            first = int(np.argmax(shared))
            problem = (
                f"found {step_s:g}: rows {rows.line[first]} and {rows.line[first + 1]} of {rows.name} share a point"
            )
            raise InputError(f"{WHERE}.step_s", problem, f"give less than {gaps[~ends].min():.3g}")
        row, usable = _points(steps, ends)
        made = _series(rows, row, usable)
        last = np.maximum.accumulate(np.where(row >= 0, np.arange(len(row)), 0))
        u = _lines(rows, rows.t[row[last]] + step_s * (np.arange(len(row)) - last), 1.5 * median)
        series.append(replace(made, u=np.where(usable[:, None], u, np.nan)))
    return Grid(series, step_s, 1, 0, None, share=min(1.0, step_s / _mean_step(trajectories, median)), moved=moved)


def _mean_step(trajectories: Sequence[Rows], usual: float) -> float:
    """The usual mean time in s of some successive steps from row to row: of times that alternate, or come at random, it
    is longer than the usual step, and a few missing rows do not change it."""
    each = [(rows.t, min(SEVERAL, len(rows.t) - 1)) for rows in trajectories if len(rows.t) > 1]
    steps = [(t[several:] - t[:-several]) / several for t, several in each]
    return max(usual, float(np.median(np.concatenate(steps))))


def _resample(rows: Rows, own: slice, step_s: float, near: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, states and the nearest row of a stretch's points; NaN where no rows lie close on both sides."""
    t = rows.t[own]
    at = t[0] + step_s * np.arange(int((t[-1] - t[0]) / step_s + 1e-6) + 1)
    y = np.full((len(at), rows.y.shape[1]), np.nan)
    for k, values in enumerate(rows.y[own].T):
        present = np.isfinite(values)
        y[:, k] = _spline(t[present], values[present], at, near)
    after = np.clip(np.searchsorted(t, at), 0, len(t) - 1)
    before = np.clip(after - 1, 0, len(t) - 1)
    row = np.where(np.abs(t[after] - at) < np.abs(at - t[before]), after, before) + own.start
    return at, y, row


def _spline(t: np.ndarray, values: np.ndarray, at: np.ndarray, near: float) -> np.ndarray:
    """Cubic spline at times, NaN where the known values on its two sides lie farther apart than 2 ``near``."""
    from scipy.interpolate import make_interp_spline

    interpolated = np.full(len(at), np.nan)
    if len(t) < 2:
        return interpolated
    place = np.clip(np.searchsorted(t, at, side="right"), 1, len(t) - 1)
    inside = (at >= t[0] - 1e-9) & (at <= t[-1] + 1e-9) & (t[place] - t[place - 1] <= 2 * near)
    inside |= np.minimum(np.abs(at - t[place]), np.abs(at - t[place - 1])) <= 1e-6 * near  # a row beside a gap
    interpolated[inside] = make_interp_spline(t, values, k=min(3, len(t) - 1))(at[inside])
    return interpolated


def _lines(rows: Rows, at: np.ndarray, near: float) -> np.ndarray:
    """Known inputs at times (n, U) on straight lines between the rows, NaN where these lie farther apart than 2
    ``near``; an empty cell leaves the lines on both of its sides unknown."""
    place = np.clip(np.searchsorted(rows.t, at, side="right"), 1, len(rows.t) - 1)
    close = rows.t[place] - rows.t[place - 1] <= 2 * near
    lines = [np.where(close, np.interp(at, rows.t, values), np.nan) for values in rows.u.T]
    return np.array(lines).reshape(len(lines), len(at)).T


def _leave_out(t: np.ndarray, y: np.ndarray, near: float) -> tuple[np.ndarray, np.ndarray]:
    """Squared errors and how many (K,), where every other row is found from the rest."""
    squares, counts = np.zeros(y.shape[1]), np.zeros(y.shape[1])
    for k, values in enumerate(y.T):
        places = np.flatnonzero(np.isfinite(values))
        rest, out = places[::2], places[1::2]
        if len(rest) > 3:
            error = _spline(t[rest], values[rest], t[out], near) - values[out]
            error = error[np.isfinite(error)]
            squares[k], counts[k] = (error**2).sum(), len(error)
    return squares, counts

"""Columns against each other where one is the rate of change of another: a sensor's scale, or its unit, that is wrong.

The integral of the one between two rows is compared with the change of the other, over windows of about a quarter of
a swing.  Change has noise too, by which a regression on it would find too small a factor; the change between the rows
next to these, whose noise is another, takes its place as an instrument (Reiersøl 1941).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.special import stdtrit  # Student's quantile; scipy.stats, which calls it, takes .6 s to import

from expertaug.measurements.grid import Series
from expertaug.measurements.sensors import rows_of_a_period
from expertaug.measurements.settings import MeasurementSettings, column_of
from expertaug.measurements.units import parse, parse_header

SURE, MATTERS = 0.9995, 0.02  # one-sided level at which a factor is not one, and the share by which it must not be
GAP, SHORTEST = 2.5, 9  # usual steps that a stretch bridges in any case, and rows that it must have
BLOCKS, FEWEST = 10, 4  # of windows that count as independent: wanted, and at least
ROUNDS, FAR = 5, 4.685  # of Tukey's biweight, and where it ends in standard deviations
UNLIKE, CLEAR = 0.5, 0.9  # squared correlation below which the two differ, of columns with so little noise
LIKE, ALIKE = 0.9, 0.995  # squared correlation of integral and change, where names or units tell a rate, and where not
LARGEST = 0.3  # logarithm of a sensor's scale: what is further off is another unit
EVEN = 1e-6  # determinant, of a matrix with ones on its diagonal, below which two columns are one
TRIED = 8  # delays to both sides
APART, SHARE = 0.1, 0.2  # of the usual integral, by how much a window is apart from the slope; and of all windows
JUMP, RARE = 0.25, 5  # of the usual integral: of one row to the next; and how many there may be
BEYOND = 12.0  # standard deviations
NEAR = 0.1  # of one, for a factor of columns that nothing says to be a rate and its integral
ROWS, COLUMNS = 20_000, 12  # that are looked at, and of which any pair may be one
# What a column of a rate is called, whole or as a part between other signs; with what it is the rate of.
_SECOND = 1  # place of s among a unit's powers
RATES = {"speed", "velocity", "vel", "omega", "rate", "dot", "gyro", "v", "w"}


_Rows = tuple[np.ndarray, np.ndarray, np.ndarray]  # of a trajectory: times, what changes, and its rate


@dataclass(frozen=True)
class Slope:
    """What the integral of a column is of another's change.

    Attributes:
        factor: 1 where the one is the other's rate of change.
        error: its standard error, by how blocks of windows scatter, with that of the integral between rows.
        blocks: how many.
        agreement: squared correlation of integral and change.
        offset, offset_error: what the rate is beside that, in its unit, and its standard error.
        size: the rate's root mean square.
        delay_s: by how much the rate comes late, to a row, where it fits far better so; the rest is of it in time then.
        apart: share of the windows in which the two are far from each other.
        clear: whether both move by far more than their noise.
        jumps: times in s before which what changes does so at once, and the rate says nothing of it.
    """

    factor: float
    error: float
    blocks: int
    agreement: float
    offset: float = 0.0
    offset_error: float = np.inf
    size: float = np.inf
    delay_s: float = 0.0
    apart: float = 0.0
    clear: bool = False
    jumps: tuple[float, ...] = ()

    @property
    def factor_is_off(self) -> bool:
        """Whether there is a factor, and it is surely another than one, by a share that matters."""
        beyond = abs(self.factor - 1)
        return not self.is_apart and beyond > MATTERS and self._is_sure(beyond, self.error)

    @property
    def is_off(self) -> bool:
        """Whether the one is surely not the slope of the other."""
        return self.factor_is_off or self.offset_is_off or self.delay_s != 0 or self.is_apart or bool(self.jumps)

    @property
    def is_apart(self) -> bool:
        """Whether the one does not follow the other's slope, or not in a share of the windows that matters."""
        return self.apart > SHARE or (self.clear and self.agreement < UNLIKE)

    @property
    def offset_is_off(self) -> bool:
        """Whether the offset is surely not zero, and not small beside the rate."""
        large = not self.is_apart and abs(self.offset) > MATTERS * self.size
        return large and self._is_sure(abs(self.offset), self.offset_error)

    def _is_sure(self, beyond: float, error: float) -> bool:
        return beyond > float(stdtrit(self.blocks - 1, SURE)) * error


@dataclass(frozen=True)
class _Windows:
    """Windows of one trajectory, in order of time: change, change between the rows next to its ends, integral,
    duration and end, (n,) each."""

    change: np.ndarray
    instrument: np.ndarray
    integral: np.ndarray
    duration: np.ndarray
    end: np.ndarray

    def __len__(self) -> int:
        return len(self.change)


def slope(series: Sequence[_Rows], delays: bool = False) -> Slope | None:
    """Compare the integral of a rate with the change of what it is the rate of.

    Arguments:
        series: of each trajectory times in s, what changes, and its rate, (n,) each, NaN where nothing was measured;
            angles unwrapped.
        delays: whether to look for a delay where the one hardly is the other's rate as it stands.

    Returns:
        None where there are too few rows to tell.
    """
    period, rows = rows_of_a_period([of for _, of, _ in series]), sum(len(t) for t, _, _ in series)
    longest = rows / (4 * BLOCKS)  # for as many blocks of a swing each as are wanted
    lag = max(2, round(longest if period is None else min(period / 4, longest)))
    fit = other = None
    while (fit is None or other is None) and lag >= 2:  # shorter ones where few lie between gaps
        used, lag = lag, lag // 2
        fit, other = (_fit([_windows(*trajectory, used, every) for trajectory in series], used) for every in (1, 2))
    if fit is None or other is None:
        return None
    size = float(np.sqrt(np.nanmean(np.concatenate([np.square(rate) for _, _, rate in series]))))
    # The spline's error falls with the fourth power of the step.
    error = float(np.hypot(fit.error, abs(other.factor - fit.factor) / 15))
    pairs = np.concatenate([np.stack((rate[:-1], rate[1:])) for _, _, rate in series], axis=1)
    clear = fit.clear and _likeness(*pairs[:, np.isfinite(pairs).all(0)]) > CLEAR
    fit = replace(fit, error=error, size=size, clear=clear, jumps=_jumps(series, fit, used))
    return _delayed(series, fit, used) if delays and fit.agreement < ALIKE else fit


def _jumps(series: Sequence[_Rows], fit: Slope, lag: int) -> tuple[float, ...]:
    """Times before which what changes jumps: from one row to the next alone, unlike a glitch, and by a part of what it
    does in a window; none where there are many."""
    found: list[float] = []
    sizes = [np.square(_windows(*trajectory, lag, 1).integral) for trajectory in series]
    least = JUMP * float(np.sqrt(np.mean(np.concatenate(sizes))))
    for trajectory in series:
        rows = _windows(*trajectory, 1, 1)
        left = rows.integral - fit.factor * rows.change - fit.offset * rows.duration
        usual = 1.4826 * float(np.median(np.abs(left))) if len(left) else 0.0
        far = np.abs(left) > max(BEYOND * usual, least)
        beside = np.zeros(len(far), dtype=bool)
        beside[1:] |= far[:-1]
        beside[:-1] |= far[1:]
        found += rows.end[far & ~beside].tolist()
    return tuple(found) if len(found) <= RARE else ()


def _delayed(series: Sequence[_Rows], fit: Slope, lag: int) -> Slope:
    """The fit with the delay, of up to two windows, with which it is best; the one without where that is not far
    better."""
    best, at, step = fit, 0, max(1, 2 * lag // TRIED)
    while step:
        around = (at + step * np.arange(-TRIED, TRIED + 1)).tolist() if at == 0 else [at - step, at + step]
        for rows in (rows for rows in around if 0 < abs(rows) <= 2 * lag):
            shifted = _fit([_windows(*_earlier(*trajectory, rows), lag, 1) for trajectory in series], lag)
            if shifted is not None and shifted.factor > 0 and shifted.agreement > best.agreement:
                best, at = shifted, rows
        step //= 2
    if best is fit or best.agreement < LIKE or 1 - best.agreement > (1 - fit.agreement) / 2:
        return fit
    usual = float(np.nanmedian(np.concatenate([np.diff(t[np.isfinite(t)]) for t, _, _ in series])))
    return replace(best, size=fit.size, delay_s=at * usual)


def _earlier(t: np.ndarray, of: np.ndarray, rate: np.ndarray, rows: int) -> _Rows:
    """A trajectory whose rate comes so many rows earlier, not 0; later where these are negative."""
    return (t[:-rows], of[:-rows], rate[rows:]) if rows > 0 else (t[-rows:], of[-rows:], rate[:rows])


def _windows(t: np.ndarray, of: np.ndarray, rate: np.ndarray, lag: int, every: int) -> _Windows:
    """Windows of a trajectory, none of them over a gap; the rate as every so many of its rows tell it."""
    parts: list[np.ndarray] = []
    places = np.flatnonzero(np.isfinite(rate) & np.isfinite(t))
    steps = np.diff(t[places])
    usual = float(np.median(steps)) if len(steps) else 0.0
    longest = max(GAP, lag / 3) * usual  # a cubic spline bridges a twelfth of a swing
    for stretch in np.split(places, np.flatnonzero(steps > longest) + 1):
        nodes = stretch[::every]
        if len(stretch) < SHORTEST or len(nodes) < 4:
            continue
        rows = np.arange(nodes[0], nodes[-1] + 1)
        rows = rows[np.isfinite(of[rows]) & np.isfinite(t[rows])]
        if len(rows) < lag + 3:
            continue
        total = CubicSpline(t[nodes], rate[nodes]).antiderivative()(t[rows])
        first = np.arange(1, len(rows) - lag - 1)
        last, y, times = first + lag, of[rows], t[rows]
        between = (y[last] - y[first], y[last + 1] - y[first - 1], total[last] - total[first])
        parts.append(np.stack((*between, times[last] - times[first], times[last])))
    return _Windows(*np.concatenate(parts, axis=1)) if parts else _Windows(*np.zeros((5, 0)))


def _fit(each: Sequence[_Windows], lag: int) -> Slope | None:
    """The factor over all windows, with a constant offset of the rate, and its error by leaving out blocks."""
    each = [group for group in each if len(group)]
    if not each:
        return None
    numbers, count = [], 0
    for windows in each:
        # Windows that begin within a swing of each other say nearly the same.
        parts = int(np.clip(len(windows) / (4 * lag), 1, -(-BLOCKS // len(each))))
        numbers.append(count + np.arange(len(windows)) * parts // len(windows))
        count += parts
    if count < FEWEST:
        return None
    block = np.concatenate(numbers)
    change, instrument, integral, duration = (
        np.concatenate([getattr(group, name) for group in each])
        for name in ("change", "instrument", "integral", "duration")
    )
    x, z = np.stack((change, duration), 1), np.stack((instrument, duration), 1)
    weights = np.ones(len(block))
    for _ in range(ROUNDS):
        beta = _solve(z.T @ (weights[:, None] * x), z.T @ (weights * integral))
        left = np.abs(integral - x @ beta)
        size = 1.4826 * float(np.median(left))
        weights = np.square(np.clip(1 - np.square(left / (FAR * size)), 0, None)) if size > 0 else (left <= 0) * 1.0
    squares = np.stack([z[block == k].T @ (weights[block == k, None] * x[block == k]) for k in range(count)])
    products = np.stack([z[block == k].T @ (weights[block == k] * integral[block == k]) for k in range(count)])
    without = np.array(
        [_solve(squares.sum(0) - a, products.sum(0) - b) for a, b in zip(squares, products, strict=True)]
    )
    errors = np.sqrt((count - 1) / count * np.square(without - without.mean(0)).sum(0))
    factor, offset = map(float, _solve(squares.sum(0), products.sum(0)))
    if not np.isfinite(factor + errors[0]):
        return None
    kept = weights > 0
    agreement = _likeness(change[kept], integral[kept])
    far = APART * float(np.sqrt(np.mean(np.square(integral))))
    apart = float(np.mean((left > far) & ~kept))
    clear = _likeness(change, instrument) > CLEAR
    return Slope(factor, float(errors[0]), count, agreement, offset, float(errors[1]), apart=apart, clear=clear)


def _likeness(a: np.ndarray, b: np.ndarray) -> float:
    """Squared correlation of values (n,), finite; 0 of what does not move."""
    return float(np.corrcoef(a, b)[0, 1]) ** 2 if len(a) > 1 and np.ptp(a) > 0 and np.ptp(b) > 0 else 0.0


def _solve(square: np.ndarray, product: np.ndarray) -> np.ndarray:
    """Factor and offset; no offset where the motion is so even that the two cannot be told apart."""
    if abs(np.linalg.det(square)) <= EVEN * abs(square[0, 0] * square[1, 1]):
        return np.array([product[0] / square[0, 0] if square[0, 0] else np.nan, 0.0])
    return np.linalg.lstsq(square, product, rcond=1e-12)[0]


@dataclass(frozen=True)
class Off:
    """A column that is not the slope of another.

    Attributes:
        rate, of: components.
        slope: how they compare.
        likely: whether anything but the numbers says that the one is the other's rate.
        swapped: whether the other is this one's rate.
    """

    rate: str
    of: str
    slope: Slope
    likely: bool
    swapped: bool = False

    @property
    def may_be_scale(self) -> bool:
        """Whether a sensor's scale, rather than another unit, may be it."""
        fit = self.slope
        plain = self.likely and not self.swapped and fit.delay_s == 0 and fit.factor_is_off
        return plain and fit.factor > 0 and abs(np.log(fit.factor)) < LARGEST

    def says(self, settings: MeasurementSettings) -> str:
        """One line."""

        def called(component: str) -> str:
            column = column_of(settings.columns[component]).name
            return component if column == component else f"{component} ('{column}')"

        fit, rate, of = self.slope, called(self.rate), called(self.of)
        if self.swapped:
            return f"{rate} is no slope of {of}, which is its slope: the two columns are swapped"
        said = []
        if fit.delay_s:
            when = "behind" if fit.delay_s > 0 else "ahead of"
            said.append(f"about {abs(fit.delay_s):.2g} s {when} the slope of {of}: its sensor's filter, or its times")
        if fit.factor_is_off:
            cause = "a scale, or other units, of the sensor, or times that are off"
            if fit.factor < 0:
                cause = "one of the two has the other sign"
            said.append(f"{fit.factor:.3g} (± {fit.error:.1g}) of the slope of {of}: {cause}")
        if fit.offset_is_off:
            cause = f"an offset of the sensor, or a drift of {self.of}"
            said.append(f"{fit.offset:.3g} (± {fit.offset_error:.1g}) beside the slope of {of}: {cause}")
        if fit.is_apart:
            cause = "one of them has lost its sign, stands still or is cut off"
            share = f" in {100 * fit.apart:.0f} % of the time" if fit.apart > SHARE else ""
            said.append(f"far from the slope of {of}{share}: {cause}")
        if fit.jumps:
            when = ", ".join(f"{t:.6g} s" for t in fit.jumps)
            said.append(f"nothing in it of the jump of {of} before {when}: another motion begins there, or a push")
        condition = "" if self.likely else "if it is its rate, "
        return f"{rate}: {condition}{'; '.join(said)}"


def slopes_off(
    settings: MeasurementSettings, state: Sequence[str], series: Sequence[Series], rates: Mapping[str, str]
) -> list[Off]:
    """The columns that are not the slope of the column whose rate they are said to be.

    Arguments:
        state: components, in the order of the series' columns.
        series: trajectories.
        rates: component → that whose rate it is, of a system; where none is known, names and units of columns say it,
            and of others how closely they fit.
    """
    names, off, most = list(state), list[Off](), max(ROWS // max(len(series), 1), 10 * SHORTEST)

    def compared(rate: str, of: str, delays: bool = False) -> Slope | None:
        k, j = names.index(of), names.index(rate)
        return slope([_of_rows(trajectory, k, j, most) for trajectory in series], delays)

    def are_swapped(rate: str, of: str, fit: Slope) -> bool:
        if fit.factor > 0 and fit.agreement >= LIKE:
            return False
        other = compared(of, rate)
        return other is not None and abs(other.factor - 1) <= NEAR and other.agreement >= LIKE

    if rates:
        pairs = [(rate, of) for rate, of in rates.items() if rate in settings.columns and of in settings.columns]
        each = [(rate, of, fit) for rate, of in pairs if (fit := compared(rate, of, True)) is not None and fit.is_off]
        return [Off(*one, likely=True, swapped=are_swapped(*one)) for one in each]
    for rate in settings.columns:
        candidates = []
        for of in settings.columns:
            likely = _is_likely(settings, rate, of)
            asked = of != rate and (likely or len(settings.columns) <= COLUMNS)
            fit = compared(rate, of, likely) if asked else None
            if fit is not None and fit.factor > 0:
                close = fit.agreement >= (LIKE if likely else ALIKE)
                if close and (likely or abs(fit.factor - 1) <= NEAR):
                    candidates.append(Off(rate, of, fit, likely))
        # A rate of one column is none of another: what follows the same motion fits both.
        if candidates and all(candidate.slope.is_off for candidate in candidates):
            off.append(max(candidates, key=lambda candidate: (candidate.likely, candidate.slope.agreement)))
    return off


def _is_likely(settings: MeasurementSettings, rate: str, of: str) -> bool:
    """Whether units, or, where they are not told, names say that a column is another's rate."""
    units, words = [], []
    for name in (rate, of):
        column = column_of(settings.columns[name])
        header = parse_header(column.name)
        units.append(parse(column.unit or header.unit) if column.unit or header.unit else None)
        words.append(set(re.split(r"[\W_\d]+", header.name.lower())))
    if units[0] is not None and units[1] is not None:
        per_second = tuple(power - (k == _SECOND) for k, power in enumerate(units[1].dimension))
        return any(units[1].dimension) and units[0].dimension == per_second
    return bool(words[0] & RATES) and not words[1] & RATES


def _of_rows(series: Series, of: int, rate: int, most: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, what changes and its rate at the points of a trajectory that have a row, at most so many; interpolated
    ones are kept."""
    points = np.flatnonzero(np.isfinite(series.t))[:most]
    return series.t[points], series.y[points, of], series.y[points, rate]

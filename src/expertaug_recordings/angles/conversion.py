"""Frame rates that were converted by leaving frames out, showing them twice or mixing them: found, and undone.

A converter from a to b frames/s shows at its frame k the source's frame floor(k a / b + phase).  Its times are even,
but what it shows jumps by one or two of the source's intervals in a pattern that repeats.  Put to the times of the
right pattern, each angle is near the polynomial through its neighbours; at even times it is not.

One that mixes shows at k a / b + phase the two frames around, each by how near it is.  Frames that are of nearly equal
parts are seen as such: they tell the phase, also where the pattern repeats too rarely for the motion to tell.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from expertaug_recordings.angles.even_times import STILL, lagrange, step_of, turns

USUAL_HZ = (12, 15, 24, 25, 30, 48, 50, 60, 90, 100, 120, 240)  # rates of cameras
FILM = 1000 / 1001  # what television makes of them
FEW = 6  # the largest denominator of another ratio that is tried
LEAST, LARGEST = 0.2, 6.0  # ratios of the source's rate to the file's
PHASES = 30  # at most
ROWS = 1200  # of the liveliest stretch, which tell enough
BETTER = 0.5  # of the misfit at even times that the pattern may leave at most
NO_WORSE = 1.1  # the same where mixtures tell the pattern: one that repeats rarely leaves most frames even
NEARLY_STILL = 0.5  # of the motion: mixtures of images that lie on each other are no repeats
WIDE = 12  # intervals between the first and the last of five frames that tell
NARROW = 8  # the same where frames are mixed: less than where one that repeats rarely leaves them out
LIVELY = np.deg2rad(0.3)  # misfit at even times, below which there is nothing to find
ENOUGH = 30  # frames of the source
HALF_WAY = 0.5  # mean cosine of the phases of frames of nearly equal parts, at least
ALIKE = 9.0  # squared distance of their mean phase from other fast frames', over its variance by chance


@dataclass(frozen=True)
class Pattern:
    """Of a conversion: the source's rate over the file's, the phase at the first frame, whether mixtures tell it."""

    ratio: float
    phase: float
    told: bool = False


@dataclass(frozen=True)
class Conversion:
    """A file's frames at the times of their source.

    Attributes:
        source_hz: the source's frames per second.
        t: times (n,) in s of what the frames show, from 0.
        repeated: (n,), frames that show what the one before shows.
        later: (n,), by how much of the source's interval a frame's mixture is later than its stronger image, between
            −.5 and .5; 0 where no frames are mixed.
    """

    source_hz: float
    t: np.ndarray
    repeated: np.ndarray
    later: np.ndarray


def find_conversion(theta: np.ndarray, rate_hz: float, blended: np.ndarray | None = None) -> Conversion | None:
    """The conversion that evenly timed frames went through; None where nothing tells of one.

    Arguments:
        theta: angles (n, k) in rad; NaN where they are not known.
        rate_hz: the file's frames per second.
        blended: (n,), frames that are mixtures of nearly equal parts of two; None where none is.
    """
    number = np.arange(len(theta))[_liveliest(theta)]
    number = number[np.isfinite(theta[number]).all(1)]
    mixing = [] if blended is None or not blended.any() else _mixing_patterns(theta, blended, rate_hz)
    for patterns, mixed in ((mixing, True), (_patterns(rate_hz), False)):
        best = _fit(theta[number], number, patterns, NARROW if mixed else WIDE)
        if best is not None:
            return _at_source(best, len(theta), rate_hz, mixed)
    return None


def _fit(theta: np.ndarray, number: np.ndarray, patterns: Iterable[Pattern], wide: float) -> Pattern | None:
    """The pattern that angles (n, k) of the file's frames ``number`` (n,) misfit least, and not too much; of nearly
    equal ones the first.  Frames ``wide`` intervals apart tell nothing."""
    even = off_cubic(theta, number.astype(float), wide)
    best, least = None, np.inf
    for pattern in patterns:
        shown = _number_shown(number, pattern)
        kept = np.diff(shown, prepend=shown[0] - 1) > 0
        most, still = (NO_WORSE, NEARLY_STILL) if pattern.told else (BETTER, STILL)
        if not (pattern.told or even > LIVELY) or kept.sum() < ENOUGH or not _are_still(theta, kept, still):
            continue
        left = off_cubic(theta[kept], shown[kept].astype(float), wide)
        if left < most * even and left < 0.99 * least:
            best, least = pattern, left
    return best


def _at_source(pattern: Pattern, count: int, rate_hz: float, mixed: bool) -> Conversion:
    """So many of the file's frames at their source's times."""
    number = np.arange(count)
    shown, source = _number_shown(number, pattern), pattern.ratio * rate_hz
    later = number * pattern.ratio + pattern.phase - 0.5 - shown if mixed else np.zeros(count)
    return Conversion(source, (shown - shown[0]) / source, np.diff(shown, prepend=shown[0] - 1) == 0, later)


def _number_shown(number: np.ndarray, pattern: Pattern) -> np.ndarray:
    """Numbers (n,) of the source's frames that the file's frames show."""
    return np.floor(number * pattern.ratio + pattern.phase + 1e-9).astype(int)


def _mixing_patterns(theta: np.ndarray, blended: np.ndarray, rate_hz: float) -> list[Pattern]:
    """Patterns for whose stronger images the frames ``blended`` (n,) are about half way between two of the source's, of
    each ratio's those first for which they are so best; told by them if other frames as fast are not."""
    way = step_of(theta).max(1)
    fast = np.isfinite(theta).all(1) & ~blended & (way >= np.median(way[blended]))
    number, found = np.arange(len(theta)), []
    for ratio, period in _ratios(rate_hz):
        turn = np.exp(2j * np.pi * ratio * number)
        mean, others = turn[blended].mean(), turn[fast].mean() if fast.any() else 0.0
        told = bool(abs(mean - others) ** 2 / (1 / blended.sum() + 1 / max(fast.sum(), 1)) > ALIKE)
        half_way = -np.angle(mean) / (2 * np.pi)  # phase by which they are at whole numbers once half is added
        phases = np.arange(period) / period + 0.5 if period <= PHASES else np.array([half_way])
        agree = np.cos(2 * np.pi * (phases - half_way)) * abs(mean)
        found += [Pattern(ratio, float(phases[k]) % 1, told) for k in np.argsort(-agree) if agree[k] > HALF_WAY]
    return found


def _patterns(rate_hz: float) -> Iterator[Pattern]:
    """Patterns of frames that are left out or shown twice."""
    for ratio, period in _ratios(rate_hz):
        count = min(period, PHASES)
        yield from (Pattern(ratio, k / count) for k in range(count))


def _ratios(rate_hz: float) -> Iterator[tuple[float, int]]:
    """Ratios of the source's rate to the file's, usual ones first, and after how many frames a pattern repeats."""
    usual = [hz / rate_hz for hz in USUAL_HZ] + [FILM * hz / rate_hz for hz in USUAL_HZ]
    simple = [p / q for q in range(1, FEW + 1) for p in range(1, int(LARGEST * q) + 1)]
    tried: list[float] = []
    for ratio in usual + simple:
        if LEAST <= ratio <= LARGEST and all(abs(ratio / other - 1) > 2e-4 for other in [1.0, *tried]):
            tried.append(ratio)
            near = Fraction(ratio).limit_denominator(PHASES)
            period = near.denominator if abs(float(near) - ratio) < 1e-6 else PHASES + 1
            if period > 1:
                yield ratio, period


def _liveliest(theta: np.ndarray) -> slice:
    """The stretch in which most is known of fast motion."""
    if len(theta) <= ROWS:
        return slice(0, len(theta))
    moved = np.concatenate(([0.0], np.cumsum(np.nan_to_num(np.abs(turns(theta))).sum(1))))
    start = int(np.argmax(moved[ROWS - 1 :] - moved[: len(moved) - ROWS + 1]))
    return slice(start, start + ROWS)


def _are_still(theta: np.ndarray, kept: np.ndarray, most: float) -> bool:
    """Whether frames that are said to repeat the one before do so: move less than that share of what the others do."""
    step = np.append(np.nan, np.linalg.norm(turns(theta), axis=1))
    finite = np.isfinite(step)
    still, moving = step[finite & ~kept], step[finite & kept]
    return not len(still) or bool(still.mean() < most * moving.mean())


def off_cubic(theta: np.ndarray, t: np.ndarray, wide: float = WIDE) -> float:
    """Mean distance in rad of each angle from the cubic through its four neighbours, times (n,) in any unit, where
    these are less than so many intervals apart."""
    if len(theta) < ENOUGH:
        return 0.0
    step = turns(theta)
    around = np.stack([-step[:-3] - step[1:-2], -step[1:-2], step[2:-1], step[2:-1] + step[3:]], axis=1)
    rows = np.arange(len(theta) - 4)[:, None] + np.array([0, 1, 3, 4])
    off = np.einsum("nm,nmk->nk", lagrange(t[rows], t[2:-2]), around)
    far = np.linalg.norm(off, axis=1)[t[4:] - t[:-4] < wide * np.median(np.diff(t))]
    return float(np.nanmean(far)) if np.isfinite(far).any() else 0.0

"""Frame rates that were converted by leaving frames out or showing them twice: found from the motion, and undone.

A converter from a to b frames/s shows at its frame k the source's frame floor(k a / b + phase).  Its times are even,
but what it shows jumps by one or two of the source's intervals in a pattern that repeats.  Put to the times of the
right pattern, each angle is near the polynomial through its neighbours; at even times it is not.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from expertaug_recordings.angles.even_times import STILL, lagrange, turns

USUAL_HZ = (12, 15, 24, 25, 30, 48, 50, 60, 90, 100, 120, 240)  # rates of cameras
FILM = 1000 / 1001  # what television makes of them
FEW = 6  # the largest denominator of another ratio that is tried
LEAST, LARGEST = 0.2, 6.0  # ratios of the source's rate to the file's
PHASES = 30  # at most
ROWS = 1200  # of the liveliest stretch, which tell enough
BETTER = 0.5  # of the misfit at even times that the pattern may leave at most
WIDE = 12  # intervals between the first and the last of five frames that tell
LIVELY = np.deg2rad(0.3)  # misfit at even times, below which there is nothing to find
ENOUGH = 30  # frames of the source


@dataclass(frozen=True)
class Conversion:
    """A file's frames at the times of their source.

    Attributes:
        source_hz: the source's frames per second.
        t: times (n,) in s of what the frames show, from 0.
        repeated: (n,), frames that show what the one before shows.
    """

    source_hz: float
    t: np.ndarray
    repeated: np.ndarray


def find_conversion(theta: np.ndarray, rate_hz: float) -> Conversion | None:
    """The conversion that evenly timed frames went through; None where the motion tells of none.

    Arguments:
        theta: angles (n, k) in rad; NaN where they are not known.
        rate_hz: the file's frames per second.
    """
    number = np.arange(len(theta))[_liveliest(theta)]
    number = number[np.isfinite(theta[number]).all(1)]
    part = theta[number]
    even = _misfit(part, number.astype(float))
    if not even > LIVELY:
        return None
    best, least = None, BETTER * even
    for ratio, phase in _patterns(rate_hz):
        shown = _number_shown(number, ratio, phase)
        kept = np.diff(shown, prepend=shown[0] - 1) > 0
        if kept.sum() < ENOUGH or not _are_still(part, kept):
            continue
        left = _misfit(part[kept], shown[kept].astype(float))
        if left < 0.99 * least:
            best, least = (ratio, phase), left
    if best is None:
        return None
    ratio, phase = best
    shown = _number_shown(np.arange(len(theta)), ratio, phase)
    source = ratio * rate_hz
    return Conversion(source, (shown - shown[0]) / source, np.diff(shown, prepend=shown[0] - 1) == 0)


def _number_shown(number: np.ndarray, ratio: float, phase: float) -> np.ndarray:
    """Numbers (n,) of the source's frames that the file's frames show."""
    return np.floor(number * ratio + phase + 1e-9).astype(int)


def _patterns(rate_hz: float) -> Iterator[tuple[float, float]]:
    """Ratios of the source's rate to the file's, simple ones first, and phases."""
    usual = [hz / rate_hz for hz in USUAL_HZ] + [FILM * hz / rate_hz for hz in USUAL_HZ]
    simple = [p / q for q in range(1, FEW + 1) for p in range(1, int(LARGEST * q) + 1)]
    tried: list[float] = []
    for ratio in usual + simple:
        if LEAST <= ratio <= LARGEST and all(abs(ratio / other - 1) > 2e-4 for other in [1.0, *tried]):
            tried.append(ratio)
            near = Fraction(ratio).limit_denominator(PHASES)
            count = near.denominator if abs(float(near) - ratio) < 1e-6 else PHASES
            yield from ((ratio, k / count) for k in range(count) if count > 1)


def _liveliest(theta: np.ndarray) -> slice:
    """The stretch in which most is known of fast motion."""
    if len(theta) <= ROWS:
        return slice(0, len(theta))
    moved = np.concatenate(([0.0], np.cumsum(np.nan_to_num(np.abs(turns(theta))).sum(1))))
    start = int(np.argmax(moved[ROWS - 1 :] - moved[: len(moved) - ROWS + 1]))
    return slice(start, start + ROWS)


def _are_still(theta: np.ndarray, kept: np.ndarray) -> bool:
    """Whether frames that are said to repeat the one before do so."""
    step = np.append(np.nan, np.linalg.norm(turns(theta), axis=1))
    finite = np.isfinite(step)
    still, moving = step[finite & ~kept], step[finite & kept]
    return not len(still) or bool(still.mean() < STILL * moving.mean())


def _misfit(theta: np.ndarray, t: np.ndarray) -> float:
    """Mean distance in rad of each angle from the cubic through its four neighbours, times (n,) in any unit."""
    if len(theta) < ENOUGH:
        return 0.0
    step = turns(theta)
    around = np.stack([-step[:-3] - step[1:-2], -step[1:-2], step[2:-1], step[2:-1] + step[3:]], axis=1)
    rows = np.arange(len(theta) - 4)[:, None] + np.array([0, 1, 3, 4])
    off = np.einsum("nm,nmk->nk", lagrange(t[rows], t[2:-2]), around)
    far = np.linalg.norm(off, axis=1)[t[4:] - t[:-4] < WIDE * np.median(np.diff(t))]
    return float(np.nanmean(far)) if np.isfinite(far).any() else 0.0

"""Frames that a video repeats or lacks although its times are even, found from the motion that they show."""

from __future__ import annotations

import numpy as np

STILL = 0.1  # of the motion between the neighbours, below which a frame repeats the one before
MOVING = np.deg2rad(1.0)  # per frame: slower motion does not tell
HALF, ORDER = 3, 3  # frames on either side of a jump, and order of the polynomial through them
MISSING = (2.0, 3.0, 4.0)  # steps that a jump may take
STRANGE, NOISE = 6.0, np.deg2rad(0.3)  # a jump's misfit, in medians of all and at least
BETTER = 0.25  # of that misfit at most, where frames are missing


def turns(theta: np.ndarray) -> np.ndarray:
    """By how much angles (n, k) turn from each row to the next, in (−π, π], (n − 1, k)."""
    return np.angle(np.exp(1j * np.diff(theta, axis=0)))


def find_repeated(theta: np.ndarray) -> np.ndarray:
    """Frames (n,) that show what the one before showed, while the motion goes on round them.

    At a turning point the neighbours' motions cancel: there nothing is said.

    Arguments:
        theta: angles (n, k) in rad; NaN where they are not known.
    """
    found = np.zeros(len(theta), dtype=bool)
    if len(theta) < 4:
        return found
    step = turns(theta)
    expected = np.linalg.norm(step[:-2] + step[2:], axis=1) / 2
    with np.errstate(invalid="ignore"):
        found[2:-1] = (expected > MOVING) & (np.linalg.norm(step[1:-1], axis=1) < STILL * expected)
    return found


def find_dropped(theta: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Frames (n,) that are missing before each row: the motion jumps as if so much more time had passed.

    Arguments:
        theta: angles (n, k) in rad of consecutive frames; NaN where they are not known.
        t: times (n,) in steps.
    """
    missing = np.zeros(len(theta), dtype=int)
    count = len(theta) - 2 * HALF + 1
    if count < 1:
        return missing
    rows = np.arange(count)[:, None] + np.arange(2 * HALF)
    window = np.concatenate((np.zeros((count, 1, theta.shape[1])), np.cumsum(turns(theta)[rows[:, :-1]], axis=1)), 1)
    time = t[rows] - t[rows[:, HALF - 1 : HALF]]
    usable = np.isfinite(window).all((1, 2)) & (time[:, -1] - time[:, 0] < 2 * HALF + 1)
    fit = np.full((1 + len(MISSING), count), np.nan)
    for k, steps in enumerate((1.0, *MISSING)):
        late = time + (steps - 1) * (np.arange(2 * HALF) >= HALF)
        fit[k, usable] = _misfit(late[usable], window[usable])
    if not usable.any():
        return missing
    as_it_is, best = fit[0], np.min(fit[1:], axis=0)
    with np.errstate(invalid="ignore"):
        strange = (as_it_is > max(STRANGE * float(np.nanmedian(as_it_is)), NOISE)) & (best < BETTER * as_it_is)
    for first in np.flatnonzero(strange):
        near = slice(max(0, first - HALF), first + HALF + 1)
        if best[first] <= np.nanmin(best[near][strange[near]]):
            missing[first + HALF] = int(MISSING[int(np.argmin(fit[1:, first]))]) - 1
    return missing


def _misfit(t: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Root mean square (n,) in rad of what a polynomial leaves of windows of angles (n, m, k) at times (n, m)."""
    design = t[..., None] ** np.arange(ORDER + 1)
    q, _ = np.linalg.qr(design)
    rest = theta - q @ (np.swapaxes(q, 1, 2) @ theta)
    return np.sqrt((rest**2).sum((1, 2)) / (theta.shape[2] * (theta.shape[1] - ORDER - 1)))

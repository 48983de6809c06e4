"""Frames that a video repeats or lacks although its times are even, found from the motion that they show."""

from __future__ import annotations

import numpy as np

STILL = 0.1  # of the motion between the neighbours, below which a frame repeats the one before
MOVING = np.deg2rad(1.0)  # per frame: slower motion does not tell
HALF, ORDER = 3, 3  # frames on either side of a jump, and order of the polynomial through them
MISSING = (2.0, 3.0, 4.0)  # steps that a jump may take
STRANGE, NOISE = 6.0, np.deg2rad(0.3)  # a jump's misfit, in medians of all, and at least
BETTER, STILL_BETTER = (
    0.25,
    0.5,
)  # of that misfit at most, where frames are missing; without the frames next to the jump


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

    It must do so also without the frame before the jump and without that after it: a wrong marker in one of them does
    not.

    Arguments:
        theta: angles (n, k) in rad of consecutive frames; NaN where they are not known.
        t: times (n,) in steps.
    """
    missing = np.zeros(len(theta), dtype=int)
    first = HALF + 1
    count = len(theta) - 2 * first + 1
    if count < 1:
        return missing
    rows = first + np.arange(count)
    near, before, after = (_misfits(theta, t, rows, *skipped) for skipped in ((0, 0), (1, 0), (0, 1)))
    if not np.isfinite(near).any():
        return missing
    best, chosen = np.min(near[1:], axis=0), np.argmin(near[1:], axis=0)[None]
    with np.errstate(invalid="ignore"):
        strange = (near[0] > max(STRANGE * float(np.nanmedian(near[0])), NOISE)) & (best < BETTER * near[0])
        for other in (before, after):
            strange &= np.take_along_axis(other[1:], chosen, axis=0)[0] < STILL_BETTER * other[0]
    for k in np.flatnonzero(strange):
        around = slice(max(0, k - HALF), k + HALF + 1)
        if best[k] <= np.nanmin(best[around][strange[around]]):
            missing[first + k] = int(MISSING[int(np.argmin(near[1:, k]))]) - 1
    return missing


def _misfits(theta: np.ndarray, t: np.ndarray, rows: np.ndarray, before: int, after: int) -> np.ndarray:
    """What is left of windows before and from each of the rows (m,) on by a polynomial through both, (1 + k, m): as the
    times have it, and where each of the k numbers of frames in MISSING passes at the row.

    Arguments:
        before, after: frames that are left out before the row, and from it on.
    """
    offsets = np.concatenate((np.arange(-HALF, 0) - before, np.arange(HALF) + after))
    through = np.arange(offsets[0], offsets[-1] + 1)
    every = rows[:, None] + through
    turned = np.concatenate(
        (np.zeros((len(rows), 1, theta.shape[1])), np.cumsum(turns(theta)[every[:, :-1]], axis=1)), 1
    )
    inside = np.isin(through, offsets)
    window, time = turned[:, inside], t[every[:, inside]] - t[rows - 1][:, None]
    usable = np.isfinite(turned).all((1, 2)) & (time[:, -1] - time[:, 0] < 2 * HALF + 1 + before + after)
    out = np.full((1 + len(MISSING), len(rows)), np.nan)
    for k, steps in enumerate((1.0, *MISSING)):
        late = time + (steps - 1) * (offsets >= 0)
        out[k, usable] = _misfit(late[usable], window[usable])
    return out


def _misfit(t: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Root mean square (n,) in rad of what a polynomial leaves of windows of angles (n, m, k) at times (n, m)."""
    design = t[..., None] ** np.arange(ORDER + 1)
    q, _ = np.linalg.qr(design)
    rest = theta - q @ (np.swapaxes(q, 1, 2) @ theta)
    return np.sqrt((rest**2).sum((1, 2)) / (theta.shape[2] * (theta.shape[1] - ORDER - 1)))

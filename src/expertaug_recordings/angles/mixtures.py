"""Frames that a converter mixed from two (:mod:`expertaug_recordings.markers.blending`): what can be made of them.

Where the two images of a marker lie apart the tracker follows the stronger one, whose time the pattern of the
conversion tells.  Where they lie on each other it finds the middle of both, which is later or earlier by what the
pattern tells as well: the marker is moved back by that.
"""

from __future__ import annotations

import numpy as np

from expertaug_recordings.angles.conversion import off_cubic
from expertaug_recordings.angles.even_times import step_of

FEWEST, STRAY = 10, 0.1  # mixtures, and share of those that may be among the other frames, where every other one is
LATE = 0.2  # of a frame, by which what is followed is late where no pattern tells it
# Of 7000 mixtures of rendered frames, tracked: what is found is 1 / (1 + (step / .19)⁴) of the way to the middle, steps
# in diameters, and besides off by .02 diameters times what the middle is later, as long as the disks touch.
USUAL, OTHERS = 0.053, np.geomspace(0.015, 0.12, 10)  # second arms from image to image, at which it is half of the way
BETTER = 0.85  # of the usual one's misfit, which another leaves at most
OFF, TOUCHING = 0.05, 5.0  # of that step, which the arms' lengths do not show; and how many of it the disks touch over
SAME = 0.5  # of it, below which they are nearly one
PASSES = 3  # each has better steps from image to image than the one before


def late_by(theta: np.ndarray) -> np.ndarray:
    """Errors (n, 2) in rad of angles of mixed frames whose times no pattern tells.

    Arguments:
        theta: angles (n, 2) in rad; NaN where they are not known.
    """
    return LATE * step_of(theta)


def unmix(place: np.ndarray, number: np.ndarray, later: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places of the stronger images, and what is left of the mixing.

    How far two images of a marker are apart where the tracker goes over from their middle to the stronger one depends
    on the disks' size: it is the distance that puts the angles nearest to the cubics through their neighbours.

    Arguments:
        place: pivot, joint and tip (n, 3, 2) in px; NaN where a frame cannot be used.
        number: of the source's frames that are the stronger ones, (n,), growing.
        later: (n,), by how much of the source's interval the middle is later.

    Returns:
        places (n, 3, 2) and standard deviations (n, 2) in rad of the errors of their angles.
    """
    rows = np.flatnonzero(np.isfinite(place).all((1, 2)))
    error = np.zeros((len(place), 2))
    if len(rows) < FEWEST or not later[rows].any():
        return place, error
    part, at, share = place[rows], number[rows].astype(float), later[rows, None]
    arm = np.median(np.linalg.norm(np.diff(part, axis=1), axis=2), axis=0)
    halves = arm[1] * np.array([USUAL, *OTHERS])
    left = np.array([off_cubic(_angles(_moved_back(part, at, share, half)), at) for half in halves])
    half = halves[int(left.argmin())] if left.min() < BETTER * left[0] else halves[0]
    moved = place.copy()
    moved[rows] = _moved_back(part, at, share, half)
    step = np.linalg.norm(_to_other(moved[rows, 1:], at, share), axis=2)
    off = np.where(step < TOUCHING * half, OFF * np.minimum(half, step / SAME) * np.abs(share), 0.0)
    error[rows] = np.stack((off[:, 0], np.hypot(*off.T)), axis=1) / arm
    return moved, error


def _to_other(place: np.ndarray, number: np.ndarray, later: np.ndarray) -> np.ndarray:
    """Steps (n, m, 2) in px forwards in time between the two images of places (n, m, 2): to the source's next frame
    where the middle is later, (n, 1), and from the one before elsewhere."""
    step = np.diff(place, axis=0) / np.diff(number)[:, None, None]
    return np.where(later[..., None] > 0, np.append(step, step[-1:], axis=0), np.append(step[:1], step, axis=0))


def _angles(place: np.ndarray) -> np.ndarray:
    vector = np.diff(place, axis=1)
    return np.arctan2(vector[..., 0], vector[..., 1])


def _moved_back(place: np.ndarray, number: np.ndarray, later: np.ndarray, half: float) -> np.ndarray:
    """Places (n, 3, 2) without what the middle of both images is later, where it is half of the way to that that is
    followed at a step of ``half`` px; ``later`` (n, 1)."""
    moved = place.copy()
    for _ in range(PASSES):
        step = _to_other(moved[:, 1:], number, later)
        followed = later / (1 + (np.linalg.norm(step, axis=2) / half) ** 4)
        moved[:, 1:] = place[:, 1:] - followed[..., None] * step
    return moved


def whole_half(blended: np.ndarray) -> int | None:
    """Of frames of which every other one is a mixture of its neighbours, the first that is none; None of others.

    Arguments:
        blended: (n,), frames in which the motion is fast enough to show it.
    """
    number = np.flatnonzero(blended)
    if len(number) < FEWEST:
        return None
    odd = float(np.mean(number % 2))
    return int(odd < 0.5) if min(odd, 1 - odd) < STRAY and (np.diff(number) == 2).mean() > 0.5 else None

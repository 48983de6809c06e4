"""Frames that a converter mixed from two (:mod:`expertaug_recordings.markers.blending`): what can be made of them.

Where the two images of a marker lie apart the tracker follows the stronger one, whose time the pattern of the
conversion tells.  Where they lie on each other it finds the middle of both.
"""

from __future__ import annotations

import numpy as np

from expertaug_recordings.angles.even_times import turns

FEWEST, STRAY = 10, 0.1  # mixtures, and share of those that may be among the other frames, where every other one is
LATE, MIDDLE = 0.2, 0.16  # of a frame, by which the stronger image is late, and the middle of both off it
JOINED = 0.05  # rad that arms turn between two images whose disks, a fifth of an arm wide or more, lie on each other


def late_by(theta: np.ndarray, undone: bool) -> np.ndarray:
    """Errors (n, 2) in rad of angles of mixed frames by the times of what was followed: the stronger image, or the
    middle of both where these lie on each other.

    Arguments:
        theta: angles (n, 2) in rad; NaN where they are not known.
        undone: whether the times are those of the stronger image.
    """
    number = np.flatnonzero(np.isfinite(theta).all(1))
    way = np.cumsum(np.abs(turns(theta[number])), axis=0)  # also across frames that are not used
    step = np.gradient(np.stack([np.interp(np.arange(len(theta)), number[1:], of) for of in way.T], axis=1), axis=0)
    return MIDDLE * np.minimum(step, JOINED**4 / np.maximum(step, JOINED) ** 3) if undone else LATE * step


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

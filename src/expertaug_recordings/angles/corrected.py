"""Markers put where somebody has seen them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from expertaug.errors import InputError
from expertaug_recordings.corrections import ALL, MARKERS, Correction


def correct(
    where: object, frame: np.ndarray, place: np.ndarray, corrections: Sequence[Correction]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Put markers where they were seen by hand.

    Arguments:
        where: the recording, for messages.
        frame: numbers (n,) of the frames.
        place: pivot, joint and tip (n, 3, 2) in px.
        corrections: in order; the last of a marker counts.

    Returns:
        places (n, 3, 2), frames (n,) that were corrected, and frames (n,) that are not to be used.

    Raises:
        InputError: there is no such frame.
    """
    place, touched, dismissed = place.copy(), np.zeros(len(frame), bool), np.zeros(len(frame), bool)
    rows = {int(number): row for row, number in enumerate(frame)}
    for one in corrections:
        if one.frame not in rows:
            raise InputError(where, f"a correction of frame {one.frame}", f"its frames are {frame[0]} to {frame[-1]}")
        row = rows[one.frame]
        if one.marker == ALL:
            dismissed[row] = True
            continue
        touched[row] = True
        place[row, MARKERS.index(one.marker)] = np.nan if one.x is None else (one.x, one.y)
    return place, touched & ~dismissed, dismissed

"""Which frames of a recording are measured, which are filled or doubtful, which are unusable, and why."""

from __future__ import annotations

import numpy as np
import pandas as pd

from expertaug_recordings.angles.marker_table import MarkerTable
from expertaug_recordings.angles.smoothing import Motion

MEASURED, INTERPOLATED, UNUSABLE = 1.0, 0.5, 0.0  # qualities of a frame's angles
NO_PIVOT = "pivot_interpolated"  # reason of a measured frame whose pivot comes from its neighbours

CORRECTED = "corrected"  # and of one in which a marker was placed by hand


def trust_tracker(markers: MarkerTable) -> tuple[np.ndarray, np.ndarray]:
    """Frames (n,) that can be used by what the tracker says of them, and its reasons (n,) where they cannot.

    A frame whose pivot alone is lost keeps its arms: the pivot hardly moves, its neighbours tell where it is.  Any
    other flag of the tracker, also a doubt, costs the frame.
    """
    reason = markers.reason.copy()
    lost = pd.Series(reason).str.startswith("lost").to_numpy()
    rejected = (~(markers.quality > 0) | (reason != "")) & ~lost
    usable = np.isfinite(markers.joint).all(1) & np.isfinite(markers.tip).all(1) & ~rejected
    reason[~usable & (reason == "")] = "lost"
    return usable, reason


def judge(
    motion: Motion, usable: np.ndarray, reason: np.ndarray, borrowed: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Quality (n,) and reason (n,) of each frame's angles.

    Arguments:
        motion: the smoothed angles.
        usable: (n,), frames that went into it.
        reason: (n,), why the others did not.
        borrowed: (n,), frames whose pivot comes from their neighbours.
    """
    reason = reason.copy()
    reason[usable] = ""
    reason[motion.outlier] = "outlier"
    inside = np.isfinite(motion.y[:, 0])
    filled = inside & (~usable | motion.outlier)
    reason[filled] = "interpolated"
    reason[motion.margin & ~filled] = "margin"
    reason[~inside & usable & ~motion.outlier] = "short_stretch"
    quality = np.where(inside, MEASURED, UNUSABLE)
    quality[filled | motion.margin] = INTERPOLATED
    reason[(quality == MEASURED) & borrowed] = NO_PIVOT
    return quality, reason


def gap_lengths(present: np.ndarray) -> list[int]:
    """Lengths of the runs of frames that are not present (n,)."""
    edges = np.diff(np.concatenate(([0], (~present).astype(np.int8), [0])))
    return (np.flatnonzero(edges == -1) - np.flatnonzero(edges == 1)).tolist()

"""Which frames of a recording are measured, which are filled or doubtful, which are unusable, and why."""

from __future__ import annotations

import numpy as np
import pandas as pd

from expertaug_recordings.angles.even_times import turns
from expertaug_recordings.angles.marker_table import DISMISSED, DROPPED, REPEATED, TORN, UNTEAR, MarkerTable
from expertaug_recordings.angles.smoothing import Motion
from expertaug_recordings.tables import BLENDED

MEASURED, INTERPOLATED, UNUSABLE = 1.0, 0.5, 0.0  # qualities of a frame's angles
NO_PIVOT = "pivot_interpolated"  # reason of a measured frame whose pivot comes from its neighbours

CORRECTED = "corrected"  # and of one in which a marker was placed by hand
MUCH = np.deg2rad(60.0)  # turn from frame to frame in the median, above which frames are too few to follow
WORDS = {  # reason → what it is of so many frames, and what helps
    REPEATED: ("repeat the one before", "use the video as it was before its frame rate was converted"),
    TORN: ("are torn", UNTEAR),
    BLENDED: ("are mixtures of two", "use the video as it was before its frame rate was converted"),
    DROPPED: ("are missing", ""),
    DISMISSED: ("are dismissed by hand", "look at recordings.corrections"),
    "short_stretch": ("lie in stretches too short between these", ""),
    "margin": ("are at a stretch's ends", "set recordings.angles.smoothing_order to 3"),
    "interpolated": ("are interpolated", ""),
    "arm_length": ("have an arm of another length", "set recordings.angles.arm_tolerance"),
    "outlier": ("are off their neighbours", "set recordings.angles.outlier_floor_deg"),
}


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


def _steps(theta: np.ndarray) -> np.ndarray:
    step = np.abs(turns(theta)).max(1)
    return step[np.isfinite(step)]


def is_crowded(theta: np.ndarray) -> bool:
    """Whether angles (n, 2) in rad turn too far from frame to frame to be followed."""
    step = _steps(theta)
    return bool(len(step) and np.median(step) > MUCH)


def too_few(
    reason: np.ndarray, usable: np.ndarray, theta: np.ndarray, rate: float, longest_gap: int
) -> tuple[str, str]:
    """Why so many frames of a recording cannot be used, and what helps, in plain words.

    Arguments:
        reason: (n,) texts, of each frame.
        usable: (n,), frames that can be used.
        theta: angles of the arms in rad, (n, 2); NaN where they are not known.
        rate: frames per second.
        longest_gap: frames of the longest gap that is filled, however slow the motion.
    """
    texts = pd.Series(reason[~usable]).replace("", "lost").value_counts()
    own = {name: int(count) for name, count in texts.items() if name in WORDS}
    lost = int(texts.sum()) - sum(own.values())
    step = _steps(theta)
    if is_crowded(theta):
        why = f"the arms turn by {np.rad2deg(np.median(step)):.0f}° from frame to frame in the median"
        return why, f"{rate:g} frames/s are too few: record with more"
    named = [f"{count} {WORDS[name][0]}" for name, count in own.items()]
    named = ([f"in {lost} the markers were not found"] if lost else ["all markers were found"]) + named
    if lost > sum(own.values()):
        return ", ".join(named), "check the tracking"
    helps = [WORDS[name][1] for name in own if WORDS[name][1]]
    if BLENDED in own:
        helps.insert(0, WORDS[BLENDED][1])
    elif DROPPED in own or ("short_stretch" in own and REPEATED not in own):
        fastest = 1.5 * float(np.quantile(step, 0.99) * rate) if len(step) else np.inf
        gaps = gap_lengths(~np.isin(reason, (DROPPED, REPEATED, TORN, BLENDED, "lost")))
        if gaps and np.median(gaps) <= min(longest_gap, np.ceil(np.pi * rate / fastest) - 2):
            helps.insert(0, f"set recordings.angles.max_speed to {np.ceil(fastest):.0f}, so that gaps are filled")
        else:
            helps.insert(0, "use a video that has all frames")
    return ", ".join(named), helps[0] if helps else "use a longer video"

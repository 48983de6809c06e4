"""The pendulum in the image: its pivot and its two arms, calibrated on the recording itself."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy.ndimage import uniform_filter1d

from expertaug_recordings.angles.marker_table import MarkerTable
from expertaug_recordings.angles.noise import spread
from expertaug_recordings.angles.offsets import NONE, Offsets, find_offsets
from expertaug_recordings.settings import AngleKeys

STILL_S = 1e6  # a pivot averaged over so long does not move
WINDOWS_S = (STILL_S, 0.16, 0.08, 0.04, 0.02, 0.01, 0.0)  # over which a pivot may be averaged
WORTH = 2.0  # over the root of the frames' number: the share by which a shorter average must lower the length's spread
TOLERANCE = 8.0  # robust standard deviations of an arm's length
AROUND_S, AROUND = 0.5, 0.25  # s, and share of the arm by which a shaking pivot may be off its median over them
TOLERANCES = (0.005, 0.1)  # shares of the arm's length, the least and the most that this may be


@dataclass(frozen=True)
class Arms:
    """Arms of n frames.

    Attributes:
        pivot: place of each frame's pivot in px, (n, 2).
        borrowed: (n,), frames whose pivot was taken from their neighbours.
        window_s: seconds over which the pivot was averaged.
        offsets: of the markers from the hinges.
        vectors: from hinge to hinge in px, (n, 2, 2); NaN where a marker is missing.
        lengths: lengths of these vectors in px, (n, 2).
        typical: their medians over the usable frames in px, (2,).
        tolerance: share of these by which a length may be off, (2,).
    """

    pivot: np.ndarray
    borrowed: np.ndarray
    window_s: float
    offsets: Offsets
    vectors: np.ndarray
    lengths: np.ndarray
    typical: np.ndarray
    tolerance: np.ndarray

    @property
    def off(self) -> np.ndarray:
        """Frames (n,) with an arm that is off its typical length by more than the tolerance."""
        with np.errstate(invalid="ignore"):
            return (np.abs(self.lengths - self.typical) > self.tolerance * self.typical).any(1)

    def angles(self, rotation_deg: float) -> np.ndarray:
        """Angles (n, 2) in rad from where gravity points in the image, wrapped but for that direction's own angle."""
        return np.arctan2(self.vectors[..., 0], self.vectors[..., 1]) - np.deg2rad(rotation_deg)


def find_arms(markers: MarkerTable, usable: np.ndarray, options: AngleKeys) -> Arms:
    """Calibrate pivot, offsets and arms.

    Arguments:
        markers: those of a recording in which the pivot was seen at least once.
        usable: (n,), frames whose joint and tip may be used.
        options: tolerances and windows; what they leave open is told by the lengths themselves.
    """
    filled, seen = _pivot(markers, usable, options.pivot_tolerance)
    if options.pivot_window_s is not None:
        chosen = _arms(markers, usable, filled, ~seen, options.pivot_window_s, options)
    else:
        # A pivot that moves, or a camera that shakes, shows in the length of the first arm.
        chosen = _arms(markers, usable, filled, ~seen, STILL_S, options)
        for window_s in WINDOWS_S[1:]:
            other = _arms(markers, usable, filled, ~seen, window_s, options)
            if _unsteady(other, usable) < (1 - WORTH / usable.sum() ** 0.5) * _unsteady(chosen, usable):
                chosen = other
    if options.arm_tolerance is not None:
        return replace(chosen, tolerance=np.full(2, options.arm_tolerance))
    return chosen


def _arms(
    markers: MarkerTable,
    usable: np.ndarray,
    filled: np.ndarray,
    borrowed: np.ndarray,
    window_s: float,
    options: AngleKeys,
) -> Arms:
    pivot = _averaged(filled, window_s * markers.rate_hz)
    vectors = np.stack((markers.joint - pivot, markers.tip - markers.joint), axis=1)
    offsets = find_offsets(vectors, usable) if options.model_offsets else NONE
    vectors = offsets.remove(vectors)
    lengths = np.linalg.norm(vectors, axis=-1)
    typical = np.median(lengths[usable], axis=0)
    tolerance = np.clip(TOLERANCE * spread(lengths[usable]) / typical, *TOLERANCES)
    return Arms(pivot, borrowed, window_s, offsets, vectors, lengths, typical, tolerance)


def _unsteady(arms: Arms, usable: np.ndarray) -> float:
    return float(spread(arms.lengths[usable, 0]))


def _averaged(places: np.ndarray, frames: float) -> np.ndarray:
    """Places (n, 2), each averaged over its neighbours; over more frames than there are, the median of all."""
    if frames >= 2 * len(places):
        return np.broadcast_to(np.median(places, axis=0), places.shape)
    return uniform_filter1d(places, 2 * round(frames / 2) + 1, axis=0, mode="nearest")


def _pivot(markers: MarkerTable, usable: np.ndarray, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
    """Pivot of each frame, (n, 2): its marker where that is near its median, its neighbours' elsewhere; and the frames
    (n,) in which it was seen.

    On the real recordings the arm's length follows the displacement of the pivot's marker: the stand sways, so a
    constant pivot is wrong; but the labels' own noise (.1 px) need not enter the angle.  Of 200 ms forecasts on the
    fastest parts the log-MSE is -7.99 with a constant pivot, -8.42 with each frame's own and -8.49 averaged over .04 s.

    Where the camera moves, the marker leaves its median with all others, and the first arm keeps its length.
    """
    seen = np.isfinite(markers.pivot).all(1)
    middle = np.median(markers.pivot[seen], axis=0)
    arm = float(np.nanmedian(np.linalg.norm(markers.joint[usable] - middle, axis=1)))
    with np.errstate(invalid="ignore"):
        near = np.linalg.norm(markers.pivot - middle, axis=1) <= tolerance * arm
        if not near[seen].all():
            near |= _moved_along(markers, usable & seen, arm)
    seen &= near
    frames = np.arange(len(markers))
    filled = np.stack([np.interp(frames, frames[seen], markers.pivot[seen, k]) for k in range(2)], axis=1)
    return filled, seen


def _moved_along(markers: MarkerTable, known: np.ndarray, arm: float) -> np.ndarray:
    """Frames (n,) whose pivot's marker is near those of its time and one arm from the joint."""
    length = np.linalg.norm(markers.joint - markers.pivot, axis=1)
    typical, off = float(np.median(length[known])), float(spread(length[known]))
    right = np.abs(length - typical) <= np.clip(TOLERANCE * off, *(share * typical for share in TOLERANCES))
    frames = max(3, round(AROUND_S * markers.rate_hz))
    around = pd.DataFrame(markers.pivot).rolling(frames, center=True, min_periods=1).median().to_numpy()
    return right & (np.linalg.norm(markers.pivot - around, axis=1) <= AROUND * arm)

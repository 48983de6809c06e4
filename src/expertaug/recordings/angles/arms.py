"""The pendulum in the image: its pivot and its two arms, calibrated on the recording itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d

from expertaug.recordings.angles.marker_table import MarkerTable


@dataclass(frozen=True)
class Arms:
    """Arms of n frames.

    Attributes:
        pivot: place of each frame's pivot in px, (n, 2).
        borrowed: (n,), frames whose pivot was taken from their neighbours.
        vectors: from pivot to joint and from joint to tip in px, (n, 2, 2); NaN where a marker is missing.
        lengths: lengths of these vectors in px, (n, 2).
        typical: their medians over the usable frames in px, (2,).
    """

    pivot: np.ndarray
    borrowed: np.ndarray
    vectors: np.ndarray
    lengths: np.ndarray
    typical: np.ndarray

    def off(self, tolerance: float) -> np.ndarray:
        """Frames (n,) with an arm that is off its typical length by more than this share."""
        with np.errstate(invalid="ignore"):
            return (np.abs(self.lengths - self.typical) > tolerance * self.typical).any(1)

    def angles(self, rotation_deg: float) -> np.ndarray:
        """Angles (n, 2) in rad from where gravity points in the image, wrapped but for that direction's own angle."""
        return np.arctan2(self.vectors[..., 0], self.vectors[..., 1]) - np.deg2rad(rotation_deg)


def find_arms(markers: MarkerTable, usable: np.ndarray, tolerance: float, window_s: float) -> Arms:
    """Calibrate pivot and arms.

    Arguments:
        markers: those of a recording in which the pivot was seen at least once.
        usable: (n,), frames whose joint and tip may be used.
        tolerance: a pivot's marker off its median by more than this share of the first arm is another thing.
        window_s: the pivot is averaged over so many seconds.
    """
    pivot, borrowed = _pivot(markers, usable, tolerance, window_s)
    vectors = np.stack((markers.joint - pivot, markers.tip - markers.joint), axis=1)
    lengths = np.linalg.norm(vectors, axis=-1)
    return Arms(pivot, borrowed, vectors, lengths, np.median(lengths[usable], axis=0))


def _pivot(
    markers: MarkerTable, usable: np.ndarray, tolerance: float, window_s: float
) -> tuple[np.ndarray, np.ndarray]:
    """Pivot of each frame, (n, 2): its marker where that is near its median, neighbours elsewhere, averaged over a
    window; and the frames (n,) in which it was taken from neighbours.

    On the real recordings the arm's length follows the displacement of the pivot's marker: the stand sways, so a
    constant pivot is wrong; but the labels' own noise (.1 px) need not enter the angle.  Of 200 ms forecasts on the
    fastest parts the log-MSE is -7.99 with a constant pivot, -8.42 with each frame's own and -8.49 averaged over .04 s.
    """
    seen = np.isfinite(markers.pivot).all(1)
    middle = np.median(markers.pivot[seen], axis=0)
    arm = float(np.nanmedian(np.linalg.norm(markers.joint[usable] - middle, axis=1)))
    with np.errstate(invalid="ignore"):
        seen &= np.linalg.norm(markers.pivot - middle, axis=1) <= tolerance * arm
    frames = np.arange(len(markers))
    filled = np.stack([np.interp(frames, frames[seen], markers.pivot[seen, k]) for k in range(2)], axis=1)
    size = 2 * round(window_s * markers.rate_hz / 2) + 1
    return uniform_filter1d(filled, size, axis=0, mode="nearest"), ~seen

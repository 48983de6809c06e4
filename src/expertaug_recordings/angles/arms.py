"""The pendulum in the image: its pivot, its two arms and its markers' offsets, calibrated on the recording itself.

How far markers are off their hinges is told by how the arms' lengths vary.

With e(θ) and n(θ) along and across an arm, the vectors between the markers are

    v1 = l1 e(θ1) + p + m1 + m2        v2 = l2 e(θ2) − m1 − m2 + g,

p by how much the pivot's marker is off (fixed in the image), m1 = a e(θ1) + b n(θ1) and m2 = c e(θ2) + d n(θ2) the
joint's marker off its hinge on the first or on the second arm, and g what is fixed in the image at the second arm.
Markers in planes of different distance from the camera look like that too: the second arm then gets a share of the
first.  Of m1 the first arm's length tells nothing, but the second's varies with cos(θ2 − θ1) and sin(θ2 − θ1); of m2
the first's does; and p and g vary the lengths with the direction of their own arm.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy.ndimage import uniform_filter1d

from expertaug_recordings.angles.marker_table import MarkerTable
from expertaug_recordings.angles.noise import PASSES, fit_trimmed, spread
from expertaug_recordings.settings import AngleKeys

MOST = 5000  # frames or a little more, which tell enough
CERTAIN = 10.0  # standard errors of white noise; those of correlated noise are about a third as certain
WILD = 0.3  # of an arm's length, by which no offset changes it
GROUPS = ("pivot", "joint_arm2", "joint_arm1", "tip")  # two of each arm's length: first p, m2, then m1, g
STILL_S = 1e6  # a pivot averaged over so long does not move
WORTH = 2.0  # over the root of the frames' number: the share by which a shorter average must lower the length's spread
TOLERANCE = 8.0  # robust standard deviations of an arm's length
AROUND_S, AROUND = 0.5, 0.25  # s, and share of the arm by which a shaking pivot may be off its median over them
TOLERANCES = (0.005, 0.1)  # shares of the arm's length, the least and the most that this may be
WINDOWS_S = (STILL_S, 0.16, 0.08, 0.04, 0.02, 0.01, 0.0)  # over which a pivot may be averaged


@dataclass(frozen=True)
class Offsets:
    """Offsets in px, (2,) each and 0 where there is none that the lengths tell for certain.

    Attributes:
        pivot, tip: (x, y) in the image.
        joint_arm1, joint_arm2: of the joint's marker from its hinge, along and across the arm on which it sits.
    """

    pivot: np.ndarray
    joint_arm1: np.ndarray
    joint_arm2: np.ndarray
    tip: np.ndarray

    @property
    def sizes(self) -> dict[str, float]:
        """In px, of those that are not 0."""
        sizes = {name: float(np.hypot(*getattr(self, name))) for name in GROUPS}
        return {name: size for name, size in sizes.items() if size > 0}

    def remove(self, vectors: np.ndarray) -> np.ndarray:
        """Vectors (n, 2, 2) between hinges, of those between markers."""
        true = vectors
        for _ in range(PASSES):  # the offsets turn with the true angles
            first, second = (_axes(true[:, k]) for k in (0, 1))
            joint = np.einsum("nij,i->nj", first, self.joint_arm1) + np.einsum("nij,i->nj", second, self.joint_arm2)
            true = np.stack((vectors[:, 0] - self.pivot - joint, vectors[:, 1] + joint - self.tip), axis=1)
        return true


NONE = Offsets(*np.zeros((4, 2)))


def find_offsets(vectors: np.ndarray, usable: np.ndarray) -> Offsets:
    """Offsets by robust least squares of the arms' squared lengths.

    Arguments:
        vectors: between the markers in px, (n, 2, 2).
        usable: (n,), frames that count.
    """
    offsets = dict.fromkeys(GROUPS, np.zeros(2))
    seen = vectors[usable]
    seen = seen[:: max(1, len(seen) // MOST)]
    for _ in range(PASSES):
        true = Offsets(**offsets).remove(seen)
        step = {}
        for k in (0, 1):
            step |= _harmonics(true, k, offsets)
        offsets = {name: offsets[name] + step[name] for name in GROUPS}
    return Offsets(**offsets)


def _axes(vectors: np.ndarray) -> np.ndarray:
    """Unit vectors (n, 2, 2) along and across vectors (n, 2)."""
    along = vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9)
    return np.stack((along, np.stack((-along[:, 1], along[:, 0]), axis=-1)), axis=1)


def _harmonics(vectors: np.ndarray, k: int, offsets: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Changes of the two offsets that arm k's length tells of; 0 for one that is not certain, or smaller than the
    lengths' noise."""
    own, other = _axes(vectors[:, k])[:, 0], _axes(vectors[:, 1 - k])
    length = np.linalg.norm(vectors[:, k], axis=-1)
    # |l e + o|² = l² + 2 l e·o + ..., for an offset o that is fixed in the image, or turns with the other arm
    sign = 1.0 if k == 0 else -1.0
    columns = [np.einsum("nj,nij->ni", own, other) * sign, own]
    design = np.concatenate((np.ones((len(own), 1)), *columns), axis=1)
    typical = float(np.median(length))
    target = (length**2 - typical**2) / (2 * typical)
    x, _, _, noise, inverse = fit_trimmed(design, target, np.abs(target) < WILD * typical)
    names = ("joint_arm2", "pivot") if k == 0 else ("joint_arm1", "tip")
    change = {}
    for name, first in zip(names, (1, 3), strict=True):
        error = noise * np.sqrt(np.trace(inverse[first : first + 2, first : first + 2]))
        total = offsets[name] + x[first : first + 2]
        sure = np.hypot(*total) > max(CERTAIN * error, noise)
        change[name] = x[first : first + 2] if sure else -offsets[name]
    return change


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
    pivot = _average(filled, window_s * markers.rate_hz)
    vectors = np.stack((markers.joint - pivot, markers.tip - markers.joint), axis=1)
    offsets = find_offsets(vectors, usable) if options.model_offsets else NONE
    vectors = offsets.remove(vectors)
    lengths = np.linalg.norm(vectors, axis=-1)
    typical = np.median(lengths[usable], axis=0)
    tolerance = np.clip(TOLERANCE * spread(lengths[usable]) / typical, *TOLERANCES)
    return Arms(pivot, borrowed, window_s, offsets, vectors, lengths, typical, tolerance)


def _unsteady(arms: Arms, usable: np.ndarray) -> float:
    return float(spread(arms.lengths[usable, 0]))


def _average(places: np.ndarray, frames: float) -> np.ndarray:
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
            near |= _find_moving(markers, usable & seen, arm)
    seen &= near
    frames = np.arange(len(markers))
    filled = np.stack([np.interp(frames, frames[seen], markers.pivot[seen, k]) for k in range(2)], axis=1)
    return filled, seen


def _find_moving(markers: MarkerTable, usable: np.ndarray, arm: float) -> np.ndarray:
    """Frames (n,) whose pivot's marker is near those of its time and one arm from the joint."""
    length = np.linalg.norm(markers.joint - markers.pivot, axis=1)
    typical, off = float(np.median(length[usable])), float(spread(length[usable]))
    right = np.abs(length - typical) <= np.clip(TOLERANCE * off, *(share * typical for share in TOLERANCES))
    frames = max(3, round(AROUND_S * markers.rate_hz))
    around = pd.DataFrame(markers.pivot).rolling(frames, center=True, min_periods=1).median().to_numpy()
    return right & (np.linalg.norm(markers.pivot - around, axis=1) <= AROUND * arm)

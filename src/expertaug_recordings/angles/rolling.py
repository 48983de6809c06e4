"""A shutter that rolls, rows of the image being read one after another: found by the second arm's length, and undone.

A marker in row y of the image is seen a time τ y after the first row.  The joint moves across the first arm, whose
length therefore hardly changes; but the tip is seen τ Δy later than the joint, which by then has moved on, so that the
second arm's length is off by τ Δy times the joint's speed along that arm.  Its share in the length's variance tells τ.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from expertaug_recordings.angles.even_times import from_polar, interpolate_arm, turns
from expertaug_recordings.angles.marker_table import DROPPED, MarkerTable
from expertaug_recordings.angles.noise import fit_trimmed, spread

ROUNDS = 3
CERTAIN = 12.0  # standard errors by which τ is more than none
STEADIER = 1.25  # times, that the second arm's length must become
FEWEST = 40  # frames


@dataclass(frozen=True)
class Rolling:
    """A shutter that rolls.

    Attributes:
        row_s: seconds from one row to the next; negative where the last is read first.
        undone: whether the markers were put to one time.
    """

    row_s: float
    undone: bool

    @property
    def warning(self) -> str:
        """What was found and done, in plain words."""
        finding = f"the shutter rolls, {1e6 * abs(self.row_s):.1f} µs from row to row, as the second arm's length tells"
        if self.undone:
            return f"{finding}: the markers were put to the times of the first row; a global shutter is better"
        return f"{finding}, and turns too far between frames to be undone: the uncertainties were widened"


def undo_rolling(seen: MarkerTable, usable: np.ndarray) -> tuple[MarkerTable, Rolling | None]:
    """The markers as they were when the first row was read; unchanged where the lengths tell of no such shutter.

    Arguments:
        seen: a double pendulum's markers in the image.
        usable: (n,), frames that count.
    """
    usable = usable & np.isfinite(seen.places).all((1, 2))
    row_s, moved = 0.0, seen
    for turn in range(
        ROUNDS
    ):  # speeds by differences of neighbouring frames are too small: what is left is found again
        fit = _row_s(moved, usable & np.isfinite(moved.places).all((1, 2)))
        if fit is None or (turn == 0 and not fit.certain):
            break
        row_s += fit.row_s
        tried = _without(seen, usable, row_s)
        if tried is None:
            return _widen(seen, row_s), Rolling(row_s, False)
        moved = tried
    still_usable = usable & np.isfinite(moved.places).all((1, 2))
    if moved is seen or _spread(seen, usable) < STEADIER * _spread(moved, still_usable):
        return seen, None
    return moved, Rolling(row_s, True)


@dataclass(frozen=True)
class _Found:
    """Seconds from row to row, their standard error, and the factor by which lengths are less spread without."""

    row_s: float
    error: float
    steadier: float

    @property
    def certain(self) -> bool:
        return abs(self.row_s) > CERTAIN * self.error and self.steadier > STEADIER


def _spread(markers: MarkerTable, usable: np.ndarray) -> float:
    return float(spread(np.linalg.norm(markers.tip - markers.joint, axis=1)[usable]))


def _row_s(markers: MarkerTable, usable: np.ndarray) -> _Found | None:
    """Seconds from row to row, by robust least squares of the second arm's length.

    What markers off their hinges do to it is fitted beside.
    """
    vectors = np.where(usable[:, None, None], np.diff(markers.places, axis=1), np.nan)
    length = np.linalg.norm(vectors, axis=2)
    along = vectors / length[..., None]
    speed = np.gradient(markers.joint, axis=0) * markers.rate_hz
    late = (speed * along[:, 1]).sum(1) * vectors[:, 1, 1]
    turned = np.stack(((along[:, 0] * along[:, 1]).sum(1), np.cross(along[:, 0], along[:, 1])), axis=1)
    design = np.column_stack((late, np.ones(len(late)), turned, along[:, 1]))
    finite = np.isfinite(design).all(1) & np.isfinite(length[:, 1])
    if finite.sum() < FEWEST:
        return None
    design, target = design[finite], length[finite, 1]
    x, off, used, noise, inverse = fit_trimmed(design, target, np.ones(len(target), bool))
    steadier = float(spread(off[used] + x[0] * design[used, 0])) / noise
    return _Found(float(x[0]), noise * float(np.sqrt(inverse[0, 0])), steadier)


def _without(seen: MarkerTable, usable: np.ndarray, row_s: float) -> MarkerTable | None:
    """Markers at the times of the first row; None where a marker's own times do not grow."""
    t, usable = seen.t, usable.copy()
    own = [t + row_s * np.where(usable, place[:, 1], 0.0) for place in (seen.joint, seen.tip)]
    rows = np.flatnonzero(usable)
    if any((np.diff(s[rows]) <= 0).any() for s in own):
        return None
    arm = seen.joint - seen.pivot
    first, length1, error1 = interpolate_arm(own[0][rows], arm[rows], own[1])
    joint = seen.pivot + from_polar(first, length1)
    second = seen.tip - joint
    whole = rows[np.isfinite(second[rows]).all(1)]
    theta1, length1, error1 = interpolate_arm(own[0][rows], arm[rows], t)
    theta2, length2, error2 = interpolate_arm(own[1][whole], second[whole], t)
    joint = seen.pivot + from_polar(theta1, length1)
    tip = joint + from_polar(theta2, length2)
    lost = usable & ~np.isfinite(tip).all(1)
    reason, quality = np.where(lost, DROPPED, seen.reason), np.where(lost, 0.0, seen.quality)
    joint, tip = (
        np.where(usable[:, None], place, seen_at) for place, seen_at in ((joint, seen.joint), (tip, seen.tip))
    )
    moved = replace(seen, joint=joint, tip=tip, reason=reason, quality=quality)
    return _with_error(moved, np.stack((error1, error2), axis=1))


def _widen(seen: MarkerTable, row_s: float) -> MarkerTable:
    """The same with what the angles are off by, their turns in the time between the rows in which the markers are."""
    vectors = np.diff(seen.places, axis=1)
    turn = turns(np.arctan2(vectors[..., 0], vectors[..., 1]))
    speed = np.abs(np.concatenate((turn[:1], turn))) * seen.rate_hz
    rows = np.nanstd(np.stack((seen.joint[:, 1], seen.tip[:, 1]), axis=1), axis=0)
    return _with_error(seen, abs(row_s) * rows * speed)


def _with_error(markers: MarkerTable, error: np.ndarray) -> MarkerTable:
    earlier = markers.interpolation
    return replace(markers, interpolation=error if earlier is None else np.hypot(earlier, error))

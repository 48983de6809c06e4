"""Following the three markers of one pendulum from frame to frame.

Each marker is predicted from the last frames and fitted there (:mod:`expertaug_recordings.markers.disks`); one that is
not at its predicted place is searched on the ring that its arm allows round its parent, and only without a parent in
the whole frame.  A marker that is not found stays missing: no position is invented.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from expertaug_recordings.markers.disks import Disks, fitter
from expertaug_recordings.markers.geometry import WIDE, Geometry, best, sound
from expertaug_recordings.settings import TrackMarkersJob
from expertaug_recordings.video.pixel_layout import KeptFrame

PIVOT, JOINT, TIP = range(3)
# px of a plain diameter, where nothing is given: of an arm's length, of the ring that is searched, of residuals
ARM, SEARCH, RESIDUAL = 2.0, 10.0, 0.6
STIFFNESS = 5.0  # once the diameter is known: a disk covered by a quarter is then .3 px off instead of 2 px
MOST_RESIDUAL = 1.2  # px of quadrants of a plain diameter
UNUSABLE = 0.0


@dataclass(frozen=True)
class Track:
    """Marker positions of n frames.

    Attributes:
        position: (n, 3, 2) x, y in px of pivot, joint and tip; NaN where the marker was not found.
        quality: (n,) share of rim points that agree with the worst of the disks, halved at the image's ``edge``;
            0 where the frame is unusable.
        reason: n words: empty, or why a frame is unusable (``lost:<marker>[+<marker>]``, ``arm_length``, ``residual``)
            or doubtful (``edge``, ``blended``).
    """

    position: np.ndarray
    quality: np.ndarray
    reason: list[str]


def track_frames(frames: Iterable[np.ndarray | KeptFrame], geometry: Geometry, settings: TrackMarkersJob) -> Track:
    """Track consecutive, evenly timed frames, BGR (H, W, 3) or as kept, of a pendulum with these lengths."""
    tracker = Tracker(geometry, settings)
    rows = [tracker.step(frame) for frame in frames]
    position = np.array([row[0] for row in rows]).reshape(-1, 3, 2)
    return Track(position, np.array([row[1] for row in rows]), [row[2] for row in rows])


class Tracker:
    """Finds the markers of one frame after the other.

    Arguments:
        geometry: the recording's lengths and pivot.
        settings: checked settings.
    """

    def __init__(self, geometry: Geometry, settings: TrackMarkersJob) -> None:
        self.arms = (geometry.arm1, geometry.arm2)
        self.settings = settings
        self.appearance = settings.appearance
        self.fitter = fitter(geometry.diameter, settings.min_level, settings.rim_tolerance, self.appearance, STIFFNESS)
        scale = settings.scale
        spread = [WIDE * sigma for sigma in geometry.spread]
        self.arm_tolerance = [settings.arm_tolerance_px or max(ARM * scale, arm_spread) for arm_spread in spread]
        self.arm_search = settings.arm_search_px or max(SEARCH * scale, *spread)
        # Nothing is burnt into quadrants: what their insides are off is error, more of it after strong compression.
        most = MOST_RESIDUAL * scale if self.appearance.style == "quadrant" else math.inf
        usual = [
            settings.max_residual_px or min(max(RESIDUAL * scale, residual), most) for residual in geometry.residual
        ]
        self.residual = usual
        self.names = self.appearance.names[: self.appearance.last]
        self.twins = geometry.twins
        self.pivot = None if geometry.pivot is None else np.array(geometry.pivot)
        self.angles: tuple[list[float], list[float]] = ([], [])  # of both arms in the last frames without a gap

    def step(self, frame: np.ndarray | KeptFrame) -> tuple[np.ndarray, float, str]:
        """Positions (3, 2), quality and reason of the next frame."""
        first = self.appearance.first
        centre = np.full((3, 2), np.nan)
        if first:
            centre[PIVOT] = self.pivot
        share, residual = np.zeros(3), np.zeros(3)
        predicted = self._predict()[first : self.appearance.last]
        disks = self.fitter.fit(frame, np.array(predicted)) if predicted else None
        there = sound(disks, self.settings).tolist() if predicted else ()
        identity = disks.identity.tolist() if predicted else ()
        for k in range(first, self.appearance.last):
            index = k - first
            seen = index < len(predicted) and there[index] and identity[index] == k
            if seen and self._fits_arm(k, disks.centre[index], centre):
                fitted = disks
            else:
                fitted, index = self._search(frame, k, centre)
            if index is not None:
                centre[k], share[k], residual[k] = fitted.centre[index], fitted.share[index], fitted.residual[index]
        self._remember(centre)
        return centre, *self._judge(frame, centre, share, residual)

    def _predict(self) -> list[np.ndarray]:
        """Where the first markers should be, as many as the past tells: angles go on with constant acceleration."""
        places = [] if self.pivot is None else [self.pivot]
        for past, arm in zip(self.angles, self.arms, strict=True):
            if not places or not past:
                break
            angle = _next(past)
            places.append(places[-1] + arm * np.array([math.sin(angle), math.cos(angle)]))
        return places

    def _fits_arm(self, k: int, place: np.ndarray, centre: np.ndarray) -> bool:
        """Whether marker k at this place is one arm away from its parent, if that was found."""
        if k == PIVOT or math.isnan(centre[k - 1, 0]):
            return True
        return abs(math.dist(place, centre[k - 1]) - self.arms[k - 1]) < self.arm_tolerance[k - 1]

    def _search(self, frame: np.ndarray | KeptFrame, k: int, centre: np.ndarray) -> tuple[Disks | None, int | None]:
        """Look for marker k where its arm allows it, or everywhere if its parent is missing."""
        image = frame.image if isinstance(frame, KeptFrame) else frame
        window, origin, ring = image, np.zeros(2), None
        if k != PIVOT and not math.isnan(centre[k - 1, 0]):
            ring = self.arms[k - 1]
            reach = ring + self.arm_search + self.fitter.radius + 2
            low = np.maximum(np.floor(centre[k - 1] - reach), 0).astype(int)
            high = np.maximum(np.ceil(centre[k - 1] + reach).astype(int) + 1, 0)
            window, origin = image[low[1] : high[1], low[0] : high[0]], low
        places = self.fitter.candidates(window) + origin
        if ring is not None:
            distance = np.hypot(*(places - centre[k - 1]).T)
            places = places[np.abs(distance - ring) < self.arm_search]
        if not len(places):
            return None, None
        disks = self.fitter.fit(image, places)
        return disks, best(disks, k, self.settings, self.twins[k])

    def _remember(self, centre: np.ndarray) -> None:
        if not math.isnan(centre[PIVOT, 0]):
            self.pivot = centre[PIVOT]
        for k in (JOINT, TIP):
            past = self.angles[k - 1]
            x, y = centre[k] - centre[k - 1]
            if math.isnan(x):
                past.clear()
                continue
            angle = math.atan2(x, y)
            if past:  # the turn nearest to constant speed
                angle += 2 * math.pi * round((_next(past[-2:]) - angle) / (2 * math.pi))
            past.append(angle)
            del past[:-3]

    def _judge(
        self, frame: np.ndarray | KeptFrame, centre: np.ndarray, share: np.ndarray, residual: np.ndarray
    ) -> tuple[float, str]:
        """Quality and reason of a frame."""
        first, last = self.appearance.first, self.appearance.last
        places = centre[:last].tolist()
        missing = [math.isnan(x) for x, _ in places]
        lost = [name for name, gone in zip(self.names, missing, strict=True) if gone]
        if any(missing[JOINT:]):
            return UNUSABLE, "lost:" + "+".join(lost)
        if not all(self._fits_arm(k, centre[k], centre) for k in range(JOINT, last)):
            return UNUSABLE, "arm_length"
        if any(marker_residual > most for marker_residual, most in zip(residual.tolist(), self.residual, strict=True)):
            return UNUSABLE, "residual"
        if lost:  # the pivot alone, whose neighbours tell where it is: the others must be sound for that
            return UNUSABLE, "lost:" + "+".join(lost)
        quality = min(share[first:last].tolist())
        height, width = frame.shape[:2]
        near = self.fitter.radius
        if all(near <= x <= width - 1 - near and near <= y <= height - 1 - near for x, y in places[first:]):
            return quality, ""
        return quality / 2, "edge"


def _next(past: list[float]) -> float:
    """The value after one to three evenly timed ones by the polynomial through them."""
    if len(past) == 1:
        return past[0]
    if len(past) == 2:
        return 2 * past[1] - past[0]
    return 3 * past[2] - 3 * past[1] + past[0]

"""Following the three markers of one pendulum from frame to frame.

Each marker is predicted from the last frames and fitted there (:mod:`expertaug.recordings.disks`); one that is not at
its predicted place is searched on the ring that its arm allows round its parent, and only without a parent in the whole
frame.  A marker that is not found stays missing: no position is invented.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from expertaug.errors import InputError
from expertaug.recordings.disks import NAMES, DiskFitter, Disks
from expertaug.recordings.options import read_settings

RED, GREEN, BLUE = range(3)
STIFFNESS = 5.0  # once the diameter is known: a disk covered by a quarter is then .3 px off instead of 2 px
UNUSABLE = 0.0


@dataclass(frozen=True)
class TrackSettings:
    """Settings of the tracker; lengths in px.

    Attributes:
        marker_diameter_px: approximate diameter of a marker in the frames.
        arm1_px, arm2_px: pivot to joint and joint to tip; null: estimated from frames spread over the recording.
        arm_tolerance_px: an arm further than this from its length makes the frame unusable (``arm_length``).
        arm_search_px: half width of the ring round the parent in which a marker is searched.
        diameter_tolerance_px: a fitted disk may differ this much from the expected diameter.
        rim_tolerance_px: a rim point this near the fitted circle counts as on it.
        min_rim_share: share of rim points on the circle up to which a disk is not taken for a marker.
        max_residual_px: distance between the rim's and the quadrants' centre above which a frame is unusable
            (``residual``: something covers a part of the marker).
        min_level: luma, 0 to 255, that the darkest sector of a marker exceeds and the background does not.
        calibration_frames: frames from which arm lengths and diameter are estimated.
        max_lost_share: share of unusable frames above which the video is refused.
    """

    marker_diameter_px: float = 25.0
    arm1_px: float | None = None
    arm2_px: float | None = None
    arm_tolerance_px: float = 2.0
    arm_search_px: float = 10.0
    diameter_tolerance_px: float = 4.0
    rim_tolerance_px: float = 0.6
    min_rim_share: float = 0.5
    max_residual_px: float = 0.6
    min_level: float = 24.0
    calibration_frames: int = 60
    max_lost_share: float = 0.25

    @classmethod
    def from_mapping(cls, settings: Mapping[str, object] | None) -> TrackSettings:
        """Read and check a mapping.

        Raises:
            InputError: a key is unknown or a value out of range.
        """
        where = "track_markers settings"
        made = read_settings(cls, settings, "track_markers")
        for name, value in vars(made).items():
            if value is None and name in ("arm1_px", "arm2_px"):
                continue
            if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value < math.inf:
                raise InputError(where, f"{name} is {value!r}", "it must be a number of 0 or more")
        limits = {
            "marker_diameter_px": (8, 400),
            "min_rim_share": (0, 1),
            "max_lost_share": (0, 1),
            "min_level": (1, 254),
        }
        for name, (low, high) in limits.items():
            if not low <= getattr(made, name) <= high:
                raise InputError(where, f"{name} is {getattr(made, name)}", f"it must be from {low} to {high}")
        for name in ("arm1_px", "arm2_px", "calibration_frames"):
            value = getattr(made, name)
            if value is not None and value < 1:
                raise InputError(where, f"{name} is {value}", "it must be 1 or more")
        return made


@dataclass(frozen=True)
class Geometry:
    """Lengths of one recording's pendulum in px: pivot to joint, joint to tip, diameter of a marker."""

    arm1: float
    arm2: float
    diameter: float


@dataclass(frozen=True)
class Track:
    """Marker positions of n frames.

    Attributes:
        position: (n, 3, 2) x, y in px of red, green and blue; NaN where the marker was not found.
        quality: (n,) share of rim points that agree with the worst of the three disks, halved at the image's ``edge``;
            0 where the frame is unusable.
        reason: n words: empty, or why a frame is unusable (``lost:<marker>[+<marker>]``, ``arm_length``, ``residual``)
            or doubtful (``edge``).
    """

    position: np.ndarray
    quality: np.ndarray
    reason: list[str]

    @property
    def found(self) -> np.ndarray:
        """(n, 3) whether each marker was found."""
        return np.isfinite(self.position[:, :, 0])


def estimate_geometry(frames: Iterable[np.ndarray], settings: TrackSettings) -> tuple[Geometry | None, Counter]:
    """Medians over the frames in which all three markers are found, without any knowledge of where they are.

    Arguments:
        frames: BGR frames (H, W, 3) in any order.

    Returns:
        The lengths (None if fewer than three frames, or than all there are, show all markers), and in how many frames
        each colour, ``all`` three and anything at all (``frames``) was looked for and found.
    """
    fitter = DiskFitter(settings.marker_diameter_px, settings.min_level, settings.rim_tolerance_px)
    lengths, found = [], Counter()
    for frame in frames:
        found["frames"] += 1
        places = fitter.candidates(frame)
        if not len(places):
            continue
        disks = fitter.fit(frame, places)
        best = [_best(disks, k, settings) for k in range(3)]
        found.update(name for name, place in zip(NAMES, best, strict=True) if place is not None)
        if None not in best:
            found["all"] += 1
            red, green, blue = disks.centre[best]
            lengths.append((math.dist(red, green), math.dist(green, blue), 2 * disks.radius[best].mean()))
    if len(lengths) < max(1, min(3, found["frames"])):
        return None, found
    return Geometry(*np.median(lengths, axis=0).tolist()), found


def track_frames(frames: Iterable[np.ndarray], geometry: Geometry, settings: TrackSettings) -> Track:
    """Track consecutive, evenly timed BGR frames (H, W, 3) of a pendulum with these lengths."""
    tracker = Tracker(geometry, settings)
    rows = [tracker.step(frame) for frame in frames]
    position = np.array([row[0] for row in rows]).reshape(-1, 3, 2)
    return Track(position, np.array([row[1] for row in rows]), [row[2] for row in rows])


class Tracker:
    """Finds the markers of one frame after the other.

    Arguments:
        geometry: of the recording.
        settings: checked settings.
    """

    def __init__(self, geometry: Geometry, settings: TrackSettings) -> None:
        self.arms = (geometry.arm1, geometry.arm2)
        self.settings = settings
        self.fitter = DiskFitter(geometry.diameter, settings.min_level, settings.rim_tolerance_px, STIFFNESS)
        self.pivot: np.ndarray | None = None
        self.angles: tuple[list[float], list[float]] = ([], [])  # of both arms in the last frames without a gap

    def step(self, frame: np.ndarray) -> tuple[np.ndarray, float, str]:
        """Positions (3, 2), quality and reason of the next frame."""
        centre = np.full((3, 2), np.nan)
        share, residual = np.zeros(3), np.zeros(3)
        predicted = self._predict()
        disks = self.fitter.fit(frame, np.array(predicted)) if predicted else None
        sound = _sound(disks, self.settings) & (disks.identity == range(len(predicted))) if predicted else ()
        for k in range(3):
            if k < len(predicted) and sound[k] and self._fits_arm(k, disks.centre[k], centre):
                found, index = disks, k
            else:
                found, index = self._search(frame, k, centre)
            if index is not None:
                centre[k], share[k], residual[k] = found.centre[index], found.share[index], found.residual[index]
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
        if k == RED or math.isnan(centre[k - 1, 0]):
            return True
        return abs(math.dist(place, centre[k - 1]) - self.arms[k - 1]) < self.settings.arm_tolerance_px

    def _search(self, frame: np.ndarray, k: int, centre: np.ndarray) -> tuple[Disks | None, int | None]:
        """Look for marker k where its arm allows it, or everywhere if its parent is missing."""
        window, origin, ring = frame, np.zeros(2), None
        if k != RED and not math.isnan(centre[k - 1, 0]):
            ring = self.arms[k - 1]
            reach = ring + self.settings.arm_search_px + self.fitter.radius + 2
            low = np.maximum(np.floor(centre[k - 1] - reach), 0).astype(int)
            high = np.ceil(centre[k - 1] + reach).astype(int) + 1
            window, origin = frame[low[1] : high[1], low[0] : high[0]], low
        places = self.fitter.candidates(window) + origin
        if ring is not None:
            distance = np.hypot(*(places - centre[k - 1]).T)
            places = places[np.abs(distance - ring) < self.settings.arm_search_px]
        if not len(places):
            return None, None
        disks = self.fitter.fit(frame, places)
        return disks, _best(disks, k, self.settings)

    def _remember(self, centre: np.ndarray) -> None:
        if not math.isnan(centre[RED, 0]):
            self.pivot = centre[RED]
        for k in (GREEN, BLUE):
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
        self, frame: np.ndarray, centre: np.ndarray, share: np.ndarray, residual: np.ndarray
    ) -> tuple[float, str]:
        """Quality and reason of a frame."""
        lost = [name for name, x in zip(NAMES, centre[:, 0], strict=True) if math.isnan(x)]
        if lost:
            return UNUSABLE, "lost:" + "+".join(lost)
        if not all(self._fits_arm(k, centre[k], centre) for k in (GREEN, BLUE)):
            return UNUSABLE, "arm_length"
        if residual.max() > self.settings.max_residual_px:
            return UNUSABLE, "residual"
        quality = float(share.min())
        height, width = frame.shape[:2]
        margin = self.fitter.radius
        if centre.min() < margin or (centre.max(axis=0) > (width - 1 - margin, height - 1 - margin)).any():
            return quality / 2, "edge"
        return quality, ""


def _next(past: list[float]) -> float:
    """The value after one to three evenly timed ones by the polynomial through them."""
    if len(past) == 1:
        return past[0]
    if len(past) == 2:
        return 2 * past[1] - past[0]
    return 3 * past[2] - 3 * past[1] + past[0]


def _sound(disks: Disks, settings: TrackSettings) -> np.ndarray:
    """(m,) whether what was fitted is a disk of the right size."""
    size = np.abs(2 * disks.radius - settings.marker_diameter_px) < settings.diameter_tolerance_px
    return size & (disks.share > settings.min_rim_share)


def _best(disks: Disks, k: int, settings: TrackSettings) -> int | None:
    """The sound disk of colour k with the cleanest rim."""
    share = np.where(_sound(disks, settings) & (disks.identity == k), disks.share, 0)
    best = int(share.argmax())
    return best if share[best] > 0 else None

"""Lengths of one recording's pendulum, measured on frames of which nothing else is known."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from expertaug.errors import InputError
from expertaug.recordings.markers.appearance import WHERE
from expertaug.recordings.markers.plain_disks import fitter
from expertaug.recordings.markers.quadrant_disks import Disks
from expertaug.recordings.markers.settings import TrackSettings

DIAMETERS = (8.0, 1.25)  # px of the smallest that is tried where none is given, and the step to the next
LARGEST = 0.25  # of the image's shorter side
MIN_ARC_DEG = 40.0  # of the joint's circle: its centre is then known to about the markers' own error


@dataclass(frozen=True)
class Geometry:
    """Lengths of one recording's pendulum in px: pivot to joint, joint to tip, diameter of a marker; and the place
    (x, y) of a pivot that bears no marker."""

    arm1: float
    arm2: float
    diameter: float
    pivot: tuple[float, float] | None = None


def estimate_geometry(frames: Iterable[np.ndarray], settings: TrackSettings) -> tuple[Geometry | None, Counter]:
    """Medians over the frames in which all markers are found, without any knowledge of where they are.

    Arguments:
        frames: BGR frames (H, W, 3) in any order.
        settings: with a diameter.

    Returns:
        The lengths (None if fewer than three frames, or than all there are, show all markers), and in how many frames
        each marker by its name, ``all`` of them and anything at all (``frames``) was looked for and found.

    Raises:
        InputError: the pivot bears no marker and the joint's way does not tell where it is.
    """
    appearance = settings.markers
    finder = fitter(settings.marker_diameter_px, settings.min_level, settings.rim_tolerance_px, appearance)
    centres, diameters, found = [], [], Counter()
    for frame in frames:
        found["frames"] += 1
        places = finder.candidates(frame)
        if not len(places):
            continue
        disks = finder.fit(frame, places)
        chosen = [best(disks, k, settings) for k in range(appearance.first, 3)]
        found.update(
            name for name, place in zip(appearance.names[appearance.first :], chosen, strict=True) if place is not None
        )
        if None not in chosen:
            found["all"] += 1
            centres.append(disks.centre[chosen])
            diameters.append(2 * disks.radius[chosen].mean())
    if len(centres) < max(1, min(3, found["frames"])):
        return None, found
    centre = np.array(centres, np.float64)
    pivot = None
    if appearance.pivot is None:
        pivot = appearance.pivot_px or centre_of_circle(centre[:, 0])
        centre = np.concatenate((np.broadcast_to(pivot, (len(centre), 1, 2)), centre), axis=1)
    arm1, arm2 = np.median(np.linalg.norm(np.diff(centre, axis=1), axis=2), axis=0).tolist()
    return Geometry(arm1, arm2, float(np.median(diameters)), pivot), found


def measure_diameter(frames: Sequence[np.ndarray], settings: TrackSettings) -> float | None:
    """Diameter in px with which the markers are seen in most of the frames and with the cleanest rims; None for none.

    Arguments:
        frames: BGR frames (H, W, 3).
    """
    smallest, step = DIAMETERS
    count = math.floor(math.log(LARGEST * min(frames[0].shape[:2]) / smallest) / math.log(step)) + 1
    scores = []
    for diameter in smallest * step ** np.arange(max(1, count)):
        tried = settings.model_copy(
            update={"marker_diameter_px": diameter, "diameter_tolerance_px": (step - 1) * diameter}
        )
        finder = fitter(diameter, settings.min_level, settings.rim_tolerance_px, settings.markers)
        score, radii = 0.0, []
        for frame in frames:
            places = finder.candidates(frame)
            disks = finder.fit(frame, places) if len(places) else None
            chosen = [best(disks, k, tried) for k in range(settings.markers.first, 3)] if disks else [None]
            chosen = [k for k in chosen if k is not None]
            score += sum(disks.share[k] for k in chosen)
            radii += [disks.radius[k] for k in chosen]
        scores.append((score, 2 * float(np.median(radii)) if radii else 0.0))
    score, diameter = max(scores)
    return diameter if score > 0 else None


def centre_of_circle(points: np.ndarray) -> tuple[float, float]:
    """Centre of the circle through most of the points (n, 2): robust least squares of their distances.

    Raises:
        InputError: they do not lie on enough of a circle.
    """
    used = np.ones(len(points), bool)
    for _ in range(6):
        x, y = points[used].T
        design = np.column_stack((2 * x, 2 * y, np.ones(len(x))))
        (a, b, c), *_ = np.linalg.lstsq(design, x**2 + y**2, rcond=None)
        off = np.hypot(*(points - (a, b)).T) - math.sqrt(max(c + a**2 + b**2, 0))
        limit = max(1.0, 4 * float(np.median(np.abs(off[used]))))
        if (used == (np.abs(off) < limit)).all():
            break
        used = np.abs(off) < limit
        if used.sum() < 3:
            break
    angle = np.sort(np.degrees(np.arctan2(points[used, 1] - b, points[used, 0] - a)) % 360)
    arc = 360 - np.diff(np.append(angle, angle[0] + 360)).max() if len(angle) > 2 else 0.0
    if arc < MIN_ARC_DEG:
        raise InputError(
            f"{WHERE}.pivot", f"the joint moves over {arc:.0f}° only: too little to find the pivot", "give pivot_px"
        )
    return float(a), float(b)


def sound(disks: Disks, settings: TrackSettings) -> np.ndarray:
    """(m,) whether what was fitted is a disk of the right size."""
    size = np.abs(2 * disks.radius - settings.marker_diameter_px) < settings.diameter_tolerance_px
    return size & (disks.share > settings.min_rim_share)


def best(disks: Disks, k: int, settings: TrackSettings) -> int | None:
    """The sound disk of marker k with the cleanest rim."""
    share = np.where(sound(disks, settings) & (disks.identity == k), disks.share, 0)
    chosen = int(share.argmax())
    return chosen if share[chosen] > 0 else None

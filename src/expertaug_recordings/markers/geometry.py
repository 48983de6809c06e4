"""Lengths of one recording's pendulum, measured on frames of which nothing else is known."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from expertaug.errors import InputError
from expertaug_recordings.markers.appearance import WHERE
from expertaug_recordings.markers.disks import Disks, fitter
from expertaug_recordings.settings import TrackMarkersJob

DIAMETERS = (8.0, 1.25)  # px of the smallest that is tried where none is given, and the step to the next
LARGEST = 0.25  # of the image's shorter side
WIDE = 6.0  # robust standard deviations
TWIN, TWIN_SHARE = 0.25, 0.5  # diameters within which a thing is at rest, and share of the frames in which it is there
MIN_ARC_DEG = 40.0  # of the joint's circle: its centre is then known to about the markers' own error


@dataclass(frozen=True)
class Geometry:
    """Lengths of one recording's pendulum in px: pivot to joint, joint to tip, diameter of a marker; and the place
    (x, y) of a pivot that bears no marker.

    Of a single pendulum the second arm is like the first.
    ``spread`` is by how much the two arms' lengths vary, and ``residual`` how far the centres of the three markers'
    rims and insides are apart at most where nothing covers them: more than little where something is burnt in.
    ``twins`` are for each marker the places (x, y) of things at rest that look like it.
    """

    arm1: float
    arm2: float
    diameter: float
    pivot: tuple[float, float] | None = None
    spread: tuple[float, float] = (0.0, 0.0)
    residual: tuple[float, float, float] = (0.0, 0.0, 0.0)
    twins: tuple[tuple[tuple[float, float], ...], ...] = ((), (), ())


def estimate_geometry(frames: Iterable[np.ndarray], settings: TrackMarkersJob) -> tuple[Geometry | None, Counter]:
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
    appearance = settings.appearance
    finder = fitter(settings.marker_diameter_px, settings.min_level, settings.rim_tolerance, appearance)
    seen = [finder.fit(frame, places) if len(places := finder.candidates(frame)) else None for frame in frames]
    twins = [(), *(_twins(seen, k, settings) if k < appearance.last else () for k in (1, 2))]
    if appearance.first == 0:
        twins[0] = _other_pivots(seen, settings, twins[1])
    centres, diameters, residuals, counts = [], [], [], Counter(frames=len(seen))
    for disks in seen:
        if disks is None:
            continue
        chosen = [best(disks, k, settings, twins[k]) for k in range(appearance.first, appearance.last)]
        counts.update(name for name, place in zip(appearance.seen, chosen, strict=True) if place is not None)
        if None not in chosen:
            counts["all"] += 1
            centres.append(disks.centre[chosen])
            diameters.append(2 * disks.radius[chosen].mean())
            residuals.append(disks.residual[chosen])
    if len(centres) < max(1, min(3, counts["frames"])):
        return None, counts
    centre = np.array(centres, np.float64)
    pivot = None
    if appearance.pivot is None:
        pivot = appearance.pivot_px or centre_of_circle(centre[:, 0])
        centre = np.concatenate((np.broadcast_to(pivot, (len(centre), 1, 2)), centre), axis=1)
    length = np.linalg.norm(np.diff(centre, axis=1), axis=2)
    arms, spread = (np.resize(of, 2).tolist() for of in (np.median(length, axis=0), _spread(length)))
    residual = np.array(residuals)
    before, after = [0.0] * appearance.first, [0.0] * (3 - appearance.last)
    usual = before + (np.median(residual, axis=0) + WIDE * np.array(_spread(residual))).tolist() + after
    return Geometry(*arms, float(np.median(diameters)), pivot, tuple(spread), tuple(usual), tuple(twins)), counts


def _spread(values: np.ndarray) -> list[float]:
    """Robust standard deviations (m,) of values (n, m)."""
    return (1.4826 * np.median(np.abs(values - np.median(values, axis=0)), axis=0)).tolist()


def _sightings(seen: Sequence[Disks | None], k: int, settings: TrackMarkersJob) -> tuple[np.ndarray, np.ndarray]:
    """Places (n, 2) of sound disks that look like marker k, and their frames (n,)."""
    places, numbers = [np.empty((0, 2))], [np.empty(0, int)]
    for number, disks in enumerate(seen):
        if disks is not None:
            own = disks.centre[sound(disks, settings) & (disks.identity == k)]
            places.append(own)
            numbers.append(np.full(len(own), number))
    return np.concatenate(places), np.concatenate(numbers)


def _twins(seen: Sequence[Disks | None], k: int, settings: TrackMarkersJob) -> tuple[tuple[float, float], ...]:
    """Places at which something that looks like the moving marker k is in most of the frames, while another one that
    does is elsewhere."""
    places, numbers = _sightings(seen, k, settings)
    frames, twins = len(seen), []
    for place in places:
        there = np.hypot(*(places - place).T) < TWIN * settings.marker_diameter_px
        often = len(set(numbers[there])) > TWIN_SHARE * frames
        elsewhere = len(set(numbers[~there])) > TWIN_SHARE * frames
        new = all(math.dist(place, other) > TWIN * settings.marker_diameter_px for other in twins)
        if often and elsewhere and new:
            twins.append(tuple(np.median(places[there], axis=0).tolist()))
    return tuple(twins)


def _other_pivots(
    seen: Sequence[Disks | None], settings: TrackMarkersJob, twins: Sequence[tuple[float, float]]
) -> tuple[tuple[float, float], ...]:
    """Places of things that look like the pivot's marker, but from which the joint does not keep its distance best."""
    places, numbers = _sightings(seen, 0, settings)
    chosen = [None if disks is None else best(disks, 1, settings, twins) for disks in seen]
    joints = [disks.centre[k] for disks, k in zip(seen, chosen, strict=True) if disks is not None and k is not None]
    if len(places) < (1 + TWIN_SHARE) * len(set(numbers)) or not joints:
        return ()
    choices: list[tuple[float, tuple[float, float]]] = []
    for place in places:
        if all(math.dist(place, other) > settings.marker_diameter_px for _, other in choices):
            distance = np.linalg.norm(np.array(joints) - place, axis=1)
            choices.append((_spread(distance[:, None])[0] / float(np.median(distance)), tuple(place.tolist())))
    return tuple(place for _, place in sorted(choices)[1:])


def measure_diameter(frames: Sequence[np.ndarray], settings: TrackMarkersJob) -> float | None:
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
        finder = fitter(diameter, tried.min_level, tried.rim_tolerance, tried.appearance)
        score, radii = 0.0, []
        for frame in frames:
            places = finder.candidates(frame)
            disks = finder.fit(frame, places) if len(places) else None
            chosen = (
                [best(disks, k, tried) for k in range(settings.appearance.first, settings.appearance.last)]
                if disks
                else [None]
            )
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
            f"{WHERE}.pivot",
            f"the joint moves over {arc:.0f}° only: too little to find the pivot",
            f"set {WHERE}.pivot_px",
        )
    return float(a), float(b)


def sound(disks: Disks, settings: TrackMarkersJob) -> np.ndarray:
    """(m,) whether what was fitted is a disk of the right size."""
    size = np.abs(2 * disks.radius - settings.marker_diameter_px) < settings.diameter_tolerance
    return size & (disks.share > settings.min_rim_share)


def best(
    disks: Disks,
    k: int,
    settings: TrackMarkersJob,
    twins: Sequence[tuple[float, float]] = (),
) -> int | None:
    """The sound disk of marker k with the cleanest rim, at none of the places ``twins``."""
    share = np.where(sound(disks, settings) & (disks.identity == k), disks.share, 0)
    reach = TWIN * settings.marker_diameter_px
    for place in twins:
        share = np.where(np.hypot(*(disks.centre - place).T) < reach, 0, share)
    chosen = int(share.argmax())
    return chosen if share[chosen] > 0 else None

"""What a video of an unknown pendulum shows: round markers, told apart by hue, and by their motion which is which."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from expertaug.errors import InputError
from expertaug_recordings.markers.appearance import SATURATION, STYLES, Appearance, Colour
from expertaug_recordings.markers.disks import Disks, fitter, mask_of
from expertaug_recordings.markers.geometry import DIAMETERS, LARGEST, TWIN, centre_of_circle

MIN_LEVEL, RIM_TOLERANCE = 24.0, 0.6  # of the fitters, the second at 25 px of diameter
MIN_SHARE = 0.6  # of a rim
MIN_PRESENCE = 0.5  # of the frames in which a marker's colour is seen
SMALL_SIDE = 640  # px to which an image's longer side is reduced to look for colours
INK = 9  # px of that image: lines and rings as thick that are burnt into a marker are filled
HUE_STEP, HUE_REACH = 15, 22  # degrees: bands of hue in which parts of one colour are looked for
STRENGTHS = (SATURATION[0], 0.5)  # saturations from which on: the second where the background is of a marker's hue
HUE_GAP = 14.0  # degrees without any sighting between two markers' hues
MAX_SPREAD = 0.08  # of an arm's length between frames, for markers to be its ends or a little off
MAX_SWAY = 0.1  # of the first arm's length by which a pivot may move
SWAY_OF_SWING = 0.25  # of the way of the joint, where that is more
MIN_ARM = 0.8  # of a marker's diameter: nothing swings on a shorter arm
MIN_FRAMES = 5
THIRDS = [Colour("any", (first, (first + 120) % 360)) for first in (0.0, 120.0, 240.0)]


@dataclass(frozen=True)
class Spot:
    """A round thing in a frame: its number, centre (x, y) and diameter in px, clean share of its rim, and hue in
    degrees, saturation and value."""

    frame: int
    centre: tuple[float, float]
    diameter: float
    share: float
    colour: tuple[float, float, float]


@dataclass(frozen=True)
class Pendulum:
    """Markers with their roles.

    Attributes:
        style: the markers' style.
        spots: sightings of pivot, joint and tip, by frame; None for a pivot that bears none, and for a single
            pendulum's tip.
        spread: how constant the arms are, as a share of their lengths.
    """

    style: str
    spots: tuple[dict[int, Spot] | None, dict[int, Spot], dict[int, Spot] | None]
    spread: float


def find_spots(frames: Sequence[np.ndarray], style: str) -> list[Spot]:
    """Round coloured things in BGR frames (H, W, 3) that look like markers of a style, each once."""
    find = _quadrants if style == "quadrant" else _plain
    spots = []
    for number, frame in enumerate(frames):
        seen: list[Spot] = []
        for spot in sorted(find(number, frame), key=lambda s: -s.share * s.diameter):
            if all(np.hypot(*np.subtract(spot.centre, s.centre)) > (spot.diameter + s.diameter) / 3 for s in seen):
                seen.append(spot)
        spots += seen
    return spots


def find_pendulum(spots: Sequence[Spot], style: str, frames: int) -> Pendulum | None:
    """The three markers, or two with an unmarked pivot, that keep their distances while they move; else those of a
    single pendulum, with or without its pivot's; None for none."""
    least = max(MIN_FRAMES, MIN_PRESENCE * frames)
    groups = [(hue, g) for hue, own in enumerate(by_hue(spots)) for g in _apart(own, least) if len(g) >= least]
    groups = sorted(groups, key=lambda pair: len(pair[1]), reverse=True)[:9]

    def chosen(count: int) -> Iterator[list[dict[int, Spot]]]:
        for several in itertools.permutations(groups, count):
            if len({hue for hue, _ in several}) == count:
                yield [g for _, g in several]

    pendulums = [p for three in chosen(3) if (p := _as_pendulum(style, *three)) is not None]
    pendulums = pendulums or [p for two in chosen(2) if (p := _as_pendulum(style, None, *two)) is not None]
    pendulums = pendulums or [p for two in chosen(2) if (p := _as_single(style, *two)) is not None]
    pendulums = pendulums or [p for (bob,) in chosen(1) if (p := _as_single(style, None, bob)) is not None]
    return min(pendulums, key=lambda p: p.spread, default=None)


def _apart(spots: Sequence[Spot], least: float) -> list[dict[int, Spot]]:
    """By frame, the spots of one hue at each place at which there is one in enough frames, and the cleanest of those
    that are nowhere at rest."""
    places: list[tuple[float, float]] = []
    groups: list[dict[int, Spot]] = []
    for spot in spots:
        reach = TWIN * spot.diameter
        if all(np.hypot(*np.subtract(spot.centre, place)) > 2 * reach for place in places):
            there = [s for s in spots if np.hypot(*np.subtract(s.centre, spot.centre)) < reach]
            if len(there) >= least:
                places.append(spot.centre)
                groups.append(cleanest(there))
    moving = [s for s in spots if all(np.hypot(*np.subtract(s.centre, place)) > TWIN * s.diameter for place in places)]
    return [*groups, cleanest(moving)] + ([cleanest(spots)] if len(places) == 1 and moving else [])


def cleanest(spots: Sequence[Spot]) -> dict[int, Spot]:
    """Of each frame the spot with the cleanest rim."""
    best: dict[int, Spot] = {}
    for spot in spots:
        if spot.frame not in best or spot.share > best[spot.frame].share:
            best[spot.frame] = spot
    return best


def by_hue(spots: Sequence[Spot]) -> list[list[Spot]]:
    """Spots of one hue, for each hue that is there."""
    if not spots:
        return []
    ordered = sorted(spots, key=lambda s: s.colour[0])
    hue = np.array([s.colour[0] for s in ordered])
    gaps = np.diff(np.append(hue, hue[0] + 360))
    first = int(gaps.argmax()) + 1  # the circle is cut at its widest gap
    ordered, gaps = ordered[first:] + ordered[:first], np.roll(gaps, -first)
    cuts = np.flatnonzero(gaps[:-1] > HUE_GAP) + 1
    return [[ordered[k] for k in part] for part in np.split(np.arange(len(ordered)), cuts)]


def _quadrants(number: int, frame: np.ndarray) -> list[Spot]:
    smallest, step = DIAMETERS
    largest, diameter, spots = LARGEST * min(frame.shape[:2]), smallest, []
    while diameter <= largest:
        finder = fitter(diameter, MIN_LEVEL, _tolerance(diameter), Appearance("quadrant", *THIRDS))
        places = finder.candidates(frame)
        if len(places):
            spots += _spots(number, finder.fit(frame, places), diameter)
        diameter *= step
    return spots


def _plain(number: int, frame: np.ndarray) -> list[Spot]:
    """Parts of one hue that are about as round as a disk, each fitted at its own size."""
    scale = max(1.0, max(frame.shape[:2]) / SMALL_SIDE)
    size = [max(1, round(side / scale)) for side in frame.shape[1::-1]]
    scales = np.divide(frame.shape[1::-1], size)
    picture = cv2.cvtColor(cv2.resize(frame, size, interpolation=cv2.INTER_AREA), cv2.COLOR_BGR2HSV)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (3, 3))
    smallest = 0.5 * (DIAMETERS[0] / scale) ** 2
    spots = []
    for hue, saturation in itertools.product(range(0, 360, HUE_STEP), STRENGTHS):
        colour = Colour("any", ((hue - HUE_REACH) % 360, (hue + HUE_REACH) % 360), (saturation, 1.0))
        mask = mask_of(picture, colour)
        if cv2.countNonZero(mask) < smallest:
            continue
        for width, height, area, place in _parts(mask, kernel):
            diameter = float(np.sqrt(4 * area / np.pi) * scales.mean())
            round_enough = 0.75 < width / height < 1.34 and 0.6 < area / (width * height) < 0.92
            if round_enough and DIAMETERS[0] <= diameter <= LARGEST * min(frame.shape[:2]):
                finder = fitter(diameter, MIN_LEVEL, _tolerance(diameter), Appearance("disk", *THIRDS))
                spots += _spots(number, finder.fit(frame, ((place + 0.5) * scales - 0.5)[None]), diameter)
    return spots


def _parts(mask: np.ndarray, kernel: np.ndarray) -> Iterator[tuple[int, int, int, np.ndarray]]:
    """Width, height, area and middle of the parts of a mask, and of those parts with what is burnt in filled."""
    inked = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (INK, INK))
    for binary in (mask, cv2.morphologyEx(mask, cv2.MORPH_CLOSE, inked)):
        opened = cv2.morphologyEx(binary, cv2.MORPH_OPEN, kernel)
        _, _, stats, centres = cv2.connectedComponentsWithStats(opened, connectivity=8)
        for (_, _, width, height, area), place in zip(stats[1:], centres[1:], strict=True):
            yield int(width), int(height), int(area), place


def _tolerance(diameter: float) -> float:
    return RIM_TOLERANCE * max(1.0, diameter / 25)


def _spots(number: int, disks: Disks, diameter: float) -> list[Spot]:
    good = (disks.identity >= 0) & (disks.share > MIN_SHARE)
    good &= np.abs(2 * disks.radius - diameter) < 0.15 * diameter
    return [
        Spot(
            number,
            tuple(disks.centre[k].tolist()),
            2 * float(disks.radius[k]),
            float(disks.share[k]),
            tuple(disks.colour[k].tolist()),
        )
        for k in np.flatnonzero(good)
    ]


def _as_pendulum(
    style: str, pivot: dict[int, Spot] | None, joint: dict[int, Spot], tip: dict[int, Spot]
) -> Pendulum | None:
    """These markers in these roles, where they move like that."""
    common = sorted(set(joint) & set(tip) & set(joint if pivot is None else pivot))
    if len(common) < MIN_FRAMES:
        return None
    centre = np.array([[g[k].centre for g in (joint, tip)] for k in common])
    origin = _origin(pivot, centre[:, 0], common)
    if origin is None:
        return None
    place = np.concatenate((origin[:, None], centre), axis=1)
    length = np.linalg.norm(np.diff(place, axis=1), axis=2)
    middle = np.median(length, axis=0)
    if middle.min() < MIN_ARM * float(np.median([tip[k].diameter for k in common])):
        return None
    spread = float((1.4826 * np.median(np.abs(length - middle), axis=0) / middle).max())
    still = np.ptp(np.quantile(place, (0.1, 0.9), axis=0), axis=0)  # (3, 2): by how much each moves
    moves = np.hypot(*still.T) / middle[0]
    if spread > MAX_SPREAD or moves[0] > _most_sway(moves[1]) or moves[1] < 2 * MAX_SWAY or moves[2] < 2 * MAX_SWAY:
        return None
    return Pendulum(style, (pivot, joint, tip), spread)


def _as_single(style: str, pivot: dict[int, Spot] | None, bob: dict[int, Spot]) -> Pendulum | None:
    """A bob that swings about a pivot, where it moves like that."""
    common = sorted(set(bob) & set(bob if pivot is None else pivot))
    if len(common) < MIN_FRAMES:
        return None
    centre = np.array([bob[k].centre for k in common])
    origin = _origin(pivot, centre, common)
    if origin is None:
        return None
    length = np.linalg.norm(centre - origin, axis=1)
    middle = float(np.median(length))
    spread = float(1.4826 * np.median(np.abs(length - middle)) / middle)
    sway, swing = (
        float(np.hypot(*np.ptp(np.quantile(p, (0.1, 0.9), axis=0), axis=0))) / middle for p in (origin, centre)
    )
    least = MIN_ARM * float(np.median([bob[k].diameter for k in common]))
    if middle < least or spread > MAX_SPREAD or sway > _most_sway(swing) or swing < 2 * MAX_SWAY:
        return None
    return Pendulum(style, (pivot, bob, None), spread)


def _most_sway(swing: float) -> float:
    """By how much a pivot may move where the joint moves by ``swing``, both as shares of the arm: with the camera."""
    return max(MAX_SWAY, SWAY_OF_SWING * swing)


def _origin(pivot: dict[int, Spot] | None, joint: np.ndarray, frames: Sequence[int]) -> np.ndarray | None:
    """The pivot's place (n, 2) in these frames; of one without a marker the centre of the joint's circle (n, 2)."""
    if pivot is not None:
        return np.array([pivot[k].centre for k in frames])
    try:
        return np.broadcast_to(centre_of_circle(joint), joint.shape)
    except InputError:
        return None


def look_for_pendulum(frames: Sequence[np.ndarray]) -> tuple[Pendulum | None, dict[str, list[Spot]]]:
    """The pendulum of frames spread over a video, and by style all round coloured things in them."""
    spots = {style: find_spots(frames, style) for style in STYLES}
    pendulums = [p for style, seen in spots.items() if (p := find_pendulum(seen, style, len(frames))) is not None]
    return max(pendulums, key=_count_seen, default=None), spots


def _count_seen(pendulum: Pendulum) -> tuple[int, int]:
    """Markers that there are, and frames that show those that move."""
    moving = [set(spots) for spots in pendulum.spots[1:] if spots is not None]
    return len(moving), len(set.intersection(*moving))

"""Frames that a converter mixed from two: each moving marker is seen twice, fainter.

Beside the disk, on the way to where the marker is in the frame before or after, its colour is looked for.  What is
there otherwise is the median of frames spread over the recording: only what differs from it towards the disk's colour
counts.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

BACKGROUND = 15  # frames whose median is what does not move
LOOKED_AT, FEW = 60, 0.05  # frames that are looked at first, and share of them, below which none is mixed
EVEN = 0.58  # strength from which on it is not certain which image was followed
SMEARED, BEYOND = 0.15, 2.0  # steps by which a long exposure lengthens the disk, and px at its rim that are neither
REACH = 0.7  # radii beyond the next place to which the way is followed
ACROSS = np.array([-0.3, -0.15, 0.0, 0.15, 0.3])  # radii to the side of the way
FREE = 2.5  # radii about the way in which there must be no other marker
STRIDE, CORE = 1.0, 0.3  # px along it from sample to sample, and radii of the disk's inside
ALIKE = 0.8  # cosine between the change of colour and the disk's own contrast
LEAST = 20.0  # grey levels of that contrast


def find_blended(frames: Sequence[np.ndarray], position: np.ndarray, diameter: float) -> np.ndarray:
    """Frames (n,) in which joint and tip are seen twice, nearly as strongly; none where next to none of a sample is.

    Arguments:
        frames: n BGR images (H, W, 3).
        position: of the markers in px, (n, 3, 2); NaN where one was not found.
        diameter: of a marker in px.
    """
    blended = np.zeros(len(position), bool)
    radius = diameter / 2
    step = np.linalg.norm(np.diff(position[:, 1:], axis=0), axis=2)
    far = np.zeros((len(position), 2, 2), bool)  # to the frame before, and after
    with np.errstate(invalid="ignore"):
        enough = (1 - SMEARED) * step > (1 - REACH) * radius + BEYOND + 2 * STRIDE
    located = np.isfinite(step)
    both = located[:-1] & located[1:]
    far[1:-1, :, 0], far[1:-1, :, 1] = enough[:-1] & both, enough[1:] & both
    moving = np.flatnonzero(far.any((1, 2)))
    if not len(moving):
        return blended
    some = moving[np.linspace(0, len(moving) - 1, min(LOOKED_AT, len(moving))).round().astype(int)]
    spread = np.linspace(0, len(position) - 1, min(BACKGROUND, len(position))).round().astype(int)
    still = [frames[k] for k in spread]

    def strong(k: int) -> bool:
        return _strength(frames[k], still, position[k - 1 : k + 2], far[k], radius) > EVEN

    if np.mean([strong(k) for k in some.tolist()]) >= FEW:
        blended[moving] = [strong(k) for k in moving.tolist()]
    return blended


def _strength(
    frame: np.ndarray, still: Sequence[np.ndarray], position: np.ndarray, far: np.ndarray, radius: float
) -> float:
    """Of the second image: the least of those of the markers that move far enough to tell.

    Arguments:
        frame: BGR image (H, W, 3).
        still: images that tell the background.
        position: of the markers in the frame before, in this one and in the next, (3, 3, 2) in px.
        far: (2, 2), whether joint and tip are far enough from where they were, and will be.
        radius: of a marker in px.
    """
    seen = []
    for marker, enough in zip((1, 2), far, strict=True):
        place, near = position[1, marker], np.delete(position[1], marker, axis=0)
        ways = [other for other in position[[0, 2], marker][enough] if _is_free(place, other, near, radius)]
        if ways:
            seen.append(max(_beside(frame, still, place, other, radius) for other in ways))
    return min(seen, default=0.0)


def _is_free(place: np.ndarray, other: np.ndarray, near: np.ndarray, radius: float) -> bool:
    """Whether no other marker (m, 2) is on the way from a place (2,) to another one and a radius beyond."""
    way = (other - place) * (1 + radius / np.linalg.norm(other - place))
    part = np.clip((near - place) @ way / (way @ way), 0, 1)
    return not bool((np.linalg.norm(place + part[:, None] * way - near, axis=1) < FREE * radius).any())


def _beside(
    frame: np.ndarray, still: Sequence[np.ndarray], place: np.ndarray, other: np.ndarray, radius: float
) -> float:
    """Strength of an image of the disk at ``place`` (2,) on the way from there to ``other``."""
    way = other - place
    length = float(np.hypot(*way))
    along, side = way / length, np.array([-way[1], way[0]]) / length
    start, end = radius + BEYOND + SMEARED * length, length + REACH * radius
    core = np.linspace(-CORE, CORE, 3) * radius
    distance = np.concatenate((core, np.arange(start, end, STRIDE)))
    points = place + distance[:, None, None] * along + (ACROSS * radius)[:, None] * side
    change = _colours(frame, points) - np.median([_colours(image, points) for image in still], axis=0)
    contrast = np.median(change[: len(core)], axis=(0, 1))
    size = float(np.linalg.norm(contrast))
    if size < LEAST:
        return 0.0
    strength = change[len(core) :] @ contrast / size**2
    alike = strength * size > ALIKE * np.linalg.norm(change[len(core) :], axis=-1)
    level = np.median(np.where(alike, strength, 0.0), axis=1)
    return float(np.minimum(level[:-1], level[1:]).max())  # as long as a disk, not a spot


def _colours(image: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Colours (a, b, 3) at points (a, b, 2) in px."""
    x, y = (np.ascontiguousarray(points[..., k], np.float32) for k in (0, 1))
    return cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(np.float32)

"""Drawing on frames: markers, arms and lines of text that can be read on any background."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

FRACTION = 4  # bits of a pixel's fractions in OpenCV's coordinates
FONT, THICK = cv2.FONT_HERSHEY_SIMPLEX, 1
ARM = (255, 255, 255)
ROLE_COLOURS = ((80, 80, 255), (80, 220, 80), (255, 170, 60))  # B, G, R of pivot, joint and tip, whatever they are
SHADE = (0, 0, 0)


def to_fixed_point(points: np.ndarray) -> np.ndarray:
    """Points (..., 2) in px as OpenCV's numbers with FRACTION bits."""
    return np.rint(np.asarray(points, float) * (1 << FRACTION)).astype(np.int32)


def line(image: np.ndarray, points: np.ndarray, colour: Sequence[int], width: int = 1, shade: bool = True) -> None:
    """A line through points (n, 2) in px, on a darker one."""
    if shade:
        cv2.polylines(image, [to_fixed_point(points)], False, SHADE, width + 2, cv2.LINE_AA, FRACTION)
    cv2.polylines(image, [to_fixed_point(points)], False, colour, width, cv2.LINE_AA, FRACTION)


def ring(image: np.ndarray, centre: Sequence[float], radius: float, colour: Sequence[int], width: int = 1) -> None:
    """A circle in px and a small cross in its middle."""
    x, y = to_fixed_point(centre).tolist()
    around = round(radius * (1 << FRACTION))
    for thick, shade in ((width + 2, SHADE), (width, colour)):
        cv2.circle(image, (x, y), around, shade, thick, cv2.LINE_AA, FRACTION)
    for dx, dy in ((3, 0), (0, 3)):
        ends = np.array([[centre[0] - dx, centre[1] - dy], [centre[0] + dx, centre[1] + dy]])
        line(image, ends, ARM, shade=False)


def arrow(image: np.ndarray, start: np.ndarray, way: np.ndarray, colour: Sequence[int] = (80, 255, 255)) -> None:
    """A dashed arrow from ``start`` along ``way`` (x, y) in px: where gravity points."""
    for share in np.arange(0, 1, 0.2):
        line(image, np.stack((start + share * way, start + (share + 0.1) * way)), colour)
    across = np.array([-way[1], way[0]])
    head = np.stack((start + 0.85 * way + 0.08 * across, start + way, start + 0.85 * way - 0.08 * across))
    line(image, head, colour)
    text(image, "gravity", tuple(start + way + (4, 4)), colour)


def text(
    image: np.ndarray, words: str, at: tuple[float, float], colour: Sequence[int] = ARM, size: float = 0.45
) -> None:
    """A line of plain text whose lower left corner is ``at``, on a darker patch."""
    x, y = round(at[0]), round(at[1])
    (width, height), below = cv2.getTextSize(words, FONT, size, THICK)
    patch = image[max(0, y - height - 2) : y + below, max(0, x - 3) : x + width + 3]
    patch[:] = patch // 3
    cv2.putText(image, words, (x, y), FONT, size, colour, THICK, cv2.LINE_AA)


def pendulum(image: np.ndarray, place: np.ndarray, radius: float, width: int = 1) -> None:
    """Arms and rings of pivot, joint and tip at (3, 2) px; what is NaN is left out."""
    for k in (0, 1):
        if np.isfinite(place[k : k + 2]).all():
            line(image, place[k : k + 2], ARM, width)
    for centre, colour in zip(place, ROLE_COLOURS, strict=True):
        if np.isfinite(centre).all():
            ring(image, centre, radius, colour, width)


def resize(image: np.ndarray, factor: float) -> np.ndarray:
    """The image (H, W, 3) in another size, with a copy of its own."""
    if factor == 1:
        return image.copy()
    smooth = cv2.INTER_AREA if factor < 1 else cv2.INTER_CUBIC
    size = [max(1, round(side * factor)) for side in image.shape[1::-1]]
    return cv2.resize(image, size, interpolation=smooth)

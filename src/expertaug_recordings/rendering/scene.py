"""What the camera sees: the double pendulum of the IBM recordings, drawn as its colour sensor would record it.

Image coordinates are pixels with the origin at the centre of the top-left pixel, x right, y down. A marker is drawn
once, eight times larger and already blurred by the lens; drawing a frame samples that sprite on the sensor's grid, so
that a marker lies where it should to about .005 px. The frame then goes through a Bayer mosaic, noise, demosaicing
and the enlargement to the image, which give thin bright rods the coloured speckle and dark edges of the real ones:
along both arms of the published frame the speckle repeats as a mosaic of 6 sensor pixels per 7 image pixels does.

Colours, widths and blur are fitted to the one published video frame.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

SCALE = 8  # sprite pixels per image pixel
SENSOR = 6 / 7  # sensor pixels per image pixel
RADIUS = 12.67  # px, of a marker
HALF = 17  # px, half the side of a marker's patch
BLUR = (0.92, 0.54, 0.56)  # px, Gaussian blur of lens and pixel in blue, green and red
WHITES = {"red": (447, 303, 204), "green": (379, 248, 198), "blue": (356, 238, 192)}  # saturated beyond 255
TINTS = {"red": (135, 113, 168), "green": (137, 151, 56), "blue": (165, 73, 25)}
GREEN_TWIST = 0.025  # rad, by which the green marker sits askew on its arm
RODS = {  # offsets from the arm's axis, width, colour in blue, green, red (light beyond saturation widens the image)
    "arm1": ((-7.4, 7.5), 0.5, (1400, 829, 612)),
    "arm2": ((-0.6,), 0.5, (649, 626, 261)),
}
STAND = ((62, 57, 31), 0.95)  # colour of the rod below the pivot and standard deviation of its profile
BASE = (92, 76, 45)
FOOT = (240, 310, 340)
EXPOSURE = 0.75  # of a level: the sensor sees brighter light than the image shows
BETWEEN = np.array([0.5, 1, 0.5], np.float32)  # linear interpolation between every second pixel
FIELDS, SPARE = 4, 64  # noise fields drawn per recording, and how much larger than the frame they are


@dataclass(frozen=True)
class Pose:
    """Where the pendulum is: the three marker centres in px and the arms' angles in rad from the downward vertical."""

    pivot: tuple[float, float]
    joint: tuple[float, float]
    tip: tuple[float, float]
    theta1: float
    theta2: float


class Scene:
    """Draws one recording's frames as uint8 BGR (size, size, 3).

    Arguments:
        size: side of the image in px; even.
        pivot: place of the fixed marker in px; it does not move within a recording.
        arms: lengths of the two arms in px.
        noise: standard deviation of the sensor noise in grey levels; 0 for none.
        rng: source of the noise.
    """

    def __init__(
        self, size: int, pivot: tuple[float, float], arms: tuple[float, float], noise: float, rng: np.random.Generator
    ):
        self.size, self.pivot = size, pivot
        self.sensor = 2 * round(size * SENSOR / 2)
        self.noise = _noise_fields(self.sensor, noise, rng)
        self.rng = rng
        self.markers = {name: _marker(name) for name in TINTS}
        self.arms = (_rods("arm1", arms[0]), _rods("arm2", arms[1]))
        full = _background(size, pivot)
        self.background = cv2.resize(full, (self.sensor, self.sensor), interpolation=cv2.INTER_AREA)
        self.fixed = (self.markers["red"], self._part(pivot, 0.0), self._box([pivot], HALF))
        still = self.background.copy()
        _paste(still, (0, 0), *self.fixed)
        self.still = _mosaic(still)

    def clean(self, poses: list[Pose]) -> np.ndarray:
        """The light on each pixel of the sensor, averaged over the poses of one exposure; BGR (sensor, sensor, 3)."""
        frame = self.background.copy()
        _paste(frame, (0, 0), *self.fixed)
        x0, y0, x1, y1 = box = self._moving(poses)
        frame[y0:y1, x0:x1] = self._draw(poses, box)
        return frame

    def frame(self, poses: list[Pose]) -> np.ndarray:
        """The recorded frame."""
        raw = self.still.copy()
        x0, y0, x1, y1 = box = self._moving(poses)
        raw[y0:y1, x0:x1] = _mosaic(self._draw(poses, box))
        if self.noise is not None:
            dark, gain = self.noise
            i, j = self.rng.integers(FIELDS, size=2)
            dx, dy = self.rng.integers(SPARE, size=2)
            cv2.multiply(raw[y0:y1, x0:x1], gain[j, dy + y0 : dy + y1, dx + x0 : dx + x1], raw[y0:y1, x0:x1], 1 / 128)
            cv2.add(raw, dark[i, dy : dy + self.sensor, dx : dx + self.sensor], raw)
        image = cv2.resize(_demosaic(raw, box), (self.size, self.size), interpolation=cv2.INTER_CUBIC)
        return cv2.convertScaleAbs(image, alpha=1 / EXPOSURE)

    def _moving(self, poses: list[Pose]) -> tuple[int, int, int, int]:
        points = [self.pivot] + [p.joint for p in poses] + [p.tip for p in poses]
        return self._box(points, HALF)

    def _draw(self, poses: list[Pose], box: tuple[int, int, int, int]) -> np.ndarray:
        views = [self._draw_one(pose, box) for pose in poses]
        if len(views) > 2:  # a long exposure (see render.poses)
            return np.rint(np.mean(views, axis=0)).astype(np.uint8)
        return views[0] if len(views) == 1 else cv2.addWeighted(views[0], 0.5, views[1], 0.5, 0)

    def _draw_one(self, pose: Pose, box: tuple[int, int, int, int]) -> np.ndarray:
        x0, y0, x1, y1 = box
        canvas = self.background[y0:y1, x0:x1].copy()
        arms = (("arm1", pose.pivot, pose.joint, pose.theta1), ("arm2", pose.joint, pose.tip, pose.theta2))
        for (_, start, end, theta), sprite in zip(arms, self.arms, strict=True):
            _glow(canvas, (x0, y0), sprite, self._part(start, theta), self._box([start, end], 11))
        _paste(canvas, (x0, y0), *self.fixed)
        for name, centre, theta in (("green", pose.joint, pose.theta1 + GREEN_TWIST), ("blue", pose.tip, pose.theta2)):
            _paste(canvas, (x0, y0), self.markers[name], self._part(centre, theta), self._box([centre], HALF))
        return canvas

    def _part(self, origin: tuple[float, float], theta: float) -> np.ndarray:
        """From sensor pixels to a part's own coordinates in image px: v along the arm, u to its side; (2, 3)."""
        sin, cos = math.sin(theta), math.cos(theta)
        k = self.size / self.sensor
        x, y = origin[0] - (k - 1) / 2, origin[1] - (k - 1) / 2
        return np.array([[k * cos, -k * sin, sin * y - cos * x], [k * sin, k * cos, -sin * x - cos * y]])

    def _box(self, points: list[tuple[float, float]], margin: float) -> tuple[int, int, int, int]:
        """Even-aligned box (x0, y0, x1, y1) on the sensor of points and a margin in image px."""
        k = self.sensor / self.size
        out = []
        for axis in (0, 1):
            values = [p[axis] for p in points]
            out.append(min(max(int((min(values) - margin) * k) & ~1, 0), self.sensor))
            out.append(min(max((int((max(values) + margin) * k) + 3) & ~1, 0), self.sensor))
        return out[0], out[2], out[1], out[3]


def _sample(sprite: np.ndarray, to_part: np.ndarray, box: tuple[int, int, int, int]) -> np.ndarray:
    """The sprite, whose part origin is at its own centre in u and at HALF·SCALE in v, on the pixels of a box."""
    x0, y0, x1, y1 = box
    matrix = to_part * SCALE
    matrix[:, 2] += matrix[:, :2] @ (x0, y0) + ((sprite.shape[1] - 1) / 2, HALF * SCALE - 0.5)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return cv2.warpAffine(sprite, matrix, (x1 - x0, y1 - y0), flags=flags, borderMode=cv2.BORDER_CONSTANT)


def _paste(canvas: np.ndarray, origin: tuple[int, int], sprite: np.ndarray, to_part: np.ndarray, box: tuple) -> None:
    """Cover the canvas, whose first pixel is ``origin``, by an opaque part."""
    x0, y0, x1, y1 = box
    if x1 <= x0 or y1 <= y0:
        return
    patch = _sample(sprite, to_part, box)
    view = canvas[y0 - origin[1] : y1 - origin[1], x0 - origin[0] : x1 - origin[0]]
    behind = cv2.multiply(view, cv2.cvtColor(255 - patch[..., 3], cv2.COLOR_GRAY2BGR), scale=1 / 255)
    view[:] = cv2.add(behind, patch[..., :3])


def _glow(canvas: np.ndarray, origin: tuple[int, int], sprite: np.ndarray, to_part: np.ndarray, box: tuple) -> None:
    """Lay bright rods over the canvas."""
    x0, y0, x1, y1 = box
    if x1 <= x0 or y1 <= y0:
        return
    view = canvas[y0 - origin[1] : y1 - origin[1], x0 - origin[0] : x1 - origin[0]]
    view[:] = cv2.max(view, _sample(sprite, to_part, box))


def _marker(name: str) -> np.ndarray:
    """A quadrant disk and its cover, uint8 (side, side, 4), light multiplied by the cover."""
    side = 2 * HALF * SCALE
    axis = (np.arange(side) - (side - 1) / 2) / SCALE
    u, v = np.meshgrid(axis, axis)
    cover = np.clip((RADIUS - np.hypot(u, v)) * SCALE + 0.5, 0, 1)
    tinted = ((u * v > 0) == (name == "red"))[..., None]
    colour = np.where(tinted, TINTS[name], WHITES[name]) * (EXPOSURE * cover[..., None])
    layers = [cv2.GaussianBlur(colour[..., c], (0, 0), BLUR[c] * SCALE) for c in range(3)]
    layers.append(255 * cv2.GaussianBlur(cover, (0, 0), max(BLUR) * SCALE))
    return np.rint(np.clip(np.stack(layers, axis=-1), 0, 255)).astype(np.uint8)


def _rods(name: str, length: float) -> np.ndarray:
    """An arm's rods between its two markers, uint8 (rows along the arm, columns across it, 3)."""
    offsets, width, colour = RODS[name]
    rows, columns = round((length + 2 * HALF) * SCALE), 2 * 11 * SCALE
    u = (np.arange(columns) - (columns - 1) / 2) / SCALE
    v = (np.arange(rows) + 0.5) / SCALE - HALF
    across = sum(np.clip((width / 2 - np.abs(u - offset)) * SCALE + 0.5, 0, 1) for offset in offsets)
    along = ((v > 6) & (v < length - 6)).astype(float)
    light = along[:, None, None] * across[None, :, None] * (EXPOSURE * np.array(colour, dtype=float))
    layers = [cv2.GaussianBlur(light[..., c], (0, 0), BLUR[c] * SCALE) for c in range(3)]
    return np.rint(np.clip(np.stack(layers, axis=-1), 0, 255)).astype(np.uint8)


def _background(size: int, pivot: tuple[float, float]) -> np.ndarray:
    """What does not move except the pivot's marker: the dim stand, its foot and the base line, uint8 BGR."""
    x, y = np.meshgrid(np.arange(size, dtype=float), np.arange(size, dtype=float))
    image = np.zeros((size, size, 3))
    axis = pivot[0] + 1.7 * (y - pivot[1]) / 228  # the stand leans by half a degree
    foot = pivot[1] + 228
    colour, width = STAND
    profile = np.exp(-0.5 * ((x - axis) / width) ** 2) * (y > pivot[1]) * (y < foot + 6)
    for c in range(3):
        image[..., c] = colour[c] * profile
    spark = np.exp(-0.5 * (((x - axis) / 0.8) ** 2 + ((y - foot) / 1.3) ** 2))
    cross = np.exp(-0.5 * (((x - axis) / 4.5) ** 2 + ((y - foot) / 1.0) ** 2))
    line = np.clip(y - (foot + 7.6), 0, 1) * (np.abs(x - pivot[0] - 1.7) < 101)
    for c in range(3):
        image[..., c] += FOOT[c] * (spark + 0.11 * cross) + BASE[c] * line
    return np.rint(np.clip(EXPOSURE * image, 0, 255)).astype(np.uint8)


def _mosaic(image: np.ndarray) -> np.ndarray:
    """One colour per pixel, as under a red-green/green-blue filter; the first pixel is at even coordinates."""
    raw = np.empty(image.shape[:2], np.uint8)
    raw[0::2, 0::2] = image[0::2, 0::2, 2]
    raw[0::2, 1::2] = image[0::2, 1::2, 1]
    raw[1::2, 0::2] = image[1::2, 0::2, 1]
    raw[1::2, 1::2] = image[1::2, 1::2, 0]
    return raw


def _demosaic(raw: np.ndarray, box: tuple[int, int, int, int]) -> np.ndarray:
    """BGR of a mosaic: green along edges; in the box, where edges are sharp, blue and red from their differences to
    green, which are smoother than both; elsewhere from themselves."""
    image = cv2.cvtColor(raw, cv2.COLOR_BayerRGGB2BGR_EA)
    x0, y0, x1, y1 = box
    part, view = raw[y0:y1, x0:x1], image[y0:y1, x0:x1]
    green = np.ascontiguousarray(view[..., 1])
    for c, first in ((0, 1), (2, 0)):
        every = (slice(first, None, 2), slice(first, None, 2))
        difference = np.zeros(part.shape, np.int16)
        difference[every] = part[every].astype(np.int16) - green[every]
        view[..., c] = cv2.add(green, cv2.sepFilter2D(difference, -1, BETWEEN, BETWEEN), dtype=cv2.CV_8U)
    return image


def _noise_fields(size: int, noise: float, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray] | None:
    """Fields larger than the frame, to be shifted at random: light where there is none, and gain (128 = 1); uint8.

    The camera's black level hides most of the dark noise, so that a dark pixel is nearly always 0.
    """
    if noise == 0:
        return None
    shape = (FIELDS, size + SPARE, size + SPARE)
    dark = np.clip(np.rint(EXPOSURE * rng.normal(-0.75 * noise, 0.5 * noise, shape)), 0, 255)
    gain = np.clip(np.rint(rng.normal(128, 128 * noise / 255, shape)), 0, 255)
    return dark.astype(np.uint8), gain.astype(np.uint8)

"""Finding quadrant disks in one frame: candidates by shape, then the centre by rim and quadrants, then the colour.

Disks of one colour are found by :mod:`expertaug_recordings.markers.plain_disks`, by the same circle.

The centre is the weighted mean of two independent measurements on one polar grid: a robust circle through the points
where 48 rays leave the disk (rays on which an arm or a neighbour touches the rim drop out), and the point about which
the quadrants are symmetric under half a turn.  On compressed clips of fast motion the median errors were .048 and
.058 px, uncorrelated, and .039 px for the mean.  Several disks are fitted in one batch.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from expertaug_recordings.markers.appearance import Appearance
from expertaug_recordings.markers.palette import Palette, hsv
from expertaug_recordings.video.kept_frame import MULTIPLE, KeptFrame

MIN_QUADRANT = 0.4  # share of the brightness' variance round the disk at two periods a turn; .81 for ideal quadrants

MAX_CANDIDATES = 48
RAYS = 48
INNER = 8  # radii inside the disk, for its quadrants and colour
REACH = 4.0  # px searched on either side of the expected rim
STEP = 0.5  # px between samples across the rim
LARGE = 32.0  # px of diameter, above which both grow with it
CROSS_WEIGHT = 0.4  # of the quadrants' centre: its error is uncorrelated with the rim's and a little larger
MAX_CROSS = 0.6  # px between the two beyond which something covers the quadrants and the rim alone counts
NEAR = 0.4  # px from the true centre within which both measurements are linear
PASSES = 3  # of a fit of whatever is there
DISK_SHARE = 0.3  # of the rim, from which on it is one
RIDGE, UNIT = np.float32(1e-3) * np.eye(3, dtype=np.float32), np.eye(2, dtype=np.float32)
LUMA = np.array([0.114, 0.587, 0.299], np.float32)


@dataclass(frozen=True)
class Disks:
    """What was measured at m places; compare with the limits in :class:`DiskFitter`.

    Attributes:
        centre: (m, 2) x, y in px.
        radius: (m,) in px.
        share: (m,) share of the rays whose rim point lies on the circle, 0 to 1.
        residual: (m,) px between the rim's and the inside's centre: large where something covers a part of the disk.
        identity: (m,) 0 pivot, 1 joint, 2 tip, -1 no disk of this style and these colours.
        colour: (m, 3) hue in degrees, saturation and value by which it was told.
    """

    centre: np.ndarray
    radius: np.ndarray
    share: np.ndarray
    residual: np.ndarray
    identity: np.ndarray
    colour: np.ndarray


class DiskFitter:
    """Fits quadrant disks of one expected diameter in BGR frames with a dark background.

    Arguments:
        diameter: expected disk diameter in px.
        min_level: luma (0 to 255) that a disk's darkest sector reaches and the background does not.
        rim_tolerance: distance in px from the circle within which a ray's rim point counts as on it.
        stiffness: how strongly the fitted diameter is drawn to ``diameter``, 0 for not at all; where the diameter is
            known well, this keeps a partly covered disk from being taken for a smaller one beside it.
        appearance: colours of the markers.
    """

    inside_weight = CROSS_WEIGHT
    most_passes, most_moving = PASSES, np.inf  # of a disk that was expected elsewhere; px that the last may still move

    def __init__(
        self,
        diameter: float,
        min_level: float,
        rim_tolerance: float,
        stiffness: float = 0.0,
        appearance: Appearance | None = None,
    ) -> None:
        diameter = float(diameter)  # a number of NumPy's would make double precision of what follows
        self.radius = diameter / 2
        self.appearance = appearance or Appearance()
        self._palette = Palette(self.appearance)
        self.min_level = min_level
        self.rim_tolerance = rim_tolerance
        self.stiffness = stiffness
        angle = np.arange(RAYS) * (2 * np.pi / RAYS)
        unit = np.stack((np.cos(angle), np.sin(angle)), 1)
        inner = np.linspace(0.24, 0.84, INNER) * self.radius
        scale = max(1.0, diameter / LARGE)
        self._reach, self._step = min(REACH * scale, 0.3 * diameter), STEP * scale
        rim = np.arange(self.radius - self._reach, self.radius + self._reach + self._step / 2, self._step)
        offsets = unit[:, None, :] * np.concatenate((inner, rim))[None, :, None]
        self._dx = np.ascontiguousarray(offsets[..., 0], np.float32)
        self._dy = np.ascontiguousarray(offsets[..., 1], np.float32)
        self._basis = np.column_stack((unit, np.ones(RAYS))).astype(np.float32)  # (rays, 3): shift x, shift y, growth
        self._basis_turned = np.ascontiguousarray(self._basis.T)
        self._outer = np.einsum("ki,kj->kij", self._basis, self._basis).reshape(RAYS, 9)
        across = np.stack((-unit[:, 1], unit[:, 0]), 1)[: RAYS // 2].astype(np.float32)
        self._across = across
        self._across_outer = np.einsum("ki,kj->kij", across, across).reshape(-1, 4)
        self._per_px = (RAYS / (4 * np.pi * inner)).astype(np.float32)  # neighbouring rays' difference to a slope
        self._second = np.stack((np.cos(2 * angle), np.sin(2 * angle)), 1).astype(np.float32)
        # Rays, a px beyond them for interpolation, and 2 px that a corner of even numbers may be off.
        self._patch = MULTIPLE * math.ceil((2 * (self.radius + self._reach + 1) + 2 * 2) / MULTIPLE)
        self._shrink = 0.5 / scale
        core = max(3, round(1.1 * self.radius * self._shrink) | 1)  # rods vanish, a core of the disk stays
        self._kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (core, core))

    def candidates(self, image: np.ndarray) -> np.ndarray:
        """Rough centres (m, 2) in px of whatever in a BGR image may be a marker."""
        if not image.size:
            return np.empty((0, 2))
        size = [max(1, round(side * self._shrink)) for side in image.shape[1::-1]]
        small = cv2.resize(self._picture(image), size, interpolation=cv2.INTER_AREA)
        scale = np.divide(image.shape[1::-1], size)
        return (self._blobs(small) + 0.5) * scale - 0.5

    def _picture(self, image: np.ndarray) -> np.ndarray:
        """What :meth:`_blobs` needs of a BGR image."""
        return cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)

    def _blobs(self, small: np.ndarray) -> np.ndarray:
        """Centres (m, 2) in a small grey image of what is bright and at least as thick as a disk's core."""
        mask = cv2.threshold(small, self.min_level, 255, cv2.THRESH_BINARY)[1]
        return self._centres(cv2.erode(mask, self._kernel), (self.radius * self._shrink * 3) ** 2)

    @staticmethod
    def _centres(mask: np.ndarray, largest: float) -> np.ndarray:
        """Centres (m, 2) of the largest parts of a mask; parts of more px than ``largest`` are a hand or a table."""
        _, _, stats, centre = cv2.connectedComponentsWithStats(mask, connectivity=8)
        area = stats[1:, cv2.CC_STAT_AREA]
        order = np.argsort(-area)[:MAX_CANDIDATES]
        return centre[1:][order[area[order] < largest]]

    def fit(self, frame: np.ndarray | KeptFrame, centre: np.ndarray) -> Disks:
        """Fit a disk near each of ``centre`` (m, 2) in a frame, BGR (H, W, 3) or as kept; a centre may be wrong by a
        quarter of the diameter."""
        centre = np.asarray(centre, np.float32)
        for number in range(1, self.most_passes + 1):
            values = self._sample(frame, centre)
            level = self._level(values)
            inner = level[:, :, :INNER]
            solution, share = self._circle(*self._rim(inner, level[:, :, INNER:]))
            shift = np.minimum(np.maximum(solution[:, :2], -self._reach), self._reach)
            far = np.maximum.reduce(np.abs(shift), 1)
            # Where it still moves a wrong place is measured; what is no disk never comes to rest.
            moving = far if number < PASSES else far[share > DISK_SHARE]
            if number == self.most_passes or max(moving.tolist(), default=0.0) < NEAR:
                break
            centre = centre + shift
        apart = self._apart(inner, shift)
        near = (np.maximum.reduce(np.abs(apart), 1) < MAX_CROSS) & (far < NEAR)
        centre = centre + shift + (np.float32(self.inside_weight) * near)[:, None] * apart
        share = np.where(far < self.most_moving, share, 0)
        colour, shaped = self._colour(values[:, :, :INNER], inner)
        identity = np.where(shaped, self._palette.identify(colour), -1)
        radius = self.radius + (1 + self.stiffness) * solution[:, 2]
        return Disks(centre, radius, share, np.hypot(apart[:, 0], apart[:, 1]), identity, colour)

    def _sample(self, frame: np.ndarray | KeptFrame, centre: np.ndarray) -> np.ndarray:
        """Colours along the rays, (m, rays, radii, 3) float32."""
        count = len(centre)
        if isinstance(frame, KeptFrame):
            frame, centre = self._patches(frame, centre)
        x = (centre[:, 0, None, None] + self._dx).reshape(count * RAYS, -1)
        y = (centre[:, 1, None, None] + self._dy).reshape(count * RAYS, -1)
        colours = cv2.remap(frame, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
        return colours.reshape(count, RAYS, -1, 3).astype(np.float32)

    def _patches(self, frame: KeptFrame, centre: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """An image of what the rays need, and where the centres (m, 2) are in it; all of a frame without patches."""
        if not frame.in_patches:
            return frame.image, centre
        corners = [(2 * math.floor(x / 2), 2 * math.floor(y / 2)) for x, y in (centre - self._patch / 2).tolist()]
        beside = np.array([(k * self._patch - x, -y) for k, (x, y) in enumerate(corners)], np.float32)
        return frame.patches(corners, self._patch), centre + beside

    def _rim(self, inner: np.ndarray, rim: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distance (m, rays) in px from the expected rim at which each ray falls to half its own inner brightness, and
        the ray's weight, 0 where it does not.

        Relative to the ray's own brightness, because white sectors are several times brighter than coloured ones; their
        rim points are more exact for the same reason.
        """
        inside = self._inside(inner)
        half = (0.5 * inside).reshape(-1)
        rim = rim.reshape(-1, rim.shape[2])
        index = self._fall(rim < half[:, None])
        rows = np.arange(len(rim))
        last = np.maximum(index, 1)
        before, after = rim[rows, last - 1], rim[rows, last]
        part = (before - half) / np.maximum(before - after, 1e-3)
        error = ((last - 1).astype(np.float32) + part) * np.float32(self._step) - np.float32(self._reach)
        falls = (index > 0).reshape(inside.shape) & (inside > self.min_level)
        return error.reshape(inside.shape), falls * (inside * np.float32(0.01))

    def _fall(self, below: np.ndarray) -> np.ndarray:
        """Number of the sample (n,) at which each ray's level falls below half of its inner one, of (n, samples); 0 for
        none.  The first counts: a rod or a neighbour further out does not matter."""
        return below.argmax(1)

    def _circle(self, error: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Robust least squares of the rim distances on (shift x, shift y, growth): solution (m, 3) and share (m,)."""
        middle = np.sort((weight > 0) * error, axis=1)[:, RAYS // 2]
        used = weight * (np.abs(error - middle[:, None]) < 0.8 * self._reach)
        ridge = np.empty((len(error), 3, 3), np.float32)
        ridge[:] = RIDGE
        ridge[:, 2, 2] += self.stiffness * np.add.reduce(weight, 1)
        for tolerance in (2.5 * self.rim_tolerance, self.rim_tolerance, self.rim_tolerance):
            normal = (used @ self._outer).reshape(-1, 3, 3) + ridge
            solution = np.linalg.solve(normal, ((used * error) @ self._basis)[..., None])[..., 0]
            distance = np.abs(error - solution @ self._basis_turned)
            used = weight * (distance < tolerance)
        return solution, np.count_nonzero(used, axis=1) / RAYS

    def _level(self, values: np.ndarray) -> np.ndarray:
        """Brightness (m, rays, radii) of the samples, which falls at the rim."""
        return values @ LUMA

    def _inside(self, inner: np.ndarray) -> np.ndarray:
        """Each ray's own level inside the disk, (m, rays)."""
        return np.add.reduce(inner[:, :, 2:6], 2) * np.float32(0.25)

    def _apart(self, inner: np.ndarray, shift: np.ndarray) -> np.ndarray:
        """From the rim's centre, at ``shift``, to the point about which the quadrants are symmetric under half a turn,
        (m, 2) in px.

        With g the slope across a ray, opposite samples differ by -2 g t·d for a centre that is off by d, t the
        direction across the ray: least squares over the samples.
        """
        half = RAYS // 2
        turned = np.concatenate((inner[:, -1:], inner, inner[:, :1]), 1)
        slope = (turned[:, 2:] - turned[:, :-2]) * self._per_px
        slope = 0.5 * (slope[:, :half] + slope[:, half:])
        difference = inner[:, :half] - inner[:, half:]
        normal = (np.einsum("mrk,mrk->mr", slope, slope) @ self._across_outer).reshape(-1, 2, 2) + UNIT
        right = np.float32(-0.5) * (np.einsum("mrk,mrk->mr", slope, difference) @ self._across)
        return np.linalg.solve(normal, right[..., None])[..., 0] - shift

    def _colour(self, colours: np.ndarray, level: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Hue, saturation and value (m, 3) of the dark sectors relative to the white ones, and whether there are four
        sectors, (m,).

        The "white" of a real frame is tinted: the ratio is the white balance.
        """
        brightness = np.add.reduce(level, 2)
        order = np.argsort(brightness, axis=1)
        third = RAYS // 3
        rows = np.arange(len(colours))[:, None]
        parts = (colours[rows, part] for part in (order[:, :third], order[:, -third:]))
        dark, white = (np.add.reduce(part.reshape(len(colours), -1, 3), 1) for part in parts)
        swing = brightness - np.add.reduce(brightness, 1, keepdims=True) * np.float32(1 / RAYS)
        wave = swing @ self._second
        power, whole = np.einsum("mk,mk->m", wave, wave), np.einsum("mk,mk->m", swing, swing)
        quadrant = power * (2 / RAYS) / np.maximum(whole, 1e-3 * INNER**2)
        return hsv(dark / np.maximum(white, third * INNER)), quadrant > MIN_QUADRANT

"""Finding and fitting a frame's disks, and telling them by their colours.

Quadrant disks are found by shape, then their centre by rim and quadrants, then their colour.  The centre is the
weighted mean of two independent measurements on one polar grid: a robust circle through the points where 48 rays leave
the disk (rays on which an arm or a neighbour touches the rim drop out), and the point about which the quadrants are
symmetric under half a turn.  On compressed clips of fast motion the median errors were .048 and .058 px, uncorrelated,
and .039 px for the mean.  Several disks are fitted in one batch.

Of a disk of one colour, on whatever background, the rim alone is seen: it is where a ray's colour is halfway between
the disk's and what lies beyond, so that a disk may be darker or brighter than its background, and the background
different on either side.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from expertaug_recordings.markers.appearance import Appearance, Colour
from expertaug_recordings.video.pixel_layout import MULTIPLE, KeptFrame

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
OUTSIDE = 3  # samples at the end of a ray that tell what lies beyond the rim
COLOUR_WEIGHT = 0.01
MIN_CONTRAST = 6.0  # grey levels, in this metric, between the disk and beyond: below, a ray tells nothing
FULL = 200.0  # level of the disk's colour; what lies beyond has 0
VALID = (0.6, 1.4)  # of the disk's level: what is outside of it is something else
ALIKE = 1.15  # over 1 by the squared tangent of the angle between two colours: of one hue and chroma in any light
UNEVEN = (0.4, 0.25)  # off the plane of light, relative to all of the disk: samples further off do not tell it
LIGHT = (0.3, 3.0)  # of the light, at the least and at the most
ENOUGH = 2  # samples of a ray that are of the disk's level: the others may be burnt in
NEAR_COLOUR = 0.3  # of a colour's distance to black, within which a sample is of it
RIDGE, UNIT = np.float32(1e-3) * np.eye(3, dtype=np.float32), np.eye(2, dtype=np.float32)
LUMA = np.array([0.114, 0.587, 0.299], np.float32)
# Brightness counts more than colour, which video keeps at half the resolution and half a pixel off.
METRIC = np.outer(LUMA, LUMA) + np.float32(COLOUR_WEIGHT) * np.eye(3, dtype=np.float32)
# Samples' worth of an even light, and of one that is the disk's own in its middle, by whose colour it is told.
LIGHT_RIDGE = np.diag(np.float32([40, 4, 4]))
# An even light, and its lean towards one side (at the rim, as a share) that edges of what is burnt in may feign.
EVEN, LEAN = np.float32([1, 0, 0]), np.float32(0.1)
MIDDLE = slice(2, INNER)  # samples inside that a hub leaves alone


def hsv(bgr: np.ndarray) -> np.ndarray:
    """Hue in degrees, saturation and value of colours (m, 3) with full light at 1."""
    return np.array([_hsv(*colour) for colour in bgr.tolist()]).reshape(-1, 3)


def _hsv(blue: float, green: float, red: float) -> tuple[float, float, float]:
    """Of one colour: of a few, numbers of Python's are several times as fast as arrays."""
    value, chroma = max(blue, green, red), max(blue, green, red) - min(blue, green, red)
    # A hexagon's corners are the primary colours; each third of it starts at the strongest one.
    if value == red:
        start, third = 0.0, green - blue
    elif value == green:
        start, third = 120.0, blue - red
    else:
        start, third = 240.0, red - green
    return (start + 60 * third / max(chroma, 1e-9)) % 360, chroma / max(value, 1e-9), value


class Palette:
    """Tells markers by hue, saturation and value."""

    def __init__(self, appearance: Appearance) -> None:
        self._seen = [
            (k, c.middle, c.reach, c.saturation, c.value) for k, c in enumerate(appearance.colours) if c is not None
        ]

    def identify(self, colour: np.ndarray) -> np.ndarray:
        """Which marker (m,) has this hue, saturation and value (m, 3): of several the nearest hue, of none -1."""
        return np.array([self._nearest(*row) for row in colour.tolist()], int)

    def _nearest(self, hue: float, saturation: float, value: float) -> int:
        nearest, least = -1, 360.0
        for k, middle, reach, saturations, values in self._seen:
            away = abs((hue - middle + 180) % 360 - 180)
            strong = saturations[0] <= min(saturation, 1) <= saturations[1] and values[0] <= min(value, 1) <= values[1]
            if strong and away <= reach and away < least:
                nearest, least = k, away
        return nearest


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


class PlainFitter(DiskFitter):
    """Fits plain disks of one expected diameter; arguments as of :class:`DiskFitter` (``min_level`` does not matter).

    The centre is the rim's alone: inside there is nothing to see but what covers a part.
    """

    inside_weight = 0.0
    # Of quadrants under strong motion blur further passes give centres that are off by a pixel.
    most_passes, most_moving = 8, 2 * NEAR

    def __init__(self, *arguments: object, **options: object) -> None:
        super().__init__(*arguments, **options)
        dx, dy = self._dx[:, :INNER].ravel(), self._dy[:, :INNER].ravel()
        area = np.hypot(dx, dy)  # of a polar grid's cells
        self._moments = np.stack((area, area * dx, area * dy), 1)
        self._area = area.reshape(RAYS, INNER)[0]
        thin = max(3, len(self._kernel) // 2 | 1)
        self._thin = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (thin, thin))
        samples = self._dx.shape[1] - INNER
        self._middle = samples // 2  # the sample at the expected rim
        # Of a ring's edge and the rim about it that counts which is nearer to where the rim is expected.
        self._nearness = (samples - np.abs(np.arange(samples) - (samples - 1) / 2)).astype(np.float32)
        # of a plane over the disk, for every sample and for those that tell it
        plane = np.stack((np.ones_like(self._dx), self._dx / self.radius, self._dy / self.radius), 2)
        self._everywhere = np.ascontiguousarray(plane.reshape(-1, 3).T)
        self._known = np.ascontiguousarray(plane[:, MIDDLE].reshape(-1, 3))
        self._known_turned = np.ascontiguousarray(self._known.T)
        self._products = np.einsum("si,sj->sij", self._known, self._known).reshape(-1, 9)

    def _level(self, values: np.ndarray) -> np.ndarray:
        """Share (m, rays, radii) of the disk's colour in a sample, from what lies beyond the ray's end: 0 to FULL.

        The disk's colour is that of its light there: what lies beyond has a light of its own.
        """
        inner = values[:, :, :INNER]
        disk = self._disk(inner[:, ::2])
        light = self._light(inner[:, :, MIDDLE], disk)
        at_rim = light[:, :, INNER + self._middle]
        beyond = np.add.reduce(values[:, :, -OUTSIDE:], 2) * np.float32(1 / OUTSIDE)
        step = disk[:, None] * at_rim[..., None] - beyond
        axis = step @ METRIC
        contrast = np.einsum("mrc,mrc->mr", step, axis)
        step = axis * ((contrast > MIN_CONTRAST**2) * np.float32(FULL) / np.maximum(contrast, 1))[..., None]
        lit = np.concatenate((inner * (at_rim[..., None] / light[:, :, :INNER])[..., None], values[:, :, INNER:]), 2)
        return (lit @ step[..., None])[..., 0] - np.einsum("mrc,mrc->mr", beyond, step)[..., None]

    def _disk(self, inner: np.ndarray) -> np.ndarray:
        """The disk's colour (m, 3) among samples (m, rays, radii, 3): of the medians at each radius the one with the
        most chroma that others have, too.  What is burnt in is black, white or grey."""
        medians = _median(inner)  # (m, radii, 3)
        chroma = np.maximum.reduce(medians, 2) - np.minimum.reduce(medians, 2)
        away = medians[:, :, None] - medians[:, None]
        reach = np.float32(NEAR_COLOUR**2) * np.einsum("mkc,mkc->mk", medians, medians)
        alike = np.einsum("mkic,mkic->mki", away, away) < reach[:, :, None]
        chosen = (chroma * (alike @ self._area)).argmax(1)
        return medians[np.arange(len(inner)), chosen]

    def _light(self, inner: np.ndarray, disk: np.ndarray) -> np.ndarray:
        """How bright the disk is at each sample, relative to all of it, (m, rays, radii): a plane, as light from one
        side makes it, through the samples (m, rays, radii inside, 3) of the disk's own hue and chroma.  What is burnt
        in or covers a part is left out."""
        inner = inner.reshape(len(inner), -1, 3)
        own = np.maximum(np.einsum("mc,mc->m", disk, disk), 1)[:, None]
        bright = (inner @ (disk / own)[..., None])[..., 0]
        strength = np.einsum("msc,msc->ms", inner, inner)
        alike = strength < ALIKE * own * bright**2
        plane = np.zeros((len(inner), 3), np.float32)
        plane[:, 0] = 1
        for reach in UNEVEN:
            used = (alike & (np.abs(bright - plane @ self._known_turned) < reach)).astype(np.float32)
            normal = (used @ self._products).reshape(-1, 3, 3) + LIGHT_RIDGE
            off = (used * (bright - 1)) @ self._known
            plane = np.linalg.solve(normal, off[..., None])[..., 0]
            plane[:, 0] += 1
        lean = plane - EVEN  # a little of it makes centres worse, not better
        steep = np.hypot(lean[:, 1:2], lean[:, 2:]) ** 4
        plane = EVEN + lean * (steep / (steep + LEAN**4))
        light = (plane @ self._everywhere).reshape(len(inner), *self._dx.shape)
        return np.minimum(np.maximum(light, LIGHT[0]), LIGHT[1])

    def _inside(self, inner: np.ndarray) -> np.ndarray:
        sound = (inner > VALID[0] * FULL) & (inner < VALID[1] * FULL)
        return np.where(sound.sum(2) >= ENOUGH, np.float32(FULL), np.float32(0))

    def _fall(self, below: np.ndarray) -> np.ndarray:
        falls = np.zeros_like(below)  # from the disk's level: what is burnt in near the rim is below it, too
        np.greater(below[:, 1:], below[:, :-1], out=falls[:, 1:])
        return (falls * self._nearness).argmax(1)

    def _apart(self, inner: np.ndarray, shift: np.ndarray) -> np.ndarray:
        """Centre of gravity (m, 2) in px of the disk's colour inside the rim: off where something covers a part."""
        share = np.clip(inner, 0, FULL).reshape(len(inner), -1)
        moment = share @ self._moments
        return moment[:, 1:] / np.maximum(moment[:, :1], 1e-3)

    def _colour(self, colours: np.ndarray, level: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Hue, saturation and value (m, 3) of the disks, and whether they are of one colour, (m,)."""
        return hsv(self._disk(colours[:, ::2]) / 255), (self._inside(level) > 0).mean(1) > 0.5

    def _picture(self, image: np.ndarray) -> np.ndarray:
        return image

    def _blobs(self, small: np.ndarray) -> np.ndarray:
        """Centres (m, 2) in a small BGR image of parts of the markers' colours as thick as a disk's core."""
        picture = cv2.cvtColor(small, cv2.COLOR_BGR2HSV)
        largest = (self.radius * self._shrink * 3) ** 2
        parts = []
        for colour in filter(None, self.appearance.colours):
            whole = cv2.morphologyEx(
                mask_of(picture, colour), cv2.MORPH_CLOSE, self._kernel
            )  # a hub or a screw is filled
            centres = self._centres(cv2.erode(whole, self._kernel), largest)
            # A ring close to the rim leaves a thinner core, and of the rim too little to see in a small image.
            parts.append(centres if len(centres) else self._centres(cv2.erode(whole, self._thin), largest))
        return np.concatenate(parts)


def _median(values: np.ndarray) -> np.ndarray:
    """Upper median of values (m, n, ...) along n: np.median checks for NaN, which costs as much again."""
    middle = values.shape[1] // 2
    return np.partition(values, middle, axis=1)[:, middle]


def fitter(
    diameter: float, min_level: float, rim_tolerance: float, appearance: Appearance, stiffness: float = 0.0
) -> DiskFitter:
    """The fitter of a style of markers."""
    kind = DiskFitter if appearance.style == "quadrant" else PlainFitter
    return kind(diameter, min_level, rim_tolerance, stiffness, appearance)


def mask_of(picture: np.ndarray, colour: Colour) -> np.ndarray:
    """Where an HSV image (H, W, 3), uint8 with hues in steps of 2°, has a colour."""
    low, high = ([round(255 * v[end]) for v in (colour.saturation, colour.value)] for end in (0, 1))
    first, last = (round(h / 2) % 180 for h in colour.hue)
    if first <= last:
        return cv2.inRange(picture, (first, *low), (last, *high))
    return cv2.inRange(picture, (first, *low), (180, *high)) | cv2.inRange(picture, (0, *low), (last, *high))

"""Finding disks of one colour in one frame, whatever the background.

The rim is where a ray's colour is halfway between the disk's and what lies beyond, so that a disk may be darker or
brighter than its background, and the background different on either side.
"""

from __future__ import annotations

import cv2
import numpy as np

from expertaug_recordings.markers.appearance import Appearance, Colour
from expertaug_recordings.markers.palette import hsv
from expertaug_recordings.markers.quadrant_disks import INNER, LUMA, NEAR, RAYS, DiskFitter

OUTSIDE = 3  # samples at the end of a ray that tell what lies beyond the rim
COLOUR_WEIGHT = 0.01
# Brightness counts more than colour, which video keeps at half the resolution and half a pixel off.
METRIC = np.outer(LUMA, LUMA) + np.float32(COLOUR_WEIGHT) * np.eye(3, dtype=np.float32)
MIN_CONTRAST = 6.0  # grey levels, in this metric, between the disk and beyond: below, a ray tells nothing
FULL = 200.0  # level of the disk's colour; what lies beyond has 0
VALID = (0.6, 1.4)  # of the disk's level: what is outside of it is something else
ALIKE = 1.15  # over 1 by the squared tangent of the angle between two colours: of one hue and chroma in any light
UNEVEN = (0.4, 0.25)  # off the plane of light, relative to all of the disk: samples further off do not tell it
# Samples' worth of an even light, and of one that is the disk's own in its middle, by whose colour it is told.
RIDGE = np.diag(np.float32([40, 4, 4]))
# An even light, and its lean towards one side (at the rim, as a share) that edges of what is burnt in may feign.
EVEN, LEAN = np.float32([1, 0, 0]), np.float32(0.1)
LIGHT = (0.3, 3.0)  # of the light, at the least and at the most
ENOUGH = 2  # samples of a ray that are of the disk's level: the others may be burnt in
MIDDLE = slice(2, INNER)  # samples inside that a hub leaves alone
NEAR_COLOUR = 0.3  # of a colour's distance to black, within which a sample is of it


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
            normal = (used @ self._products).reshape(-1, 3, 3) + RIDGE
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
            found = self._centres(cv2.erode(whole, self._kernel), largest)
            # A ring close to the rim leaves a thinner core, and of the rim too little to see in a small image.
            parts.append(found if len(found) else self._centres(cv2.erode(whole, self._thin), largest))
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

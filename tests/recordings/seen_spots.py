"""Markers as inspect sees them in frames, without any picture."""

from __future__ import annotations

import functools

import numpy as np
from drawn import ARMS, PIVOT, markers_of, swinging

from expertaug_recordings.inspection.detect import Spot

HUES, FRAMES = (0.0, 135.0, 230.0), 10


def sightings(places: np.ndarray, hue: float, share: float = 0.9) -> list[Spot]:
    """Of a disk of 24 px and a hue in degrees at places (n, 2) in px, one a frame."""
    return [Spot(k, tuple(place), 24.0, share, (hue, 0.8, 0.8)) for k, place in enumerate(places.tolist())]


@functools.cache
def swing() -> np.ndarray:
    """Pivot, joint and tip (FRAMES, 3, 2) in px."""
    return markers_of(swinging(24 * FRAMES, (1.2, 0.5, 0.0, 0.0))[::24, :2], PIVOT, ARMS)

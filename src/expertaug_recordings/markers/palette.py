"""Telling markers by their colours."""

from __future__ import annotations

import numpy as np

from expertaug_recordings.markers.appearance import Appearance


def hsv(bgr: np.ndarray) -> np.ndarray:
    """Hue in degrees, saturation and value of colours (m, 3) with full light at 1."""
    return np.array([_hsv(*one) for one in bgr.tolist()]).reshape(-1, 3)


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
        return np.array([self._nearest(*one) for one in colour.tolist()], int)

    def _nearest(self, hue: float, saturation: float, value: float) -> int:
        found, least = -1, 360.0
        for k, middle, reach, saturations, values in self._seen:
            away = abs((hue - middle + 180) % 360 - 180)
            strong = saturations[0] <= min(saturation, 1) <= saturations[1] and values[0] <= min(value, 1) <= values[1]
            if strong and away <= reach and away < least:
                found, least = k, away
        return found

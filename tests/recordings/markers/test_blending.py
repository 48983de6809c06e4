"""Frames that are mixtures of two: told from the pictures, and not seen where there are none."""

import numpy as np
import pytest
from drawn import PAINT, draw, markers_of
from pendulum_motion import truth

from expertaug_recordings.markers.blending import find_blended

SIZE, PIVOT, ARMS, DIAMETER, START = (220, 220), (110.3, 109.6), (55.0, 42.0), 16.0, 600
COLOURS = [PAINT[name] for name in ("red", "green", "blue")]


def filmed(step, count, exposure=0.0, shots=1):
    """Frames and true places of every so many states of 400 Hz, averaged over so many shots of an exposure (in
    frames)."""
    at = START + step * (np.arange(count)[:, None] + exposure * ((np.arange(shots) + 0.5) / shots - 0.5))
    theta = truth()[1, np.rint(at).astype(int), :2]
    pictures = [draw(markers_of(theta[:, k], PIVOT, ARMS), SIZE, COLOURS, DIAMETER) for k in range(shots)]
    middle = truth()[1, START + step * np.arange(count), :2]
    return np.rint(np.mean(pictures, axis=0)).astype(np.uint8), markers_of(middle, PIVOT, ARMS)


def mixed(frames, places, ratio, count):
    """The same brought to another rate by mixing neighbours: frames, places of the stronger image, and its share."""
    at = np.arange(count) * ratio
    first, part = np.floor(at + 1e-9).astype(int), (at + 1e-9) % 1
    between = [(1 - p) * frames[k] + p * frames[k + 1] for k, p in zip(first, part, strict=True)]
    return np.rint(between).astype(np.uint8), places[first + (part > 0.5)], np.maximum(part, 1 - part)


@pytest.mark.parametrize("ratio", [0.5, 5 / 6])
def test_mixtures_of_nearly_equal_parts_are_found(ratio):
    frames, places = filmed(13, 42)
    pictures, place, share = mixed(frames, places, ratio, 40)
    blended = find_blended(pictures, place, DIAMETER)
    tip = places[:, 2]
    fast = np.linalg.norm(np.diff(tip, axis=0), axis=1)[np.floor(np.arange(40) * ratio + 1e-9).astype(int)] > 10
    assert (fast & (share < 0.55)).sum() > 3 and blended[fast & (share < 0.55)].mean() > 0.7
    assert not blended[share > 0.65].any()


def test_nothing_is_mixed_in_sharp_frames():
    assert not find_blended(*filmed(13, 40), DIAMETER).any()


def test_nothing_is_mixed_in_frames_of_a_long_exposure():
    """For half of the time from frame to frame."""
    assert not find_blended(*filmed(8, 18, exposure=0.5, shots=4), DIAMETER).any()

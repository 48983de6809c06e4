"""Noisy synthetic recordings of a known double pendulum, and where the real ones are."""

import functools
import math
import os
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from expertaug.systems.double_pendulum import Constants
from expertaug_recordings.rendering.motion import MAX_STEP, STEPS_PER_FRAME_AT_400_HZ

CONSTANTS = Constants(B1=0.103, G1=69.4, B2=1.366, G2=93.6)
FRICTION = (0.03, 0.12)
LAUNCHES = ((2.2, 1.0, -6.0, -12.0), (1.8, 2.0, -5.0, -9.0), (2.8, 0.3, -3.0, -14.0))
MARKERS = ("pivot_x", "pivot_y", "joint_x", "joint_y", "tip_x", "tip_y")


@functools.cache
def truth() -> np.ndarray:
    """States (3 launches, 16000, 4) at 400 Hz: the numbers of ``rendering.motion.simulate``, in half of its time."""
    found = np.stack([swing(launch, 16000) for launch in LAUNCHES])
    found.flags.writeable = False  # all tests have the same
    return found


def swing(launch: tuple[float, ...], count: int) -> np.ndarray:
    """States (count, 4) at 400 Hz, by the same steps in plain floats: arrays of four numbers cost more than they."""
    h, b1, b2, g1, g2 = MAX_STEP, CONSTANTS.B1, CONSTANTS.B2, CONSTANTS.G1, CONSTANTS.G2
    (r1, r2), half, sixth = FRICTION, MAX_STEP / 2, MAX_STEP / 6
    sin, cos, b12, b1_over_b2 = math.sin, math.cos, b1 * b2, b1 / b2

    def rates(a: float, b: float, u: float, v: float) -> tuple[float, float]:
        s, c, rub = sin(a - b), cos(a - b), r2 * (v - u)
        right1 = -b1 * s * v * v - g1 * sin(a) - r1 * u + b1_over_b2 * rub
        right2 = b2 * s * u * u - g2 * sin(b) - rub
        det = 1 - b12 * c * c
        return (right1 - b1 * c * right2) / det, (right2 - b2 * c * right1) / det

    a, b, u, v = launch
    states = [launch]
    for _ in range(count - 1):
        for _ in range(STEPS_PER_FRAME_AT_400_HZ):
            p1, q1 = rates(a, b, u, v)
            u2, v2 = u + half * p1, v + half * q1
            p2, q2 = rates(a + half * u, b + half * v, u2, v2)
            u3, v3 = u + half * p2, v + half * q2
            p3, q3 = rates(a + half * u2, b + half * v2, u3, v3)
            u4, v4 = u + h * p3, v + h * q3
            p4, q4 = rates(a + h * u3, b + h * v3, u4, v4)
            a, b = a + sixth * (u + 2 * u2 + 2 * u3 + u4), b + sixth * (v + 2 * v2 + 2 * v3 + v4)
            u, v = u + sixth * (p1 + 2 * p2 + 2 * p3 + p4), v + sixth * (q1 + 2 * q2 + 2 * q3 + q4)
        states.append((a, b, u, v))
    return np.array(states)


def markers(y: np.ndarray, rate: float = 400.0, noise: float = 0.07, seed: int = 0) -> pd.DataFrame:
    """A markers.csv table of states (n, 4) with white noise in px."""
    n, rng = len(y), np.random.default_rng(seed)
    red = np.tile([240.0, 238.0], (n, 1))
    green = red + 118 * np.stack([np.sin(y[:, 0]), np.cos(y[:, 0])], axis=1)
    blue = green + 90 * np.stack([np.sin(y[:, 1]), np.cos(y[:, 1])], axis=1)
    table = pd.DataFrame({"frame": np.arange(n), "t": np.arange(n) / rate})
    points = np.concatenate((red, green, blue), axis=1) + noise * rng.normal(size=(n, 6))
    for k, name in enumerate(MARKERS):
        table[name] = points[:, k]
    table["quality"], table["reason"] = 1.0, ""
    return table


def real_recordings() -> Path:
    default = Path(__file__).parents[2].parent / "shared" / "recordings"
    folder = Path(os.environ.get("EXPERTAUG_RECORDINGS", default))
    if not folder.is_dir():
        pytest.skip("the real recordings are not here: set EXPERTAUG_RECORDINGS to their folder")
    return folder

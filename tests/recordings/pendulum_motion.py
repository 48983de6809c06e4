"""Noisy synthetic recordings of a known double pendulum, and where the real ones are."""

import functools
import os
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import odeint

from expertaug.systems.double_pendulum import Constants
from expertaug_recordings.rendering.motion import _accelerations

CONSTANTS = Constants(B1=0.103, G1=69.4, B2=1.366, G2=93.6)
FRICTION = (0.03, 0.12)
LAUNCHES = ((2.2, 1.0, -6.0, -12.0), (1.8, 2.0, -5.0, -9.0), (2.8, 0.3, -3.0, -14.0))
MARKERS = ("pivot_x", "pivot_y", "joint_x", "joint_y", "tip_x", "tip_y")


@functools.cache
def truth() -> np.ndarray:
    """States (3 launches, 16000, 4) at 400 Hz, in steps as long as the motion allows."""

    def slope(state: np.ndarray, _: float) -> tuple[float, ...]:
        a, b, u, v = state.tolist()
        return (u, v, *_accelerations(a, b, u, v, CONSTANTS, FRICTION))

    times = np.arange(16000) / 400
    found = np.stack([odeint(slope, launch, times, rtol=1e-10, atol=1e-10) for launch in LAUNCHES])
    found.flags.writeable = False  # all tests have the same
    return found


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

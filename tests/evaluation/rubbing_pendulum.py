"""The motion of a double pendulum with friction, and what the study of dissipation asks of it."""

from __future__ import annotations

import numpy as np
from pendulum_motion import CONSTANTS, FRICTION

from expertaug.evaluation.settings import DissipationJob, FittedVersion
from expertaug.systems.double_pendulum import DoublePendulum
from expertaug.trajectories import Trajectories
from expertaug_recordings.rendering.motion import simulate

T = np.arange(20) / 100


def motion(n=60, seed=0):
    """Chunks (N, T, 4) of the true motion with friction, from two recordings."""
    low, high = np.array([-2.0, -2.0, -8.0, -15.0]), np.array([2.0, 2.0, 8.0, 15.0])
    start = np.random.default_rng(seed).uniform(low, high, size=(n, 4))
    y = simulate(start, T, CONSTANTS, FRICTION)
    names = np.array([f"{'ab'[k % 2]}/{k}" for k in range(n)])
    return Trajectories(T, y, y[:, 0, 2:], id=names)


def pendulum(**arguments):
    return DoublePendulum("compound", CONSTANTS.to_dict(), **arguments)


def asked(**versions):
    fitted = [FittedVersion(name, label, None) for name, label in versions.items()]
    return DissipationJob(experiment="swing", versions=fitted, hues=[("rubbing", 0), ("half", 1)], device="cpu")


JOB = asked(rubbing="With friction", half="Half of it")

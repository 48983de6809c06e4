"""Motion of a launched rigid double pendulum with friction in its joints: what the rendered recordings show."""

from __future__ import annotations

import math

import numpy as np

from expertaug.errors import InputError
from expertaug.systems.double_pendulum import Constants, energy
from expertaug_recordings.runge_kutta import step
from expertaug_recordings.settings import LaunchSettings

STEPS_PER_FRAME_AT_400_HZ = 4
MAX_STEP = 1 / (400 * STEPS_PER_FRAME_AT_400_HZ)  # s; the fastest launches turn by .05 rad in one


class Launch(LaunchSettings):
    """How a hand lets the pendulum go; every value is drawn uniformly from its (low, high) range."""

    def draw(self, rng: np.random.Generator, constants: Constants) -> np.ndarray:
        """One initial state (θ1, θ2, θ1', θ2'), (4,), in rad and rad/s.

        Raises:
            InputError: the drawn angles alone hold more than the drawn energy.
        """
        target, theta1, theta2, ratio = (
            rng.uniform(*r) for r in (self.energy, self.theta1, self.theta2, self.speed_ratio)
        )
        at_rest = float(energy(np.array([theta1, theta2, 0.0, 0.0]), constants))
        kinetic_of_one = float(energy(np.array([theta1, theta2, 1.0, ratio]), constants)) - at_rest
        if target <= at_rest:
            raise InputError(
                "launch.energy",
                f"{target:.0f} s⁻² is less than the {at_rest:.0f} s⁻² of the angles",
                "raise the range's lower end",
            )
        speed = -math.sqrt((target - at_rest) / kinetic_of_one)
        mirror = rng.choice((-1.0, 1.0))
        return mirror * np.array([theta1, theta2, speed, ratio * speed])


def simulate(start: np.ndarray, times: np.ndarray, constants: Constants, friction: tuple[float, float]) -> np.ndarray:
    """States of each launch at evenly spaced times, by classical Runge-Kutta steps of at most ``MAX_STEP``.

    One launch at a time, its forces in plain floats: for the few recordings of a set this is faster than tensors of a
    few numbers each, and a recording's bits do not depend on how many are made with it.

    Arguments:
        start: states (N, 4) at ``times[0]``.
        times: (T,) in s, evenly spaced.
        constants: the rigid body's.
        friction: viscous friction of the two joints in s⁻¹, as in :mod:`expertaug.systems.double_pendulum`.

    Returns:
        (N, T, 4) float64.
    """
    interval = (times[-1] - times[0]) / (len(times) - 1) if len(times) > 1 else 0.0
    substeps = max(1, math.ceil(interval / MAX_STEP - 1e-9))

    def slope(y: np.ndarray) -> np.ndarray:
        a, b, u, v = y.tolist()
        return np.array((u, v, *_accelerations(a, b, u, v, constants, friction)))

    out = np.empty((len(start), len(times), 4))
    for states, first in zip(out, start, strict=True):
        states[0] = state = np.array(first, dtype=float)
        for k in range(1, len(times)):
            for _ in range(substeps):
                state = step(slope, state, interval / substeps)
            states[k] = state
    return out


def _accelerations(
    a: float, b: float, u: float, v: float, c: Constants, friction: tuple[float, float]
) -> tuple[float, float]:
    """The same equations as ``systems.double_pendulum.accelerations`` for floats; a test holds the two together."""
    sin, cos = math.sin(a - b), math.cos(a - b)
    rub = friction[1] * (v - u)
    right1 = -c.B1 * sin * v * v - c.G1 * math.sin(a) - friction[0] * u + c.B1 / c.B2 * rub
    right2 = c.B2 * sin * u * u - c.G2 * math.sin(b) - rub
    determinant = 1 - c.B1 * c.B2 * cos * cos
    return (right1 - c.B1 * cos * right2) / determinant, (right2 - c.B2 * cos * right1) / determinant

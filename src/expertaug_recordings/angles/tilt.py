"""The direction of gravity that the motion of a double pendulum implies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from expertaug_recordings.angles.pendulum_fit import CLUSTER_POINTS, spans

CERTAIN_DEG = 3.0  # standard error of a direction that is known
AGREE = 4.0  # standard errors of their difference, and CERTAIN_DEG, by which the two arms' directions may differ
PULL = 5.0  # standard errors by which gravity is more than none


@dataclass(frozen=True)
class Gravity:
    """Direction of gravity.

    Attributes:
        degrees: from the direction of which the angles are measured, positive towards positive angles, in (-180, 180].
        error_deg: standard error.
    """

    degrees: float
    error_deg: float


def find_gravity(y: np.ndarray, interval: float, every: int = 1) -> Gravity | None:
    """Direction in which gravity pulls, by the changes of momentum.

    In the equations of :mod:`.pendulum_fit`, a pull G in the direction φ is G sin(θ − φ): the two components G cos φ
    and G sin φ are linear, so that no direction needs to be tried.  Each arm has its own; only where both are
    certain and agree is the direction known.

    Arguments:
        y: states (T, 4), evenly spaced, whose angles are measured from any direction; NaN where they are not known.
        interval, every: as of :func:`expertaug_recordings.angles.pendulum_fit.fit_constants`.

    Returns:
        None where the motion does not tell it.
    """
    found = [_direction(y, interval, every, arm) for arm in (0, 1)]
    if None in found:
        return None
    angles, errors = (np.array([one[k] for one in found]) for k in (0, 1))
    apart = abs(float(np.angle(np.exp(1j * (angles[0] - angles[1])))))
    if apart > AGREE * np.hypot(*errors) + np.deg2rad(CERTAIN_DEG):
        return None
    weights = 1 / np.maximum(errors, 1e-9) ** 2
    middle = float(np.angle((weights * np.exp(1j * angles)).sum()))
    error = float(np.rad2deg(np.sqrt(1 / weights.sum())))
    return Gravity(float(np.rad2deg(middle)), error) if error < CERTAIN_DEG else None


def _direction(y: np.ndarray, interval: float, every: int, arm: int) -> tuple[float, float] | None:
    """Direction and standard error in rad that one arm's equation implies."""
    change, integral, cluster = spans(y, interval, every)
    if len(cluster) <= CLUSTER_POINTS:
        return None
    own, other = arm, 1 - arm
    sign = 1.0 if arm == 0 else -1.0
    coupling = integral(lambda s: np.sin(s[:, 0] - s[:, 1]) * s[:, 2] * s[:, 3])
    inertia = -change(lambda s: np.cos(s[:, 0] - s[:, 1]) * s[:, 2 + other]) - sign * coupling
    columns = [
        inertia,
        integral(lambda s: -np.sin(s[:, own])),
        integral(lambda s: np.cos(s[:, own])),
        -change(lambda s: s[:, own]),
        -change(lambda s: s[:, other]),
    ]
    design, target = np.stack(columns, axis=1), change(lambda s: s[:, 2 + own])
    normal = design.T @ design
    if np.linalg.matrix_rank(normal, hermitian=True) < len(columns):
        return None
    x = np.linalg.solve(normal, design.T @ target)
    _, group = np.unique(cluster, return_inverse=True)
    scores = np.stack([np.bincount(group, weights=c * (target - design @ x)) for c in columns], axis=1)
    inverse = np.linalg.inv(normal)
    covariance = inverse @ (scores.T @ scores) @ inverse
    down, aside = float(x[1]), float(x[2])
    strength = float(np.hypot(down, aside))
    across = np.array([0, -aside, down, 0, 0]) / strength
    along = np.array([0, down, aside, 0, 0]) / strength
    if x[0] <= 0 or strength < PULL * float(np.sqrt(along @ covariance @ along)):
        return None
    return float(np.arctan2(aside, down)), float(np.sqrt(across @ covariance @ across)) / strength

"""Linear fit of the rigid double pendulum's constants to its motion, without accelerations.

With Δ = θ1 − θ2 the equations of :mod:`expertaug.systems.double_pendulum` are changes of momenta,

    d/dt (θ1' + B1 cos Δ θ2') = −B1 sin Δ θ1' θ2' − G1 sin θ1
    d/dt (θ2' + B2 cos Δ θ1') = +B2 sin Δ θ1' θ2' − G2 sin θ2,

so that, integrated over a span, they are linear in the constants and need angles and speeds only.  On simulated noisy
motion (.07 and .25 px, 400 and 100 Hz) the constants come out within 1 %, where a fit to second derivatives is up to
7 % off, and they forecast as well as those of shooting, which takes hundreds of times longer.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from expertaug.errors import InputError
from expertaug.systems.double_pendulum import GRAVITY, Constants

WEIGHTS = np.array([41, 216, 27, 272, 27, 216, 41]) / 140  # closed Newton-Cotes rule over six intervals
OfStates = Callable[[Callable[[np.ndarray], np.ndarray]], np.ndarray]
CLUSTER_POINTS = 20  # points of a series whose errors are taken to depend on each other: a chunk


@dataclass(frozen=True)
class Fit:
    """Fitted constants.

    Attributes:
        constants: the rigid body's, in the time of the data.
        friction: viscous friction of the two joints in s⁻¹ (zeros where it was not fitted).
        std_errors: standard errors of B1, G1, B2, G2 and, where fitted, friction1, friction2; clustered, since
            neighbouring points share their errors.
        r2: explained share of the variance of the changes of θ1' and θ2' over a span.
    """

    constants: Constants
    friction: tuple[float, float]
    std_errors: dict[str, float]
    r2: tuple[float, float]


def fit_constants(y: np.ndarray, interval: float, friction: bool = False, every: int = 1) -> Fit:
    """Least squares of the two equations of motion over spans of six intervals, one from each point.

    Arguments:
        y: one or more evenly spaced series of states, (T, 4) or (N, T, 4); spans over a NaN are left out.
        interval: seconds between the points of a span; 10 ms is right for a pendulum of this size.
        friction: also fit the viscous friction of the joints.
        every: the points of a span are so many rows apart.

    Raises:
        InputError: the motion does not determine the constants, or they are those of no pendulum.
    """
    change, integral, cluster = spans(y, interval, every)
    coupling = integral(lambda s: np.sin(s[:, 0] - s[:, 1]) * s[:, 2] * s[:, 3])
    inertia1 = -change(lambda s: np.cos(s[:, 0] - s[:, 1]) * s[:, 3]) - coupling
    inertia2 = -change(lambda s: np.cos(s[:, 0] - s[:, 1]) * s[:, 2]) + coupling
    gravity1, gravity2 = (-integral(lambda s, k=k: np.sin(s[:, k])) for k in (0, 1))
    turned1, rubbed = change(lambda s: s[:, 0]), change(lambda s: s[:, 1] - s[:, 0])

    x2, error2, r2_2 = _least_squares([inertia2, gravity2] + [-rubbed] * friction, change(lambda s: s[:, 3]), cluster)
    # The second joint's friction acts on the first arm too, by the ratio of the inertias B1 / B2.
    inertia1 = inertia1 + (x2[2] / x2[0] * rubbed if friction else 0.0)
    x1, error1, r2_1 = _least_squares([inertia1, gravity1] + [-turned1] * friction, change(lambda s: s[:, 2]), cluster)
    constants = Constants(B1=float(x1[0]), G1=float(x1[1]), B2=float(x2[0]), G2=float(x2[1]))
    _check_pendulum(constants)
    names = ("B1", "G1", "B2", "G2", "friction1", "friction2")
    errors = dict(zip(names, (*error1[:2], *error2[:2], *error1[2:], *error2[2:]), strict=False))
    rubs = (float(x1[2]), float(x2[2])) if friction else (0.0, 0.0)
    return Fit(constants, rubs, {name: float(e) for name, e in errors.items()}, (r2_1, r2_2))


def spans(y: np.ndarray, interval: float, every: int = 1) -> tuple[OfStates, OfStates, np.ndarray]:
    """Spans of six intervals, one from each point: what changes over them, what integrates, and their clusters.

    Arguments:
        y, interval, every: as of :func:`fit_constants`.

    Returns:
        functions that give for a function of states (m, 4) its change and its integral over each span, (m,), and
        numbers (m,) that are the same for spans whose errors depend on each other.

    Raises:
        InputError: there is no span.
    """
    y = np.asarray(y, dtype=np.float64)
    y = y if y.ndim == 3 else y[None]
    nodes = len(WEIGHTS)
    starts = y.shape[1] - (nodes - 1) * every
    if starts < 1:
        raise _undetermined(0)
    points = [y[:, k * every : k * every + starts].reshape(-1, 4) for k in range(nodes)]
    cluster = np.arange(len(y))[:, None] * y.shape[1] + np.arange(starts) // (CLUSTER_POINTS * every)
    kept = np.isfinite(sum(p.sum(axis=1) for p in points))
    points, cluster = [p[kept] for p in points], cluster.ravel()[kept]

    def change(of: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        return of(points[-1]) - of(points[0])

    def integral(of: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        return interval * sum(w * of(p) for w, p in zip(WEIGHTS, points, strict=True))

    return change, integral, cluster


def implied_rate(constants: Constants, rate_hz: float, arm1_m: float) -> float:
    """Frame rate in Hz at which a rigid second arm satisfies G2 / B2 = g / l1.

    Arguments:
        constants: fitted in the time of ``rate_hz``.
        rate_hz: the frame rate by which the times were made.
        arm1_m: length of the first arm in m.
    """
    return rate_hz * math.sqrt(GRAVITY / arm1_m * constants.B2 / constants.G2)


def _least_squares(
    columns: list[np.ndarray], target: np.ndarray, cluster: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    """Coefficients, their clustered standard errors and R²."""
    design = np.stack(columns, axis=1)
    normal = design.T @ design
    spread = float(np.sum((target - target.mean()) ** 2)) if len(target) else 0.0
    if len(target) <= len(columns) or spread == 0 or np.linalg.matrix_rank(normal, hermitian=True) < len(columns):
        raise _undetermined(len(target))
    x = np.linalg.solve(normal, design.T @ target)
    residual = target - design @ x
    _, group = np.unique(cluster, return_inverse=True)
    scores = np.stack([np.bincount(group, weights=column * residual) for column in columns], axis=1)
    inverse = np.linalg.inv(normal)
    errors = np.sqrt(np.diag(inverse @ (scores.T @ scores) @ inverse))
    return x, errors, 1 - float(np.sum(residual**2)) / spread


def _undetermined(spans: int) -> InputError:
    return InputError("fit of the constants", f"{spans} spans do not determine them", "use a moving pendulum")


def _check_pendulum(c: Constants) -> None:
    """A pendulum hangs down (G > 0) and has a positive definite inertia (0 < B1 B2 < 1)."""
    if not (c.G1 > 0 and c.G2 > 0 and c.B1 > 0 and c.B2 > 0 and c.B1 * c.B2 < 1):
        found = ", ".join(f"{name} = {value:.3g}" for name, value in c.to_dict().items())
        remedy = "check that y grows downwards and the order of the markers"
        raise InputError("fit of the constants", f"{found} is no pendulum", remedy)

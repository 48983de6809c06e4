"""What a motion says of its pendulum: constants, friction, the direction of gravity and the frame rate.

The constants of a rigid double pendulum are fitted without accelerations.

With Δ = θ1 − θ2 the equations of :mod:`expertaug.systems.double_pendulum` are changes of momenta,

    d/dt (θ1' + B1 cos Δ θ2') = −B1 sin Δ θ1' θ2' − G1 sin θ1
    d/dt (θ2' + B2 cos Δ θ1') = +B2 sin Δ θ1' θ2' − G2 sin θ2,

so that, integrated over a span, they are linear in the constants and need angles and speeds only.  On simulated noisy
motion (.07 and .25 px, 400 and 100 Hz) the constants come out within 1 %, where a fit to second derivatives is up to
7 % off, and they forecast as well as those of shooting, which takes hundreds of times longer.

A single pendulum, θ'' = −ω0² sin θ − α θ', is fitted in the same way.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from expertaug.errors import InputError
from expertaug.systems.double_pendulum import GRAVITY, Constants
from expertaug_recordings.settings import RENDERED

WEIGHTS = np.array([41, 216, 27, 272, 27, 216, 41]) / 140  # closed Newton-Cotes rule over six intervals
OfStates = Callable[[Callable[[np.ndarray], np.ndarray]], np.ndarray]
CLUSTER_POINTS = 20  # points of a series whose errors are taken to depend on each other: a chunk
CERTAIN_DEG = 3.0  # standard error of a direction that is known
AGREE = 4.0  # standard errors of their difference, and CERTAIN_DEG, by which the two arms' directions may differ
PULL = 5.0  # standard errors by which gravity is more than none
CONTRADICTED = 2.0  # standard errors, below which the motion does not contradict the stated direction
SPAN_S = 0.01  # between the points by which the constants are fitted
MAX_RATE_ERROR = 0.05  # of the stated frame rate, beyond which the motion contradicts it
MAX_TILT_DEG = 1.5  # off the stated direction of gravity, beyond which the motion contradicts it
SINGLE_SPAN_S = 0.05  # between the points of a span, six of which change the speed by enough to be seen


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
        raise _refuse_undetermined(0)
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
        raise _refuse_undetermined(len(target))
    x = np.linalg.solve(normal, design.T @ target)
    residual = target - design @ x
    _, group = np.unique(cluster, return_inverse=True)
    scores = np.stack([np.bincount(group, weights=column * residual) for column in columns], axis=1)
    inverse = np.linalg.inv(normal)
    errors = np.sqrt(np.diag(inverse @ (scores.T @ scores) @ inverse))
    return x, errors, 1 - float(np.sum(residual**2)) / spread


def _refuse_undetermined(spans: int) -> InputError:
    return InputError("fit of the constants", f"{spans} spans do not determine them", "use a moving pendulum")


def _check_pendulum(c: Constants) -> None:
    """A pendulum hangs down (G > 0) and has a positive definite inertia (0 < B1 B2 < 1)."""
    if not (c.G1 > 0 and c.G2 > 0 and c.B1 > 0 and c.B2 > 0 and c.B1 * c.B2 < 1):
        listed = ", ".join(f"{name} = {value:.3g}" for name, value in c.to_dict().items())
        remedy = "check that y grows downwards and the order of the markers"
        raise InputError("fit of the constants", f"{listed} is no pendulum", remedy)


@dataclass(frozen=True)
class Gravity:
    """Direction of gravity.

    Attributes:
        degrees: from the direction of which the angles are measured, positive towards positive angles, in (-180, 180].
        error_deg: standard error.
    """

    degrees: float
    error_deg: float


def direction_error(gravity: Gravity | None, stated_deg: float | None, turned: bool) -> float:
    """Standard uncertainty in degrees of the stated direction of gravity, by what the motion says of it.

    Arguments:
        gravity: direction from the stated one; None where the motion does not tell.
        stated_deg: its own standard uncertainty; None where it is not known.
        turned: whether the stated direction is another than the image's own: it then was measured, most often by the
            motion too, and is no surer than what is found here.  Down in the image is only what the motion contradicts.
    """
    if stated_deg == 0 or gravity is None:
        return stated_deg or 0.0
    off, error = gravity.degrees, gravity.error_deg
    if stated_deg is None and turned:
        return math.hypot(off, error)
    if stated_deg is None:
        return math.sqrt(max(off**2 - error**2, 0.0)) if abs(off) > CONTRADICTED * error else 0.0
    share = stated_deg**2 / (stated_deg**2 + error**2)  # of what it is off by that is not the motion's own error
    return math.sqrt(share * error**2 + (share * off) ** 2)


def find_gravity(y: np.ndarray, interval: float, every: int = 1) -> Gravity | None:
    """Direction in which gravity pulls, by the changes of momentum.

    In the equations of the fit, a pull G in the direction φ is G sin(θ − φ): the two components G cos φ
    and G sin φ are linear, so that no direction needs to be tried.  Each arm has its own; only where both are
    certain and agree is the direction known.

    Arguments:
        y: states (T, 4), evenly spaced, whose angles are measured from any direction; NaN where they are not known.
        interval, every: as of :func:`expertaug_recordings.angles.pendulum_fit.fit_constants`.

    Returns:
        None where the motion does not tell it.
    """
    directions = [_direction(y, interval, every, arm) for arm in (0, 1)]
    if None in directions:
        return None
    angles, errors = (np.array([direction[k] for direction in directions]) for k in (0, 1))
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


@dataclass(frozen=True)
class Implied:
    """What the motion implies.

    Attributes:
        fit: the pendulum's constants and friction, and how well they explain the motion.
        rate_hz: frame rate; None where the first arm's length is not known.
        gravity: its direction from the stated one; None where the fits do not tell.
    """

    fit: Fit
    rate_hz: float | None
    gravity: Gravity | None

    @property
    def tilt_deg(self) -> float | None:
        """By how much gravity is off its stated direction."""
        return None if self.gravity is None else self.gravity.degrees


def explain(y: np.ndarray, rate_hz: float, arm1_m: float | None, rotation_deg: float = 0.0) -> Implied:
    """Fit the pendulum to its motion.

    Arguments:
        y: states (n, 4); NaN where they were not measured.
        rate_hz: stated frames per second.
        arm1_m: length of the first arm in m; None where it is not known.
        rotation_deg: stated direction of gravity in the image.

    Raises:
        InputError: the motion does not determine the constants, or they are those of no pendulum.
    """
    every = max(1, round(rate_hz * SPAN_S))
    gravity = find_gravity(y, every / rate_hz, every)
    try:
        fit = fit_constants(y, every / rate_hz, friction=True, every=every)
    except InputError as error:
        if gravity is None or abs(gravity.degrees) < MAX_TILT_DEG:
            raise
        remedy = (
            f"by the motion gravity points {gravity.degrees:+.1f}° off the stated direction: set"
            f" recordings.angles.rotation_deg to {_turn(rotation_deg, gravity.degrees):.1f}"
        )
        raise InputError(str(error).partition("; ")[0], "the direction of gravity is wrong", remedy) from error
    implied = None if arm1_m is None else implied_rate(fit.constants, rate_hz, arm1_m)
    return Implied(fit, implied, gravity)


def contradictions(
    implied: Implied, rate_hz: float, provenance: str, arm1_m: float | None, rotation_deg: float
) -> list[str]:
    """What the motion contradicts, in plain words.

    Arguments:
        implied: by the motion.
        rate_hz, provenance: stated frame rate and where it is known from.
        arm1_m, rotation_deg: stated length of the first arm in m and direction of gravity in the image.
    """
    conflicts, rate, tilt = [], implied.rate_hz, implied.tilt_deg
    # What this project rendered moves by the real recordings' constants in their nominal time.
    if rate is not None and provenance != RENDERED and abs(rate / rate_hz - 1) > MAX_RATE_ERROR:
        side = "above" if rate > rate_hz else "below"
        conflicts.append(
            f"the motion implies {rate:.1f} Hz, {abs(rate / rate_hz - 1):.0%} {side} the stated {rate_hz:g} Hz"
            f" ({provenance}): that rate or the first arm's length of {arm1_m:g} m is wrong"
        )
    if tilt is not None and abs(tilt) > MAX_TILT_DEG:
        conflicts.append(
            f"by the motion gravity points {tilt:+.1f}° off the stated direction: set recordings.angles.rotation_deg to"
            f" {_turn(rotation_deg, tilt):.1f}"
        )
    return conflicts


def _turn(rotation_deg: float, by_deg: float) -> float:
    """A direction in degrees, in (-180, 180]."""
    return 180 - (180 - rotation_deg - by_deg) % 360


def single_energy(theta: np.ndarray, omega: np.ndarray, omega0_squared: float) -> np.ndarray:
    """Energy over the moment of inertia in s⁻², 0 at rest."""
    return omega**2 / 2 + omega0_squared * (1 - np.cos(theta))


def explain_single(y: np.ndarray, rate_hz: float) -> Implied:
    """Fit the pendulum to its motion (n, 2) of angle and speed; NaN where they were not measured.

    Raises:
        InputError: as :func:`fit_single`.
    """
    fit, gravity = fit_single(y, rate_hz)
    return Implied(fit, None, gravity)


def fit_single(y: np.ndarray, rate_hz: float) -> tuple[Fit, Gravity]:
    """Least squares of the changes of speed over spans of six intervals, one from each point.

    Arguments:
        y: one or more series of angle and speed, (T, 2) or (N, T, 2); spans over a NaN are left out.
        rate_hz: points per second.

    Returns:
        the constants (ω0² as G1, the others 0, friction α), and gravity's direction.

    Raises:
        InputError: the motion does not determine them, or it is no pendulum's.
    """
    y = y if y.ndim == 3 else y[None]
    every = max(1, round(rate_hz * SINGLE_SPAN_S))
    starts = y.shape[1] - (len(WEIGHTS) - 1) * every
    points = [y[:, k * every : k * every + max(0, starts)].reshape(-1, 2) for k in range(len(WEIGHTS))]
    finite = np.isfinite(sum(p.sum(axis=1) for p in points))
    points = [p[finite] for p in points]
    interval = every / rate_hz
    sine, cosine = (
        interval * sum(w * of(p[:, 0]) for w, p in zip(WEIGHTS, points, strict=True)) for of in (np.sin, np.cos)
    )
    change, turned = points[-1][:, 1] - points[0][:, 1], points[-1][:, 0] - points[0][:, 0]
    design = np.stack((-sine, cosine, -turned), axis=1)
    if len(change) <= 3 or np.linalg.matrix_rank(design) < 3:
        raise InputError("fit of the constants", f"{len(change)} spans do not determine them", "use a moving pendulum")
    x, *_ = np.linalg.lstsq(design, change, rcond=None)
    tilt = float(np.rad2deg(np.arctan2(x[1], x[0])))
    omega0_squared = float(np.hypot(x[0], x[1]))
    rest = change - design @ x
    share = 1 - float(rest @ rest) / max(float(((change - change.mean()) ** 2).sum()), 1e-300)
    if not share > 0.5:
        raise InputError("fit of the constants", f"it explains {share:.0%} of the motion", "check the markers")
    error = np.sqrt(np.diag(np.linalg.inv(design.T @ design)) * (rest @ rest) / max(1, len(rest) - 3))
    errors = {"G1": float(error[0]), "friction1": float(error[2])}
    gravity = Gravity(tilt, float(np.rad2deg(error[1] / omega0_squared)))
    return Fit(Constants(0.0, omega0_squared, 0.0, 0.0), (float(x[2]), 0.0), errors, (share, share)), gravity

"""A single pendulum: θ'' = −ω0² sin θ − α θ', by its motion without accelerations."""

from __future__ import annotations

import numpy as np

from expertaug.errors import InputError
from expertaug.systems.double_pendulum import Constants
from expertaug_recordings.angles.implied import Implied
from expertaug_recordings.angles.pendulum_fit import WEIGHTS, Fit
from expertaug_recordings.angles.tilt import Gravity

SPAN_S = 0.05  # between the points of a span, six of which change the speed by enough to be seen


def single_energy(theta: np.ndarray, omega: np.ndarray, omega0_squared: float) -> np.ndarray:
    """Energy over the moment of inertia in s⁻², 0 at rest."""
    return omega**2 / 2 + omega0_squared * (1 - np.cos(theta))


def explain_single(y: np.ndarray, rate_hz: float) -> Implied:
    """Fit the pendulum to its motion (n, 2) of angle and speed; NaN where they were not measured.

    Raises:
        InputError: as :func:`fit_single`.
    """
    fit, gravity = fit_single(y, rate_hz)
    return Implied(fit, None, gravity.degrees)


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
    every = max(1, round(rate_hz * SPAN_S))
    starts = y.shape[1] - (len(WEIGHTS) - 1) * every
    points = [y[:, k * every : k * every + max(0, starts)].reshape(-1, 2) for k in range(len(WEIGHTS))]
    known = np.isfinite(sum(p.sum(axis=1) for p in points))
    points = [p[known] for p in points]
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

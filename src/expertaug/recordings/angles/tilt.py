"""The direction of gravity that the motion of a double pendulum implies."""

from __future__ import annotations

import numpy as np

from expertaug.errors import InputError
from expertaug.recordings.angles.pendulum_fit import fit_constants

STEPS_DEG = (12.0, 3.0, 1.0)  # between the three directions that are tried in each pass


def implied_tilt(y: np.ndarray, interval: float, every: int) -> float | None:
    """By how many degrees gravity is off the direction from which the angles are measured.

    The pendulum's equations (:mod:`.pendulum_fit`) explain the motion best where they pull in the right
    direction, and what they leave unexplained grows with the square of the error.

    Arguments:
        y: states (T, 4), evenly spaced; NaN where they are not known.
        interval, every: as of :func:`expertaug.recordings.angles.pendulum_fit.fit_constants`.

    Returns:
        degrees, positive where gravity points towards positive angles; None where the fits do not tell.
    """
    tilt = 0.0
    for step in STEPS_DEG:
        try:
            below, middle, above = (_unexplained(y, tilt + k * step, interval, every) for k in (-1, 0, 1))
        except InputError:
            return None
        curvature = below - 2 * middle + above
        if curvature <= 0:
            return None
        tilt += step * float(np.clip((below - above) / (2 * curvature), -3, 3))
    return tilt


def _unexplained(y: np.ndarray, tilt_deg: float, interval: float, every: int) -> float:
    turned = y.copy()
    turned[:, :2] -= np.deg2rad(tilt_deg)
    return 2 - sum(fit_constants(turned, interval, friction=True, every=every).r2)

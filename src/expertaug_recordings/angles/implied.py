"""What a recording's motion says of itself: the pendulum's constants, the frame rate and the direction of gravity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from expertaug.errors import InputError
from expertaug_recordings.angles.pendulum_fit import Fit, fit_constants, implied_rate
from expertaug_recordings.angles.tilt import find_gravity
from expertaug_recordings.settings import RENDERED

SPAN_S = 0.01  # between the points by which the constants are fitted
MAX_RATE_ERROR = 0.05  # of the stated frame rate, beyond which the motion contradicts it
MAX_TILT_DEG = 1.5  # off the stated direction of gravity, beyond which the motion contradicts it


@dataclass(frozen=True)
class Implied:
    """What the motion implies.

    Attributes:
        fit: the pendulum's constants and friction, and how well they explain the motion.
        rate_hz: frame rate; None where the first arm's length is not known.
        tilt_deg: by how much gravity is off its stated direction; None where the fits do not tell.
    """

    fit: Fit
    rate_hz: float | None
    tilt_deg: float | None


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
            f" recordings.angles.rotation_deg to {_turned(rotation_deg, gravity.degrees):.1f}"
        )
        raise InputError(str(error).partition("; ")[0], "the direction of gravity is wrong", remedy) from error
    implied = None if arm1_m is None else implied_rate(fit.constants, rate_hz, arm1_m)
    return Implied(fit, implied, None if gravity is None else gravity.degrees)


def contradictions(
    implied: Implied, rate_hz: float, provenance: str, arm1_m: float | None, rotation_deg: float
) -> list[str]:
    """What the motion contradicts, in plain words.

    Arguments:
        implied: by the motion.
        rate_hz, provenance: stated frame rate and where it is known from.
        arm1_m, rotation_deg: stated length of the first arm in m and direction of gravity in the image.
    """
    found, rate, tilt = [], implied.rate_hz, implied.tilt_deg
    # What this project rendered moves by the real recordings' constants in their nominal time.
    if rate is not None and provenance != RENDERED and abs(rate / rate_hz - 1) > MAX_RATE_ERROR:
        side = "above" if rate > rate_hz else "below"
        found.append(
            f"the motion implies {rate:.1f} Hz, {abs(rate / rate_hz - 1):.0%} {side} the stated {rate_hz:g} Hz"
            f" ({provenance}): that rate or the first arm's length of {arm1_m:g} m is wrong"
        )
    if tilt is not None and abs(tilt) > MAX_TILT_DEG:
        found.append(
            f"by the motion gravity points {tilt:+.1f}° off the stated direction: set recordings.angles.rotation_deg to"
            f" {_turned(rotation_deg, tilt):.1f}"
        )
    return found


def _turned(rotation_deg: float, by_deg: float) -> float:
    """A direction in degrees, in (-180, 180]."""
    return 180 - (180 - rotation_deg - by_deg) % 360

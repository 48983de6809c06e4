"""The planar double pendulum: state (θ1, θ2, θ1', θ2'), angles in rad from the downward vertical, speeds in rad/s.

Both experts of the paper's real-world experiment and of this project are the one rigid-body equation

    θ1'' + B1 (cos Δ θ2'' + sin Δ θ2'²) + G1 sin θ1 = 0
    θ2'' + B2 (cos Δ θ1'' − sin Δ θ1'²) + G2 sin θ2 = 0,   Δ = θ1 − θ2,

with different constants: two equal point masses on massless arms (paper, section 4.2) imply them from the arm lengths,
``compound`` takes them as fitted to the motion.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, TypeVar

import numpy as np
import torch
from torch import Tensor

from expertaug.errors import InputError
from expertaug.systems.base import Parameter, System

Array = TypeVar("Array", np.ndarray, Tensor)

GRAVITY = 9.81  # m/s²


@dataclass(frozen=True)
class Constants:
    """The four constants of the rigid double pendulum: B1 and B2 without unit, G1 and G2 in s⁻²."""

    B1: float
    G1: float
    B2: float
    G2: float

    def to_dict(self) -> dict[str, float]:
        return asdict(self)


def point_masses(l1: float, l2: float, mass_ratio: float = 1.0, gravity: float = GRAVITY) -> Constants:
    """Constants of two point masses on massless arms.

    Arguments:
        l1, l2: arm lengths in m.
        mass_ratio: m2 / m1; the paper takes equal masses.
        gravity: in m/s².
    """
    share = mass_ratio / (1 + mass_ratio)
    return Constants(B1=share * l2 / l1, G1=gravity / l1, B2=l1 / l2, G2=gravity / l2)


def accelerations(y: Tensor, constants: Constants, friction: tuple[float, float] = (0.0, 0.0)) -> Tensor:
    """θ1'' and θ2'' of the rigid double pendulum.

    Arguments:
        y: states (..., 4).
        constants: of the rigid body.
        friction: viscous torque per inertia of the two joints in s⁻¹; the second acts on θ2' − θ1'.

    Returns:
        (..., 2) in rad/s².
    """
    c = constants
    theta1, theta2, omega1, omega2 = y.unbind(-1)
    delta = theta1 - theta2
    sin, cos = torch.sin(delta), torch.cos(delta)
    rub = friction[1] * (omega2 - omega1)
    # The second equation is divided by its own inertia, B2 / B1 of the first's, hence the factor on the reaction.
    right1 = -c.B1 * sin * omega2.square() - c.G1 * torch.sin(theta1) - friction[0] * omega1 + c.B1 / c.B2 * rub
    right2 = c.B2 * sin * omega1.square() - c.G2 * torch.sin(theta2) - rub
    determinant = 1 - c.B1 * c.B2 * cos.square()
    first = (right1 - c.B1 * cos * right2) / determinant
    second = (right2 - c.B2 * cos * right1) / determinant
    return torch.stack((first, second), dim=-1)


def energy(y: Array, constants: Constants) -> Array:
    """Mechanical energy per inertia of the first arm, zero at rest.

    Arguments:
        y: states (..., 4), an array or a tensor.

    Returns:
        (...,) in s⁻², double precision; conserved by :func:`accelerations` without friction.
    """
    c, cos = constants, torch.cos if isinstance(y, Tensor) else np.cos
    exact: Any = y.double() if isinstance(y, Tensor) else np.asarray(y, dtype=np.float64)
    theta1, theta2, omega1, omega2 = (exact[..., k] for k in range(4))
    ratio = c.B1 / c.B2
    kinetic: Any = omega1**2 / 2 + ratio * omega2**2 / 2 + c.B1 * cos(theta1 - theta2) * omega1 * omega2
    return kinetic + c.G1 * (1 - cos(theta1)) + ratio * c.G2 * (1 - cos(theta2))


class DoublePendulum(System):
    """Known initial angles, unknown initial speeds z_e = (θ1'(0), θ2'(0)) (paper, section 4.2).

    Arguments:
        expert: ``point_mass`` (the paper's: equal masses, arm lengths l1 and l2) or ``compound``.
        constants: of the compound expert; a calibration supplies them.
        l1, l2: arm lengths in m, for the point masses.
        friction: viscous friction of the two joints in s⁻¹ that the expert knows; None for an expert without friction.
            A configuration's ``calibrated`` stands for what the calibration fits.
    """

    state = (
        Parameter("theta1", "rad"),
        Parameter("theta2", "rad"),
        Parameter("omega1", "rad/s"),
        Parameter("omega2", "rad/s"),
    )
    expert_parameters = (
        Parameter("omega1", "rad/s", positive=False, scale=10.0),
        Parameter("omega2", "rad/s", positive=False, scale=20.0),
    )

    def __init__(
        self,
        expert: str = "compound",
        constants: Mapping[str, float] | None = None,
        l1: float = 0.091,
        l2: float = 0.070,
        friction: Sequence[float] | None = None,
    ) -> None:
        if friction is not None and (isinstance(friction, str) or len(friction) != 2):
            raise InputError("system.friction", f"found {friction!r}", "two numbers in s⁻¹, or data.calibrate's")
        self.friction = (0.0, 0.0) if friction is None else (float(friction[0]), float(friction[1]))
        if expert == "point_mass":
            self.constants = point_masses(l1, l2)
        elif expert == "compound":
            if constants is None:
                raise InputError(
                    "system.constants", "missing", "the compound expert needs B1, G1, B2, G2: set data.calibrate"
                )
            self.constants = Constants(**{name: float(constants[name]) for name in ("B1", "G1", "B2", "G2")})
        else:
            raise InputError("system.expert", repr(expert), "point_mass or compound")

    def expert(self, t: Tensor, y: Tensor, z_e: Tensor) -> Tensor:
        return torch.cat((y[..., 2:], accelerations(y, self.constants, self.friction)), dim=-1)

    def energy(self, y: Tensor, z_e: Tensor) -> Tensor:
        """As :func:`energy`; initial speeds change nothing in it."""
        return energy(y, self.constants)

    def kinematics(self, y: Tensor) -> Tensor:
        """θ' = ω holds whatever the forces."""
        return torch.cat((y[..., 2:], torch.zeros_like(y[..., 2:])), dim=-1)

    def initial_state(self, y0: Tensor, z_e: Tensor) -> Tensor:
        return torch.cat((y0[..., :2], z_e), dim=-1)

    def resample_known(self, y0: Tensor, uniform: Callable[[int], Tensor]) -> Tensor:
        """Both angles uniform over the circle."""
        return torch.cat((2 * math.pi * (uniform(2) - 0.5), y0[..., 2:]), dim=-1)

    def observe(self, y: Tensor) -> Tensor:
        """Sines and cosines of both angles, so that whole turns do not count."""
        return torch.cat((torch.sin(y[..., :2]), torch.cos(y[..., :2])), dim=-1)

    @property
    def error_dims(self) -> int:
        """Two angles: sine and cosine of one angle are one dimension."""
        return 2

    def features(self, y: Tensor) -> Tensor:
        return torch.cat((self.observe(y), y[..., 2:] / 20.0), dim=-1)

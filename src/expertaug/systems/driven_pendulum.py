"""The driven, damped pendulum: θ'' = ω0² (u(t) − sin θ) − γ θ', with a torque u (Takeishi and Kalousis 2021)."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from expertaug.errors import InputError
from expertaug.systems.base import Parameter, System

TORQUES, OBSERVED = ("known", "hidden"), ("all", "angle")


class DrivenPendulum(System):
    """State (θ, θ'), z_e = ω0, z_a = γ; the expert knows gravity and the torque, the interaction is the damping.

    The torque u is in units of m g l.  A simulated one is A cos(2π f t) at the times of the data, and a straight line
    between them, as a measured one would be.

    Arguments:
        torque: known, or hidden: it is the interaction's then, z_a = (γ, A, f), and A cos(2π f t) at every time.
        observed: all, or angle: errors are then those of θ alone.
    """

    state = (Parameter("theta", "rad"), Parameter("omega", "rad/s"))
    expert_parameters = (Parameter("omega0", "rad/s"),)
    interaction_parameters = (Parameter("gamma", "1/s"),)
    inputs = (Parameter("torque", positive=False, scale=20.0),)
    input_parameters = (Parameter("A"), Parameter("f", "Hz"))
    hidden, observed = False, "all"  # also of a subclass that has a constructor of its own

    def __init__(self, torque: str = "known", observed: str = "all") -> None:
        for name, value, choices in (("torque", torque, TORQUES), ("observed", observed, OBSERVED)):
            if value not in choices:
                raise InputError(f"system.{name}", repr(value), f"one of {', '.join(choices)}")
        self.hidden, self.observed = torque == "hidden", observed
        if self.hidden:
            self.interaction_parameters = (*type(self).interaction_parameters, *type(self).input_parameters)
            self.inputs = self.input_parameters = ()

    def expert(self, t: Tensor, y: Tensor, z_e: Tensor, *u: Tensor) -> Tensor:
        theta, speed = y[..., :1], y[..., 1:]
        torque = 0.0 if self.hidden else u[0]
        return torch.cat((speed, z_e.square() * (torque - torch.sin(theta))), dim=-1)

    def truth(self, t: Tensor, y: Tensor, z_e: Tensor, z_a: Tensor, *u: Tensor) -> Tensor:
        missing = -z_a[..., :1] * y[..., 1:]
        if self.hidden:
            missing = missing + z_e.square() * z_a[..., 1:2] * torch.cos(2 * math.pi * z_a[..., 2:] * t)
        return self.expert(t, y, z_e, *u) + torch.cat((torch.zeros_like(missing), missing), dim=-1)

    def observe(self, y: Tensor) -> Tensor:
        return y[..., :1] if self.observed == "angle" else y

    def input_signal(self, t: Tensor, parameters: Tensor) -> Tensor:
        if self.hidden:
            return super().input_signal(t, parameters)
        amplitude, frequency = parameters.unsqueeze(1).unbind(-1)
        return (amplitude * torch.cos(2 * math.pi * frequency * t)).unsqueeze(-1)

    def sample_initial_state(self, n: int, generator: torch.Generator) -> Tensor:
        """θ0 uniform in [−π/2, π/2], at rest."""
        theta = (torch.rand(n, generator=generator, dtype=torch.float64) - 0.5) * math.pi
        return torch.stack((theta, torch.zeros_like(theta)), dim=-1)

    def kinematics(self, y: Tensor) -> Tensor:
        return torch.cat((y[..., 1:], torch.zeros_like(y[..., 1:])), dim=-1)

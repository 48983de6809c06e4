"""The driven, damped pendulum: θ'' = ω0² (u(t) − sin θ) − γ θ', with a known torque u (Takeishi and Kalousis 2021)."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from expertaug.systems.base import Parameter, System


class DrivenPendulum(System):
    """State (θ, θ'), z_e = ω0, z_a = γ; the expert knows gravity and the torque, the interaction is the damping.

    The torque u is in units of m g l.  A simulated one is A cos(2π f t) at the times of the data, and a straight line
    between them, as a measured one would be.
    """

    state = (Parameter("theta", "rad"), Parameter("omega", "rad/s"))
    expert_parameters = (Parameter("omega0", "rad/s"),)
    interaction_parameters = (Parameter("gamma", "1/s"),)
    inputs = (Parameter("torque", positive=False, scale=20.0),)
    input_parameters = (Parameter("A"), Parameter("f", "Hz"))

    def expert(self, t: Tensor, y: Tensor, z_e: Tensor, u: Tensor) -> Tensor:
        theta, speed = y[..., :1], y[..., 1:]
        return torch.cat((speed, z_e.square() * (u - torch.sin(theta))), dim=-1)

    def truth(self, t: Tensor, y: Tensor, z_e: Tensor, z_a: Tensor, u: Tensor) -> Tensor:
        damping = torch.cat((torch.zeros_like(z_a), -z_a * y[..., 1:]), dim=-1)
        return self.expert(t, y, z_e, u) + damping

    def input_signal(self, t: Tensor, parameters: Tensor) -> Tensor:
        amplitude, frequency = parameters.unsqueeze(1).unbind(-1)
        return (amplitude * torch.cos(2 * math.pi * frequency * t)).unsqueeze(-1)

    def sample_initial_state(self, n: int, generator: torch.Generator) -> Tensor:
        """θ0 uniform in [−π/2, π/2], at rest."""
        theta = (torch.rand(n, generator=generator, dtype=torch.float64) - 0.5) * math.pi
        return torch.stack((theta, torch.zeros_like(theta)), dim=-1)

    def kinematics(self, y: Tensor) -> Tensor:
        return torch.cat((y[..., 1:], torch.zeros_like(y[..., 1:])), dim=-1)

"""The damped pendulum (paper, section 4.1): θ'' = −ω0² sin θ − α θ'."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from expertaug.errors import InputError
from expertaug.systems.base import Parameter, System

FRICTIONS = (None, "estimated")


class DampedPendulum(System):
    """State (θ, θ'), z_e = ω0, z_a = α; the expert knows gravity, the interaction is the damping.

    Arguments:
        friction: estimated: the expert knows the damping as well, z_e = (ω0, α), and leaves nothing to an interaction.
    """

    state = (Parameter("theta", "rad"), Parameter("omega", "rad/s"))
    expert_parameters = (Parameter("omega0", "rad/s"),)
    interaction_parameters = (Parameter("alpha", "1/s"),)
    rubs = False

    def __init__(self, friction: str | None = None) -> None:
        if friction not in FRICTIONS:
            raise InputError("system.friction", repr(friction), "estimated, or null")
        self.rubs = friction is not None
        if self.rubs:
            self.expert_parameters = (*type(self).expert_parameters, *type(self).interaction_parameters)
            self.interaction_parameters = ()

    def expert(self, t: Tensor, y: Tensor, z_e: Tensor) -> Tensor:
        theta, speed = y[..., :1], y[..., 1:]
        rate = -z_e[..., :1].square() * torch.sin(theta)
        return torch.cat((speed, rate - z_e[..., 1:] * speed if self.rubs else rate), dim=-1)

    def energy(self, y: Tensor, z_e: Tensor) -> Tensor:
        """θ'² / 2 + ω0² (1 − cos θ), in s⁻²: per moment of inertia."""
        return y[..., 1].square() / 2 + z_e[..., 0].square() * (1 - torch.cos(y[..., 0]))

    def truth(self, t: Tensor, y: Tensor, z_e: Tensor, z_a: Tensor) -> Tensor:
        if self.rubs:
            return self.expert(t, y, z_e)
        damping = torch.cat((torch.zeros_like(z_a), -z_a * y[..., 1:]), dim=-1)
        return self.expert(t, y, z_e) + damping

    def sample_initial_state(self, n: int, generator: torch.Generator) -> Tensor:
        """θ0 uniform in [−π/2, π/2], at rest (paper, appendix)."""
        theta = (torch.rand(n, generator=generator, dtype=torch.float64) - 0.5) * math.pi
        return torch.stack((theta, torch.zeros_like(theta)), dim=-1)

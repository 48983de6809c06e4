"""The damped pendulum (paper, section 4.1): θ'' = −ω0² sin θ − α θ'."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from expertaug.errors import InputError
from expertaug.systems.base import Parameter, System
from expertaug.wording import show

FRICTIONS, OBSERVED = (None, "estimated"), ("all", "angle")


class DampedPendulum(System):
    """State (θ, θ'), z_e = ω0, z_a = α; the expert knows gravity, the interaction is the damping.

    Arguments:
        friction: estimated: the expert knows the damping as well, z_e = (ω0, α), and leaves nothing to an interaction.
        start_radius: simulations start anywhere in (θ, θ′) at a distance from rest in this range (Yin et al. 2021,
            their code); None: at rest, as in the paper's appendix.
        observed: all, or angle: errors are then those of θ alone.
    """

    state = (Parameter("theta", "rad"), Parameter("omega", "rad/s"))
    expert_parameters = (Parameter("omega0", "rad/s"),)
    interaction_parameters = (Parameter("alpha", "1/s"),)
    rubs, observed = False, "all"  # also of a subclass that has a constructor of its own

    def __init__(
        self, friction: str | None = None, start_radius: Sequence[float] | None = None, observed: str = "all"
    ) -> None:
        self.start_radius = start_radius
        if start_radius is not None and not (len(start_radius) == 2 and 0 <= start_radius[0] <= start_radius[1] < 7):
            shown = show(list(start_radius))
            raise InputError("system.start_radius", shown, "give [low, high] with 0 ≤ low ≤ high < 7")
        if friction not in FRICTIONS:
            raise InputError("system.friction", repr(friction), "estimated, or null")
        if observed not in OBSERVED:
            raise InputError("system.observed", repr(observed), f"one of {', '.join(OBSERVED)}")
        self.rubs, self.observed = friction is not None, observed
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

    def observe(self, y: Tensor) -> Tensor:
        return y[..., :1] if self.observed == "angle" else y

    def sample_initial_state(self, n: int, generator: torch.Generator) -> Tensor:
        """θ0 uniform in [−π/2, π/2], at rest (paper, appendix), or as ``start_radius`` says: the direction is that of a
        point in a square, the distance uniform."""
        if self.start_radius is not None:
            low, high = self.start_radius
            square = 2 * torch.rand(n, 2, generator=generator, dtype=torch.float64) - 1
            distance = low + (high - low) * torch.rand(n, 1, generator=generator, dtype=torch.float64)
            return square / square.norm(dim=1, keepdim=True) * distance
        theta = (torch.rand(n, generator=generator, dtype=torch.float64) - 0.5) * math.pi
        return torch.stack((theta, torch.zeros_like(theta)), dim=-1)

"""A ball that bounces on the ground: h'' = −g − k h' in flight, h' → −e h' at h = 0."""

from __future__ import annotations

import torch
from torch import Tensor

from expertaug.errors import InputError
from expertaug.systems.base import Parameter, System
from expertaug.systems.solvers.solver import Solver

OBSERVED = ("all", "height")


class BouncingBall(System):
    """State (h, v), z_e = (g, e), z_a = k; the expert knows gravity and the bounce, the interaction is the air's drag.

    Arguments:
        rest_m_s: a ball that leaves the ground more slowly than this stays there.
        observed: all, or height alone, as of a camera: errors are then those of heights.  Speeds jump, so that only a
            loss of heights can train anything (:func:`expertaug.systems.inputs.check_trainable`).
    """

    state = (Parameter("h", "m"), Parameter("v", "m/s"))
    expert_parameters = (Parameter("g", "m/s²", scale=10.0), Parameter("e", scale=0.8))
    interaction_parameters = (Parameter("k", "1/s"),)
    simulation = Solver("rk4", substeps=20)

    def __init__(self, rest_m_s: float = 0.05, observed: str = "all") -> None:
        if observed not in OBSERVED:
            raise InputError("system.observed", repr(observed), f"one of {', '.join(OBSERVED)}")
        if not rest_m_s >= 0:
            raise InputError("system.rest_m_s", f"found {rest_m_s!r}", "a speed in m/s, at least 0")
        self.rest_m_s, self.observed = float(rest_m_s), observed

    def expert(self, t: Tensor, y: Tensor, z_e: Tensor, side: Tensor) -> Tensor:
        speed = y[..., 1]
        return torch.stack((speed, -z_e[..., 0].expand_as(speed)), dim=-1) * (side != 0).unsqueeze(-1)

    def truth(self, t: Tensor, y: Tensor, z_e: Tensor, z_a: Tensor, side: Tensor) -> Tensor:
        drag = z_a[..., 0] * y[..., 1] * (side != 0)
        return self.expert(t, y, z_e, side) - torch.stack((torch.zeros_like(drag), drag), dim=-1)

    def event(self, y: Tensor, z_e: Tensor) -> Tensor:
        """The height in m."""
        return y[..., 0]

    def jump(self, y: Tensor, z_e: Tensor) -> Tensor:
        speed = z_e[..., 1] * y[..., 1].abs()
        speed = torch.where(speed > self.rest_m_s, speed, 0.0)
        return torch.stack((torch.zeros_like(speed), speed), dim=-1)

    def observe(self, y: Tensor) -> Tensor:
        return y[..., :1] if self.observed == "height" else y

    def initial_state(self, y0: Tensor, z_e: Tensor) -> Tensor:
        """A height that was measured below the ground is that of the ground, and the ball then leaves it."""
        height, speed = y0.unbind(-1)
        return torch.stack((height.clamp_min(0.0), torch.where(height > 0, speed, speed.abs())), dim=-1)

    def sample_initial_state(self, n: int, generator: torch.Generator) -> Tensor:
        """h0 uniform in [.5 m, 1.5 m], v0 in [−1 m/s, 1 m/s]."""
        unit = torch.rand(n, 2, generator=generator, dtype=torch.float64)
        return torch.stack((0.5 + unit[:, 0], 2 * unit[:, 1] - 1), dim=-1)

    def kinematics(self, y: Tensor) -> Tensor:
        return torch.cat((y[..., 1:], torch.zeros_like(y[..., 1:])), dim=-1)

"""Lorenz's system of convection: x' = σ (y − x), y' = x (ρ − z) − y, z' = x y − β z (Lorenz 1963)."""

from __future__ import annotations

import torch
from torch import Tensor

from expertaug.systems.base import Parameter, System

START_STD = 0.5  # of the first point


class Lorenz(System):
    """State (x, y, z), z_e = (σ, β), z_a = ρ; the expert lacks how convection drives the temperature, x (ρ − z).

    Which part is known, and where simulations begin, are as in Singh et al. (2026, arXiv:2602.17477).
    """

    state = (Parameter("x"), Parameter("y"), Parameter("z"))
    expert_parameters = (Parameter("sigma", scale=10.0), Parameter("beta", scale=3.0))
    interaction_parameters = (Parameter("rho"),)

    def expert(self, t: Tensor, y: Tensor, z_e: Tensor) -> Tensor:
        flow, difference, profile = y.unbind(-1)
        sigma, beta = z_e.unbind(-1)
        return torch.stack((sigma * (difference - flow), -difference, flow * difference - beta * profile), dim=-1)

    def truth(self, t: Tensor, y: Tensor, z_e: Tensor, z_a: Tensor) -> Tensor:
        flow, _, profile = y.unbind(-1)
        drive = flow * (z_a[..., 0] - profile)
        return self.expert(t, y, z_e) + torch.stack((torch.zeros_like(drive), drive, torch.zeros_like(drive)), dim=-1)

    def sample_initial_state(self, n: int, generator: torch.Generator) -> Tensor:
        """N(0, 0.5²) each."""
        return START_STD * torch.randn(n, 3, generator=generator, dtype=torch.float64)

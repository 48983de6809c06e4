"""Advection and diffusion along a line, ∂u/∂t = D ∂²u/∂x² − c ∂u/∂x (Takeishi and Kalousis 2021, phys-vae)."""

from __future__ import annotations

import math

import torch
from torch import Tensor
from torch.nn.functional import pad

from expertaug.systems.base import Parameter, System
from expertaug.systems.solvers.linear_propagator import DiagonalPropagator

CELLS, WIDTH = 20, 0.1  # points, and their distance in m
HEIGHTS = (0.5, 1.5)  # of the arch in which simulations begin


class AdvectionDiffusion(System):
    """State u, one field (1, 20); z_e = D, z_a = c, the speed; the expert is the diffusion alone.

    Differences are central, and u is zero at the points next beyond both ends (Dirichlet), as in the authors' code.
    """

    state = (Parameter("u"),)
    expert_parameters = (Parameter("D", "m²/s", scale=0.05),)
    interaction_parameters = (Parameter("c", "m/s"),)
    periodic = False

    @property
    def state_shape(self) -> tuple[int, ...]:
        return (1, CELLS)

    def expert(self, t: Tensor, y: Tensor, z_e: Tensor) -> Tensor:
        return z_e[..., None] * pad(y, (1, 1)).diff(n=2) / WIDTH**2

    def truth(self, t: Tensor, y: Tensor, z_e: Tensor, z_a: Tensor) -> Tensor:
        wide = pad(y, (1, 1))
        slope = (wide[..., 2:] - wide[..., :-2]) / (2 * WIDTH)
        return self.expert(t, y, z_e) - z_a[..., None] * slope

    def linear_flow(self, z_e: Tensor, h: float) -> DiagonalPropagator:
        """Diffusion for h s, exact for these differences: their eigenvectors are sines."""
        phase = math.pi * torch.arange(1, CELLS + 1, dtype=torch.float64) / (CELLS + 1)
        sines = (2 / (CELLS + 1)) ** 0.5 * torch.sin(phase[:, None] * torch.arange(1, CELLS + 1))  # its own inverse
        basis, eigenvalues = sines.to(z_e), ((2 * torch.cos(phase) - 2) / WIDTH**2).to(z_e)
        decay = torch.exp(h * z_e[..., None] * eigenvalues)

        def change(y: Tensor) -> Tensor:
            return y @ basis

        return DiagonalPropagator(change, change, decay)

    def nonlinear(self, t: Tensor, y: Tensor, z_e: Tensor) -> Tensor:
        return torch.zeros_like(y)

    def features(self, y: Tensor) -> Tensor:
        """The points side by side: few enough for fully connected networks, as the authors' are."""
        return y.flatten(-2)

    def sample_initial_state(self, n: int, generator: torch.Generator) -> Tensor:
        """Half a sine from the first point to the last, its height uniform in [0.5, 1.5]."""
        low, high = HEIGHTS
        height = low + (high - low) * torch.rand(n, 1, 1, generator=generator, dtype=torch.float64)
        return height * torch.sin(torch.linspace(0, math.pi, CELLS, dtype=torch.float64))

"""The 2D FitzHugh–Nagumo reaction–diffusion (paper, section 4.1; Yin et al. 2021): 32 × 32 cells, periodic.

    du/dt = a Δu + u − u³ − k − v
    dv/dt = b Δv + u − v

The domain is [−1, 1]², so cells are 1/16 wide, and Δ is the five-point Laplacian on them.
"""

from __future__ import annotations

import math
from functools import partial

import torch
from torch import Tensor

from expertaug.errors import InputError
from expertaug.systems.base import Parameter, System
from expertaug.systems.solvers.linear_propagator import DiagonalPropagator
from expertaug.systems.solvers.solver import Solver

SIZE = 32
WIDTH = 2.0 / SIZE  # of a cell


def laplacian(y: Tensor) -> Tensor:
    """Five-point Laplacian of periodic fields (…, 32, 32), in units of the domain."""
    neighbours = y.roll(1, -1) + y.roll(-1, -1) + y.roll(1, -2) + y.roll(-1, -2)
    return (neighbours - 4 * y) / WIDTH**2


class ReactionDiffusion(System):
    """State (u, v), two fields (2, 32, 32); z_e = (a, b), the diffusion coefficients; z_a = k.

    Arguments:
        reaction: what the expert knows of the local reaction: ``false`` nothing (the paper: diffusion only),
            ``without_k`` all but the constant k, as the authors' release has it.
    """

    state = (Parameter("u"), Parameter("v"))
    expert_parameters = (Parameter("a", scale=1e-3), Parameter("b", scale=5e-3))
    interaction_parameters = (Parameter("k"),)
    # Within 1e-4 of any state, fifty times below what the published models reach, for two thirds of the time.
    simulation = Solver("dopri5", rtol=1e-6, atol=1e-6)

    def __init__(self, reaction: bool | str = False) -> None:
        if reaction not in (False, "without_k"):
            raise InputError("system.reaction", repr(reaction), "false or without_k")
        self.reaction = reaction

    @property
    def state_shape(self) -> tuple[int, ...]:
        return (2, SIZE, SIZE)

    def expert(self, t: Tensor, y: Tensor, z_e: Tensor) -> Tensor:
        rate = z_e[..., None, None] * laplacian(y)
        return rate + local_reaction(y) if self.reaction else rate

    def linear_flow(self, z_e: Tensor, h: float) -> DiagonalPropagator:
        """Diffusion for h s, exact in Fourier space for the five-point Laplacian."""
        wave = 2 * math.pi * torch.arange(SIZE, device=z_e.device) / SIZE
        symbol = (2 * torch.cos(wave) - 2).to(z_e) / WIDTH**2
        symbol = symbol[:, None] + symbol[: SIZE // 2 + 1]  # of the Laplacian, (32, 17)
        decay = torch.exp(h * z_e[..., None, None] * symbol)
        return DiagonalPropagator(torch.fft.rfft2, partial(torch.fft.irfft2, s=(SIZE, SIZE)), decay)

    def nonlinear(self, t: Tensor, y: Tensor, z_e: Tensor) -> Tensor:
        return local_reaction(y) if self.reaction else torch.zeros_like(y)

    def truth(self, t: Tensor, y: Tensor, z_e: Tensor, z_a: Tensor) -> Tensor:
        rate = z_e[..., None, None] * laplacian(y) + local_reaction(y)
        u, v = rate.unbind(-3)
        return torch.stack((u - z_a[..., None], v), dim=-3)

    def sample_initial_state(self, n: int, generator: torch.Generator) -> Tensor:
        """Every value uniform in [0, 1] (paper, appendix)."""
        return torch.rand(n, *self.state_shape, generator=generator, dtype=torch.float64)


def local_reaction(y: Tensor) -> Tensor:
    """(u − u³ − v, u − v) of fields y (…, 2, 32, 32): the reaction terms without k."""
    u, v = y.unbind(-3)
    return torch.stack((u - u**3 - v, u - v), dim=-3)

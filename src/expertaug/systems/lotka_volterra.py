"""Predators and prey: u' = a u − b u v, v' = d u v − c v (Lotka 1925, Volterra 1926)."""

from __future__ import annotations

import torch
from torch import Tensor

from expertaug.systems.base import Parameter, System


class LotkaVolterra(System):
    """State (u, v), prey and predators; z_e = (a, c), z_a = (b, d): the expert lacks that the one eats the other.

    Rates are per unit of the data's time, as in Yin et al. (2021, LEADS) and Kassaï Koupaï et al. (2024, GEPS), whose
    environments differ in b and d.
    """

    state = (Parameter("u"), Parameter("v"))
    expert_parameters = (Parameter("a", "1/s"), Parameter("c", "1/s"))
    interaction_parameters = (Parameter("b", "1/s"), Parameter("d", "1/s"))

    def expert(self, t: Tensor, y: Tensor, z_e: Tensor) -> Tensor:
        prey, predators = y.unbind(-1)
        growth, death = z_e.unbind(-1)
        return torch.stack((growth * prey, -death * predators), dim=-1)

    def truth(self, t: Tensor, y: Tensor, z_e: Tensor, z_a: Tensor) -> Tensor:
        eaten = (y[..., 0] * y[..., 1]).unsqueeze(-1) * z_a
        return self.expert(t, y, z_e) + torch.stack((-eaten[..., 0], eaten[..., 1]), dim=-1)

    def sample_initial_state(self, n: int, generator: torch.Generator) -> Tensor:
        """Uniform in [1, 2] each (LEADS, appendix)."""
        return 1 + torch.rand(n, 2, generator=generator, dtype=torch.float64)

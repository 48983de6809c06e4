"""An interaction model that is a function of the time alone: a force of each window's own that nobody measured."""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor, nn

from expertaug.errors import InputError
from expertaug.models.interactions.base import Interaction
from expertaug.models.settings import DriveSettings, configure_by
from expertaug.systems import System
from expertaug.systems.base import constant_like


@configure_by(DriveSettings)
class DriveInteraction(Interaction):
    """F_a(t; z_a) = Σ_k s_k (z_a,k sin(π k t / T) + z_a,−k cos(π k t / T)) on each of ``components``.

    T is the end of the observed window, after which the sum goes on.  The z_a are what a window has of its own; with
    their standard normal prior F_a is a Gaussian process, whose amplitudes s_k are learned.

    Arguments:
        latent: size of z_a, two numbers for each harmonic of each component.
        times: of the observed window in s, (T1,).

    Raises:
        InputError: z_a has another size.
    """

    stackable = True
    sees_time = True

    def __init__(self, system: System, latent: int, times: Tensor | None = None, **options: Any) -> None:
        own = DriveSettings.of(**options)
        super().__init__(system, latent, False, own.components)
        orders = range(own.lowest, own.harmonics + 1)
        wanted = 2 * len(orders) * len(self.acts_on)
        if latent != wanted:
            problem = f"F_a has {wanted} amplitudes in a window, two for each harmonic, and z_a {latent}"
            raise InputError("model.interaction.harmonics", problem, f"give z_a (latent) {wanted} numbers")
        end = 1.0 if times is None else max(float(times[-1]), 1e-12)
        self.rates = [math.pi * order / end for order in orders]
        self.logs = nn.Parameter(torch.full((len(orders),), math.log(own.start)))
        self._space = len(system.state_shape) - 1

    def context(self, z_a: Tensor, z_e: Tensor) -> Tensor:
        """z_a (…, B, latent) → amplitudes of sines and cosines (…, B, latent)."""
        sizes = self.logs.exp().repeat_interleave(2, -1).repeat(*[1] * (self.logs.dim() - 1), len(self.acts_on))
        return z_a * sizes.unsqueeze(-2)

    def forward(self, y: Tensor, context: Tensor, known: Tensor) -> Tensor:
        """F_a at times known (…, B, 1) in s, in the shape of the states y (…, B, *state)."""
        phases = known[..., -1:] * constant_like(known, self.rates, known.dtype)
        waves = torch.stack((torch.sin(phases), torch.cos(phases)), dim=-1).flatten(-2)
        rate = (context.unflatten(-1, (len(self.acts_on), -1)) * waves.unsqueeze(-2)).sum(-1)
        rate = rate[(..., *[None] * self._space)]
        return self.placed(rate.expand(*rate.shape[: rate.dim() - self._space], *y.shape[y.dim() - self._space :]), y)

"""An interaction model that only takes energy."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor
from torch.nn.functional import softplus

from expertaug.models.interactions.base import Interaction
from expertaug.models.networks.layers import Linear
from expertaug.models.settings import DampingSettings, configure_by
from expertaug.systems import System
from expertaug.systems.base import constant_like

START = -2.0  # of the argument of softplus: a damping of .13 per unit of time


@configure_by(DampingSettings)
class DampingInteraction(Interaction):
    """F_a(y; z_a) = −softplus(w·z_a + b) y on the rates of ``components``: a linear damping.

    Its rate grows with w·z_a, so that no two z_a mean the same, and is positive for every z_a: what an encoder makes of
    windows that it was not trained on cannot drive the motion, as a damping linear in z_a can.

    Arguments:
        latent: size of z_a.
    """

    stackable = True

    def __init__(self, system: System, latent: int, **options: Any) -> None:
        own = DampingSettings.of(**options)
        super().__init__(system, latent, own.expert_parameters, own.components, own.components)
        self.rate = Linear(self.inputs, len(self.acts_on))
        self.rate.bias.data += START  # type: ignore[union-attr]
        self._space = len(system.state_shape) - 1

    def context(self, z_a: Tensor, z_e: Tensor) -> Tensor:
        """z_a (…, B, latent) and z_e (…, B, P) → rates of damping (…, B, components), in 1/s."""
        return softplus(self.rate(self.latents(z_a, z_e)))

    def forward(self, y: Tensor, context: Tensor) -> Tensor:
        """F_a at states y (…, B, *state), the shape of y."""
        every = len(self.sees) == y.shape[self._axis]
        damped = y if every else y.index_select(self._axis, constant_like(y, self.sees, torch.long))
        return self.placed(-context[(..., *[None] * self._space)] * damped, y)

"""An interaction model that is a CNN on fields."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import nullcontext
from itertools import pairwise
from typing import Any

import torch
from torch import Tensor, nn

from expertaug.models.interactions.base import Interaction
from expertaug.models.networks.convolutional import Conv, by_products, convolve, grid_rank, wrap
from expertaug.models.networks.layers import Linear
from expertaug.models.settings import ConvInteractionSettings, configure_by
from expertaug.systems import System

IN_CACHE = 16  # fields whose patches a core keeps at hand: all at once take three times as long
PRECISIONS = {"float32": None, "bfloat16": torch.bfloat16}


@configure_by(ConvInteractionSettings)
class ConvInteraction(Interaction):
    """CNN on the state's fields, with z_a as constant channels (paper, appendix, reaction–diffusion).

    A constant channel adds the same to every cell of a hidden channel (it has no edge), so z_a enters as a bias of each
    sample: :meth:`context` computes it once for a trajectory.

    With ``precision`` bfloat16 the convolutions are computed in that, their sums staying in float32.

    Arguments:
        latent: size of z_a.
    """

    stackable = True

    def __init__(self, system: System, latent: int, **options: Any) -> None:
        own = ConvInteractionSettings.of(**options)
        super().__init__(system, latent, own.expert_parameters)
        channels, kernels = own.channels, own.kernels
        fields = system.state_shape[0]
        self.rank = grid_rank(system, "model.interaction.kind")
        self.periodic = system.periodic
        self.precision = PRECISIONS[own.precision]
        self.margin = sum(k // 2 for k in kernels)
        self.state_layer = Conv(self.rank, fields, channels[0], kernels[0], bias=False)
        self.latent_layer = Linear(self.inputs, channels[0])
        self.rest = nn.ModuleList(
            Conv(self.rank, a, b, k) for (a, b), k in zip(pairwise((*channels, fields)), kernels[1:], strict=True)
        )
        for parameter in self.rest[-1].parameters():
            parameter.data *= own.start

    def context(self, z_a: Tensor, z_e: Tensor) -> Tensor:
        """z_a (…, B, latent) and z_e (…, B, P) → (…, B, channels), for :meth:`forward`."""
        return self.latent_layer(self.latents(z_a, z_e))

    def forward(self, y: Tensor, context: Tensor) -> Tensor:
        """F_a at states y (…, B, fields, *grid), the shape of y."""
        rest: Sequence[Conv] = list(self.rest)  # type: ignore[assignment]
        layers = zip(self.state_layer.seeds(), *(layer.seeds() for layer in rest), strict=True)
        stacked = y.dim() == self.rank + 3
        groups = zip(y.unbind(0), context.unbind(0), strict=True) if stacked else [(y, context)]
        rounded = nullcontext() if self.precision is None else torch.autocast(y.device.type, self.precision)
        with rounded:
            rates = [self._one(*group, *own) for group, own in zip(groups, layers, strict=True)]
        return (torch.stack(rates) if stacked else rates[0]).to(y.dtype)

    def _one(self, y: Tensor, context: Tensor, *layers: tuple) -> Tensor:
        if not by_products(y):
            return self._rates(y, context, *layers)
        parts = zip(y.split(IN_CACHE), context.split(IN_CACHE), strict=True)
        return torch.cat([self._rates(*part, *layers) for part in parts])

    def _rates(self, y: Tensor, context: Tensor, first: tuple, *rest: tuple) -> Tensor:
        hidden = convolve(wrap(y, self.margin, self.periodic), *first)
        hidden = hidden.add_(context[(..., *[None] * self.rank)])  # in place: nothing that autograd keeps
        for weight, bias in rest:
            hidden = convolve(hidden.relu_(), weight, bias)
        return hidden

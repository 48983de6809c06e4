"""An interaction model that is a CNN on fields of a periodic grid."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import nullcontext
from itertools import pairwise

import torch
from torch import Tensor, nn

from expertaug.errors import InputError
from expertaug.models.interactions.base import Interaction
from expertaug.models.networks.convolutional import Conv, by_products, convolve, grid_rank, wrap
from expertaug.models.networks.layers import Linear
from expertaug.systems import System

IN_CACHE = 16  # fields whose patches a core keeps at hand: all at once take three times as long
PRECISIONS = {"float32": None, "bfloat16": torch.bfloat16}


class ConvInteraction(Interaction):
    """CNN on the state's fields, with z_a as constant channels (paper, appendix, reaction–diffusion).

    A constant channel adds the same to every cell of a hidden channel (the grid is periodic), so z_a enters as a bias
    of each sample: :meth:`context` computes it once for a trajectory.

    Arguments:
        latent: size of z_a.
        channels: of the hidden layers.
        kernels: sizes of every layer's kernel, one more than ``channels``; 1 makes a layer local.
        expert_parameters: as :class:`Interaction`.
        start: of the last layer's usual first size; near zero the expert is alone at first.
        precision: float32, or bfloat16 for the convolutions, their sums staying in float32.
    """

    stackable = True

    def __init__(
        self,
        system: System,
        latent: int,
        channels: Sequence[int] = (16, 16),
        kernels: Sequence[int] = (3, 3, 3),
        expert_parameters: bool = False,
        precision: str = "float32",
        start: float = 1.0,
    ) -> None:
        super().__init__(system, latent, expert_parameters)
        if len(kernels) != len(channels) + 1 or any(k % 2 == 0 for k in kernels):
            raise InputError(
                "model.interaction.kernels", str(list(kernels)), f"{len(channels) + 1} odd sizes, one a layer"
            )
        if precision not in PRECISIONS:
            raise InputError("model.interaction.precision", repr(precision), f"one of {', '.join(PRECISIONS)}")
        fields = system.state_shape[0]
        self.rank = grid_rank(system, "model.interaction.kind")
        self.precision = PRECISIONS[precision]
        self.margin = sum(k // 2 for k in kernels)
        self.state_layer = Conv(self.rank, fields, channels[0], kernels[0], bias=False)
        self.latent_layer = Linear(self.inputs, channels[0])
        self.rest = nn.ModuleList(
            Conv(self.rank, a, b, k) for (a, b), k in zip(pairwise((*channels, fields)), kernels[1:], strict=True)
        )
        for parameter in self.rest[-1].parameters():
            parameter.data *= start

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
        hidden = convolve(wrap(y, self.margin), *first)
        hidden = hidden.add_(context[(..., *[None] * self.rank)])  # in place: nothing that autograd keeps
        for weight, bias in rest:
            hidden = convolve(hidden.relu_(), weight, bias)
        return hidden

"""Encoder of fields on a periodic grid by a CNN over the stacked frames."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn

from expertaug.errors import InputError
from expertaug.models.networks.convolutional import Conv, StandardiseChannels, differences, grid_rank, layer_averages
from expertaug.models.networks.layers import MLP
from expertaug.models.posterior import Delta, Posterior, constrain
from expertaug.systems import System


class ConvEncoder(nn.Module):
    """Deep CNN over the observed frames, stacked as channels (paper, appendix, reaction–diffusion).

    Every frame enters with its Laplacian of nearest neighbours, since what the diffusion coefficients leave behind is
    the decay of the finest structures; inputs are standardised by the training set, each channel on its own.
    Convolutions are periodic and every layer is averaged over the grid, so that what the encoder returns does not
    change when the fields are shifted (by a multiple of the product of the strides).

    Arguments:
        channels, strides: of the layers, kernels of size 3.
        layers: hidden layers of the MLP on the averages, which z_e and z_a share.
        latent: size of z_a.
        times: of the observed window; their number is that of the frames.
    """

    stackable = True
    head_prefix = "head."

    def __init__(
        self,
        system: System,
        times: Tensor,
        channels: Sequence[int] = (32, 32, 64),
        strides: Sequence[int] = (1, 2, 2),
        layers: Sequence[int] = (128,),
        latent: int = 10,
    ) -> None:
        super().__init__()
        if len(strides) != len(channels):
            raise InputError("model.encoder.strides", str(list(strides)), f"{len(channels)} of them, one a layer")
        self.system = system
        self.latent = latent
        self.rank = grid_rank(system, "model.encoder.kind")
        inputs = 2 * len(times) * system.state_shape[0]
        self.scale = StandardiseChannels(inputs, self.rank)
        self.layers = nn.ModuleList(
            Conv(self.rank, a, b, stride=s) for (a, b), s in zip(pairwise((inputs, *channels)), strides, strict=True)
        )
        self.trunk = MLP(sum(channels), layers[:-1], layers[-1])
        self.head = MLP(layers[-1], (), len(system.expert_parameters))
        self.latent_head = MLP(layers[-1], (), latent)

    def inputs(self, observed: Tensor) -> Tensor:
        """(T1, …, B, fields, *grid) → frames and their Laplacians (…, B, 2 · T1 · fields, *grid)."""
        channel = -1 - self.rank
        frames = observed.movedim(0, channel - 1).flatten(channel - 1, channel)
        return torch.cat((frames, differences(frames, self.rank)), dim=channel)

    def fit(self, observed: Tensor) -> None:
        """Standardise by the training set's observed window (T1, N, fields, *grid)."""
        self.scale.fit(self.inputs(observed))

    def forward(self, observed: Tensor) -> Posterior:
        """(T1, …, B, fields, *grid) → z_e (…, B, P), z_a (…, B, latent)."""
        x = self.scale(self.inputs(observed))
        hidden = torch.relu(self.trunk(layer_averages(self.layers, x)))
        z_e = constrain(self.head(hidden), self.system.expert_parameters)
        return Posterior(Delta(z_e), Delta(self.latent_head(hidden)))

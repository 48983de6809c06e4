"""Encoders of fields: a CNN over the stacked frames, and an MLP on their spatial averages."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import torch
from torch import Tensor, nn

from expertaug.models.networks.convolutional import Conv, StandardiseChannels, differences, grid_rank, layer_averages
from expertaug.models.networks.layers import MLP, Standardise
from expertaug.models.posterior import Delta, Posterior, constrain
from expertaug.models.settings import ConvSettings, MomentSettings, configure_by
from expertaug.systems import System

PART = 64  # windows whose moments are made at a time where no gradient is wanted


@configure_by(ConvSettings)
class ConvEncoder(nn.Module):
    """Deep CNN over the observed frames, stacked as channels (paper, appendix, reaction–diffusion).

    Every frame enters with its Laplacian of nearest neighbours, since what the diffusion coefficients leave behind is
    the decay of the finest structures; inputs are standardised by the training set, each channel on its own.
    Every layer is averaged over the grid, so that on a periodic one what the encoder returns does not change when the
    fields are shifted (by a multiple of the product of the strides).

    Arguments:
        times: of the observed window; their number is that of the frames.
    """

    stackable = True
    head_prefix = "head."

    def __init__(self, system: System, times: Tensor, **options: Any) -> None:
        super().__init__()
        own = ConvSettings.of(**options)
        self.system = system
        self.latent = own.latent
        self.rank = grid_rank(system, "model.encoder.kind")
        inputs = 2 * len(times) * system.state_shape[0]
        self.scale = StandardiseChannels(inputs, self.rank)
        self.layers = nn.ModuleList(
            Conv(self.rank, a, b, stride=s)
            for (a, b), s in zip(pairwise((inputs, *own.channels)), own.strides, strict=True)
        )
        self.trunk = MLP(sum(own.channels), own.layers[:-1], own.layers[-1])
        self.head = MLP(own.layers[-1], (), len(system.expert_parameters))
        self.latent_head = MLP(own.layers[-1], (), own.latent)

    def inputs(self, observed: Tensor) -> Tensor:
        """(T1, …, B, fields, *grid) → frames and their Laplacians (…, B, 2 · T1 · fields, *grid)."""
        channel = -1 - self.rank
        frames = observed.movedim(0, channel - 1).flatten(channel - 1, channel)
        return torch.cat((frames, differences(frames, self.rank, self.system.periodic)), dim=channel)

    def fit(self, observed: Tensor) -> None:
        """Standardise by the training set's observed window (T1, N, fields, *grid)."""
        self.scale.fit(self.inputs(observed))

    def forward(self, observed: Tensor) -> Posterior:
        """(T1, …, B, fields, *grid) → z_e (…, B, P), z_a (…, B, latent)."""
        x = self.scale(self.inputs(observed))
        hidden = torch.relu(self.trunk(layer_averages(self.layers, x, self.system.periodic)))
        z_e = constrain(self.head(hidden), self.system.expert_parameters)
        return Posterior(Delta(z_e), Delta(self.latent_head(hidden)))


class Moments(nn.Module):
    """Averages over the grid that tell what a local equation of motion ∂y/∂t = D Δy + f(y) is made of.

    For every interval between two frames: the fields halfway and their powers, the increments, and the Laplacians
    halfway; of these the means (Laplacians have none) and the means of all products of two.  A diffusion coefficient
    is nearly a ratio of such means.  On a periodic grid all are invariant under shifts of the fields.

    Arguments:
        system: with fields as its state.
        frames: T1, at least 2.
        powers: of the fields halfway.

    Attributes:
        outputs: how many numbers :meth:`forward` gives.
    """

    size: Tensor

    def __init__(self, system: System, frames: int, powers: Sequence[int] = (1, 3)) -> None:
        super().__init__()
        self.rank = grid_rank(system, "model.encoder.kind")
        self.fields, self.powers, self.periodic = system.state_shape[0], tuple(powers), system.periodic
        channels = (len(self.powers) + 2) * self.fields
        self.outputs = (frames - 1) * (channels - self.fields + channels * (channels + 1) // 2)
        self.register_buffer("size", torch.ones(channels, 1))
        self.scale = Standardise(self.outputs)

    def fit(self, y: Tensor) -> None:
        """Learn scales from frames (N, T1, fields, *grid)."""
        parts = y.split(256)
        size = torch.stack([self._channels(part).square().mean((0, 1, 3)) for part in parts]).mean(0).sqrt()
        self.size.copy_(size.clamp_min(1e-6).unsqueeze(-1).expand_as(self.size))
        first_size = self.size if self.size.dim() == 2 else self.size[0]
        self.scale.fit(torch.cat([self._moments(part, first_size) for part in parts]))

    def forward(self, y: Tensor) -> Tensor:
        """Frames (…, B, T1, fields, *grid) → standardised moments (…, B, outputs)."""
        axis = -3 - self.rank
        parts = [y] if torch.is_grad_enabled() else y.split(PART, axis)  # channels are ten times as large as frames
        return self.scale(torch.cat([self._moments(part, self.size) for part in parts], dim=-2))

    def _channels(self, y: Tensor) -> Tensor:
        """(…, T1 − 1, channels, cells)."""
        cells = [slice(None)] * (1 + self.rank)
        before, after = y[(..., slice(None, -1), *cells)], y[(..., slice(1, None), *cells)]
        middle = (before + after) / 2
        powers = [middle**power for power in self.powers]
        curvature = differences(middle, self.rank, self.periodic)
        channels = torch.cat((*powers, after - before, curvature), dim=-1 - self.rank)
        return channels.flatten(-self.rank)

    def _moments(self, y: Tensor, size: Tensor) -> Tensor:
        x = self._channels(y) / size.unsqueeze(-3).unsqueeze(-3)
        second = x @ x.transpose(-1, -2) / x.shape[-1]
        rows, columns = torch.triu_indices(*second.shape[-2:], device=y.device)
        moments = torch.cat((x[..., : -self.fields, :].mean(-1), second[..., rows, columns]), dim=-1)
        return moments.flatten(-2)


@configure_by(MomentSettings)
class MomentEncoder(nn.Module):
    """MLP on the observed frames' :class:`Moments`.

    Arguments:
        times: of the observed window; their number is that of the frames.
    """

    stackable = True
    head_prefix = "head."

    def __init__(self, system: System, times: Tensor, **options: Any) -> None:
        super().__init__()
        own = MomentSettings.of(**options)
        self.system, self.latent = system, own.latent
        self.moments = Moments(system, len(times), own.powers)
        self.trunk = MLP(self.moments.outputs, own.layers[:-1], own.layers[-1], own.activation)
        self.head = MLP(own.layers[-1], (), len(system.expert_parameters))
        self.latent_head = MLP(own.layers[-1], (), own.latent)

    def fit(self, observed: Tensor) -> None:
        """Standardise by the training set's observed window (T1, N, fields, *grid)."""
        self.moments.fit(observed.movedim(0, 1))

    def forward(self, observed: Tensor) -> Posterior:
        """(T1, …, B, fields, *grid) → z_e (…, B, P), z_a (…, B, latent)."""
        hidden = self.trunk.activation(self.trunk(self.moments(observed.movedim(0, -2 - self.moments.rank))))
        z_e = constrain(self.head(hidden), self.system.expert_parameters)
        return Posterior(Delta(z_e), Delta(self.latent_head(hidden)))

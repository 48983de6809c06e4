"""The two-step encoder of the hybrid-VAE for states that are fields on a periodic grid (paper, app. HVAE)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import pairwise

import torch
from torch import Tensor, nn

from expertaug.errors import InputError
from expertaug.models.encoders.moments import Moments
from expertaug.models.encoders.two_step import TwoStep
from expertaug.models.networks.convolutional import Conv, StandardiseChannels, differences, grid_rank, layer_averages
from expertaug.models.networks.layers import MLP
from expertaug.models.networks.unet import UNet
from expertaug.systems import System


class ConvTwoStep(TwoStep):
    """CNNs for g_a and g_p2, a conditional U-Net for g_p1 (paper, app. HVAE, reaction–diffusion).

    All frames enter as channels of one image: a tenth of the cost of one frame after the other, and g_p1, which has to
    take away what the interaction has done by each frame, knows which frame is which.

    Arguments:
        latent: size of z_a.
        channels, strides: of the layers of g_a and g_p2, kernels of size 3.
        layers: hidden layers of the MLPs on their averages over the grid.
        filter_channels: of the U-Net's levels.
        powers: g_a and g_p2 are MLPs of ``layers`` on the frames' :class:`Moments` with these
            powers; null for CNNs.
    """

    stackable = True

    def __init__(
        self,
        system: System,
        times: Tensor,
        latent: int = 10,
        channels: Sequence[int] = (32, 32, 64),
        strides: Sequence[int] = (1, 2, 2),
        layers: Sequence[int] = (128,),
        filter_channels: Sequence[int] = (16, 32, 32),
        powers: Sequence[int] | None = None,
    ) -> None:
        if len(strides) != len(channels):
            raise InputError("model.encoder.strides", str(list(strides)), f"{len(channels)} of them, one a layer")
        rank, grid = grid_rank(system, "model.encoder.kind"), system.state_shape[1:]
        halvings = len(filter_channels) - 1
        if any(cells % 2**halvings for cells in grid):
            remedy = f"at most so many levels that the grid {grid} can be halved"
            raise InputError("model.encoder.filter_channels", str(list(filter_channels)), remedy)
        fields = len(times) * system.state_shape[0]

        def network(outputs: int) -> nn.Module:
            if powers is None:
                return FrameCNN(rank, fields, channels, strides, layers, outputs)
            return FrameMoments(system, len(times), powers, layers, outputs)

        latent_network, expert_network = network(2 * latent), network(2 * len(system.expert_parameters))
        filter_network = FrameFilter(rank, fields, latent, filter_channels)
        super().__init__(system, partial(frames, rank=rank), latent, latent_network, filter_network, expert_network)


def frames(observed: Tensor, rank: int) -> Tensor:
    """The view: (T1, …, B, fields, *grid) → (…, B, T1 · fields, *grid)."""
    return observed.movedim(0, -2 - rank).flatten(-2 - rank, -1 - rank)


class FrameCNN(nn.Module):
    """Frames and their Laplacians (…, B, frames, *grid) → (…, B, outputs): g_a or g_p2.

    Every layer is averaged over the grid, as :class:`expertaug.models.encoders.convolutional.ConvEncoder` does.
    """

    def __init__(
        self,
        rank: int,
        fields: int,
        channels: Sequence[int],
        strides: Sequence[int],
        layers: Sequence[int],
        outputs: int,
    ) -> None:
        super().__init__()
        self.rank = rank
        self.scale = StandardiseChannels(2 * fields, rank)
        self.layers = nn.ModuleList(
            Conv(rank, a, b, stride=s) for (a, b), s in zip(pairwise((2 * fields, *channels)), strides, strict=True)
        )
        self.head = MLP(sum(channels), layers, outputs)

    def fit(self, seen: Tensor) -> None:
        self.scale.fit(_with_differences(seen, self.rank))

    def forward(self, seen: Tensor) -> Tensor:
        x = self.scale(_with_differences(seen, self.rank))
        return self.head(layer_averages(self.layers, x))


class FrameMoments(nn.Module):
    """MLP on the frames' moments, (…, B, frames, *grid) → (…, B, outputs): g_a or g_p2."""

    def __init__(self, system: System, frames: int, powers: Sequence[int], layers: Sequence[int], outputs: int) -> None:
        super().__init__()
        self.moments = Moments(system, frames, powers)
        self.head = MLP(self.moments.outputs, layers, outputs, "silu")

    def fit(self, seen: Tensor) -> None:
        self.moments.fit(self._frames(seen))

    def forward(self, seen: Tensor) -> Tensor:
        return self.head(self.moments(self._frames(seen)))

    def _frames(self, seen: Tensor) -> Tensor:
        return seen.unflatten(-1 - self.moments.rank, (-1, self.moments.fields))


class FrameFilter(nn.Module):
    """g_p1: frames + U-Net(frames, z_a), the U-Net's output in units of each frame's standard deviation."""

    def __init__(self, rank: int, fields: int, latent: int, channels: Sequence[int]) -> None:
        super().__init__()
        self.scale = StandardiseChannels(fields, rank)
        self.network = UNet(fields, latent, channels, rank)

    def fit(self, seen: Tensor) -> None:
        self.scale.fit(seen)

    def forward(self, seen: Tensor, z_a: Tensor) -> Tensor:
        return seen + self.scale.std.unsqueeze(-2 - self.scale.rank) * self.network(self.scale(seen), z_a)


def _with_differences(seen: Tensor, rank: int) -> Tensor:
    return torch.cat((seen, differences(seen, rank)), dim=-1 - rank)

"""A small conditional U-Net for fields on a periodic grid."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn

from expertaug.models.networks.convolutional import Conv, convolve, wrap
from expertaug.models.networks.layers import Linear


class UNet(nn.Module):
    """Periodic U-Net (Ronneberger et al. 2015): every level halves the grid, every hidden layer has a bias by z_a.

    It computes one seed or a group of seeds alike, as :mod:`expertaug.models.networks.convolutional` does.

    Arguments:
        fields: channels of input and output.
        condition: size of z_a.
        channels: of the levels, the finest first; the grid must allow one halving less than there are levels.
        rank: axes of the grid.
    """

    def __init__(self, fields: int, condition: int, channels: Sequence[int] = (16, 32, 32), rank: int = 2) -> None:
        super().__init__()
        self.down = nn.ModuleList(
            Conv(rank, a, b, stride=1 + (k > 0), bias=False) for k, (a, b) in enumerate(pairwise((fields, *channels)))
        )
        self.up = nn.ModuleList(Conv(rank, fine + coarse, fine, bias=False) for fine, coarse in pairwise(channels))
        self.out = Conv(rank, channels[0], fields, kernel=1)
        self.widths = [*channels, *reversed(channels[:-1])]  # in the order of computing
        self.biases = Linear(condition, sum(self.widths))

    def forward(self, x: Tensor, z: Tensor) -> Tensor:
        """(…, B, fields, *grid) and (…, B, condition) → (…, B, fields, *grid)."""
        stacked = x.dim() == self.out.rank + 3
        biases = self.biases(z)
        groups = zip(x.unbind(0), biases.unbind(0), strict=True) if stacked else [(x, biases)]
        layers = zip(*(layer.seeds() for layer in (*self.down, *self.up, self.out)), strict=True)
        each = [self._one(*group, own) for group, own in zip(groups, layers, strict=True)]
        return torch.stack(each) if stacked else each[0]

    def _one(self, x: Tensor, biases: Tensor, parameters: Sequence[tuple]) -> Tensor:
        """One seed."""
        levels, count = [], len(self.down)
        steps = iter(biases[(..., *[None] * self.out.rank)].split(self.widths, dim=1))
        for layer, (weight, _) in zip(self.down, parameters, strict=False):
            x = torch.relu(convolve(wrap(x, 1), weight, None, layer.stride) + next(steps))
            levels.append(x)
        x = levels.pop()
        up = [weight for weight, _ in parameters[count:-1]]
        for fine, weight in zip(reversed(levels), reversed(up), strict=True):
            coarse = nn.functional.interpolate(x, scale_factor=2, mode="nearest")
            x = torch.relu(convolve(wrap(torch.cat((fine, coarse), dim=1), 1), weight, None) + next(steps))
        return convolve(x, *parameters[-1])

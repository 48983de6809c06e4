"""Convolutional networks for states that are fields on a grid of one to three axes, (channels, *grid).

Beyond an edge they find the other end where the system is periodic, and zeros otherwise.

Like the layers of :mod:`expertaug.models.networks.layers`, they compute one seed or a group of seeds alike: inputs are
(S, B, C, *grid) for stacked parameters and (B, C, *grid) otherwise.  A group is a loop over its seeds: one grouped
convolution over all of them takes twice the time (benchmarks/reaction_diffusion_step.py).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise, product

import torch
from torch import Tensor, nn

from expertaug.errors import InputError
from expertaug.models.networks.layers import Linear
from expertaug.systems import System

LAYOUTS = {4: torch.channels_last, 5: torch.channels_last_3d}  # by the number of a tensor's axes
CONVOLUTIONS = {1: nn.functional.conv1d, 2: nn.functional.conv2d, 3: nn.functional.conv3d}


def grid_rank(system: System, where: str) -> int:
    """How many axes the grid of a system's fields has.

    Raises:
        InputError: the state is no field, or its grid has more axes than there are convolutions.
    """
    rank = len(system.state_shape) - 1
    if rank not in CONVOLUTIONS:
        problem = f"{type(system).__name__} has states of shape {system.state_shape}"
        raise InputError(where, problem, "choose one for plain states, or fields of shape (fields, *grid), 1 to 3 axes")
    return rank


class Conv(nn.Module):
    """Convolution without padding; weights (out, in, k, …) and bias (out,), initialised as torch's own.

    Arguments:
        rank: axes of the grid.
        inputs, outputs: channels.
        kernel: k, odd.
        stride: of the output's cells.
    """

    def __init__(
        self, rank: int, inputs: int, outputs: int, kernel: int = 3, stride: int = 1, bias: bool = True
    ) -> None:
        super().__init__()
        bound = 1 / math.sqrt(inputs * kernel**rank)
        self.rank, self.stride, self.kernel = rank, stride, kernel
        self.weight = nn.Parameter(torch.empty(outputs, inputs, *[kernel] * rank).uniform_(-bound, bound))
        self.bias = nn.Parameter(torch.empty(outputs).uniform_(-bound, bound)) if bias else None

    def seeds(self) -> list[tuple[Tensor, Tensor | None]]:
        """Weight and bias of every seed; one of them where the layer is not stacked."""
        if self.weight.dim() == self.rank + 2:
            return [(self.weight, self.bias)]
        biases = [None] * len(self.weight) if self.bias is None else self.bias.unbind(0)
        return list(zip(self.weight.unbind(0), biases, strict=True))


def convolve(x: Tensor, weight: Tensor, bias: Tensor | None, stride: int = 1) -> Tensor:
    """One seed's layer: (B, C, H, …) → (B, C', (H − k) / stride + 1, …)."""
    if by_products(x):
        return _convolve_by_products(x, weight, bias, stride)
    return CONVOLUTIONS[weight.dim() - 2](x, weight, bias, stride)


def by_products(x: Tensor) -> bool:
    """Whether convolutions of x are computed as products of matrices."""
    return x.dtype == torch.float64 and x.device.type == "cpu"


def _convolve_by_products(x: Tensor, weight: Tensor, bias: Tensor | None, stride: int) -> Tensor:
    """The same as a product of matrices: the CPU's fast convolutions are of single precision, and the one that torch
    takes in double precision needs three times as long (benchmarks/reaction_diffusion_step.py --double)."""
    kernel = weight.shape[-1]
    cells = [(size - kernel) // stride + 1 for size in x.shape[2:]]
    shifts = [[slice(k, k + stride * (n - 1) + 1, stride) for k in range(kernel)] for n in cells]
    patches = x if kernel == stride == 1 else torch.stack([x[(..., *at)] for at in product(*shifts)], 2)
    patches = patches.reshape(len(x), -1, math.prod(cells))
    sums = weight.flatten(1) @ patches
    if bias is not None:
        sums = sums + bias[:, None]
    return sums.view(len(x), -1, *cells)


def wrap(x: Tensor, margin: int, periodic: bool = True) -> Tensor:
    """Fields (B, C, *grid) with ``margin`` more cells on every side, channels last in memory.

    Padding once by what all the layers together need, instead of before every layer, halves the time of a network of
    few input channels: the inner cells computed twice cost less than copying its hidden channels.
    """
    mode = "circular" if periodic else "constant"
    padded = nn.functional.pad(x, (margin,) * 2 * (x.dim() - 2), mode=mode) if margin else x
    if by_products(x):
        return padded
    return padded.contiguous(memory_format=LAYOUTS.get(x.dim(), torch.contiguous_format))


def layer_averages(layers: nn.ModuleList, x: Tensor, periodic: bool = True) -> Tensor:
    """Averages over the grid of every layer's output, (…, B, sum of the channels), for x (…, B, channels, *grid)."""
    convolutions: Sequence[Conv] = list(layers)  # type: ignore[assignment]
    grid = tuple(range(-convolutions[0].rank, 0))
    stacked = x.dim() == len(grid) + 3
    parameters = zip(*(layer.seeds() for layer in convolutions), strict=True)
    per_seed = []
    for activation, own in zip(x.unbind(0) if stacked else [x], parameters, strict=True):
        averages = []
        for layer, (weight, bias) in zip(convolutions, own, strict=True):
            wide = wrap(activation, layer.kernel // 2, periodic)
            activation = torch.relu(convolve(wide, weight, bias, layer.stride))
            averages.append(activation.mean(grid))
        per_seed.append(torch.cat(averages, dim=-1))
    return torch.stack(per_seed) if stacked else per_seed[0]


def differences(fields: Tensor, rank: int, periodic: bool = True) -> Tensor:
    """Sum over a cell's neighbours of their difference from it, for fields (…, *grid) of ``rank`` axes."""
    if not periodic:
        axes = range(1, rank + 1)
        seconds = [nn.functional.pad(fields, (0, 0) * (axis - 1) + (1, 1)).diff(n=2, dim=-axis) for axis in axes]
        return torch.stack(seconds).sum(0)
    neighbours = fields.roll(1, -1) + fields.roll(-1, -1)
    for axis in range(-2, -rank - 1, -1):
        neighbours = neighbours + fields.roll(1, axis) + fields.roll(-1, axis)
    return neighbours - 2 * rank * fields


class StandardiseChannels(nn.Module):
    """Subtracts the training set's mean and divides by its standard deviation, each channel on its own."""

    mean: Tensor
    std: Tensor

    def __init__(self, channels: int, rank: int) -> None:
        super().__init__()
        self.rank = rank
        self.register_buffer("mean", torch.zeros(channels, *[1] * rank))
        self.register_buffer("std", torch.ones(channels, *[1] * rank))

    def fit(self, x: Tensor) -> None:
        """Take mean and standard deviation from x (N, channels, *grid)."""
        variance, mean = torch.var_mean(x, dim=(0, *range(2, 2 + self.rank)))
        self.mean.copy_(mean.view(-1, *[1] * self.rank).expand_as(self.mean))
        self.std.copy_(variance.sqrt().clamp_min(1e-6).view(-1, *[1] * self.rank).expand_as(self.std))

    def forward(self, x: Tensor) -> Tensor:
        # The statistics have the seeds' axis only where they are stacked; they are for all samples alike.
        return (x - self.mean.unsqueeze(-2 - self.rank)) / self.std.unsqueeze(-2 - self.rank)


class UNet(nn.Module):
    """U-Net (Ronneberger et al. 2015): every level halves the grid, every hidden layer has a bias by z_a.

    It computes one seed or a group of seeds alike, as the other layers do.

    Arguments:
        fields: channels of input and output.
        condition: size of z_a.
        channels: of the levels, the finest first; the grid must allow one halving less than there are levels.
        rank: axes of the grid.
        periodic: whether it wraps around.
    """

    def __init__(
        self,
        fields: int,
        condition: int,
        channels: Sequence[int] = (16, 32, 32),
        rank: int = 2,
        periodic: bool = True,
    ) -> None:
        super().__init__()
        self.periodic = periodic
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
            x = torch.relu(convolve(wrap(x, 1, self.periodic), weight, None, layer.stride) + next(steps))
            levels.append(x)
        x = levels.pop()
        up = [weight for weight, _ in parameters[count:-1]]
        for fine, weight in zip(reversed(levels), reversed(up), strict=True):
            coarse = nn.functional.interpolate(x, scale_factor=2, mode="nearest")
            both = wrap(torch.cat((fine, coarse), dim=1), 1, self.periodic)
            x = torch.relu(convolve(both, weight, None) + next(steps))
        return convolve(x, *parameters[-1])

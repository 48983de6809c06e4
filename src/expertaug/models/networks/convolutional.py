"""Convolutional networks for states that are fields on a periodic grid, (channels, height, width).

Like the layers of :mod:`expertaug.models.networks.layers`, they compute one seed or a group of seeds alike: inputs are
(S, B, C, H, W) for stacked parameters and (B, C, H, W) otherwise.  A group is a loop over its seeds: one grouped
convolution over all of them takes twice the time (benchmarks/reaction_diffusion_step.py).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor, nn


class Conv2d(nn.Module):
    """Convolution without padding; weights (out, in, k, k) and bias (out,), initialised as torch's own.

    Arguments:
        inputs, outputs: channels.
        kernel: k, odd.
        stride: of the output's cells.
    """

    def __init__(self, inputs: int, outputs: int, kernel: int = 3, stride: int = 1, bias: bool = True) -> None:
        super().__init__()
        bound = 1 / math.sqrt(inputs * kernel**2)
        self.stride, self.kernel = stride, kernel
        self.weight = nn.Parameter(torch.empty(outputs, inputs, kernel, kernel).uniform_(-bound, bound))
        self.bias = nn.Parameter(torch.empty(outputs).uniform_(-bound, bound)) if bias else None

    def seeds(self) -> list[tuple[Tensor, Tensor | None]]:
        """Weight and bias of every seed; one of them where the layer is not stacked."""
        if self.weight.dim() == 4:
            return [(self.weight, self.bias)]
        biases = [None] * len(self.weight) if self.bias is None else self.bias.unbind(0)
        return list(zip(self.weight.unbind(0), biases, strict=True))


def convolve(x: Tensor, weight: Tensor, bias: Tensor | None, stride: int = 1) -> Tensor:
    """One seed's layer: (B, C, H, W) → (B, C', (H − k) / stride + 1, …)."""
    return nn.functional.conv2d(x, weight, bias, stride)


def wrap(x: Tensor, margin: int) -> Tensor:
    """Periodic fields (B, C, H, W) with ``margin`` more cells on every side, channels last in memory.

    Padding once by what all the layers together need, instead of before every layer, halves the time of a network of
    few input channels: the inner cells computed twice cost less than copying its hidden channels.
    """
    padded = nn.functional.pad(x, (margin,) * 4, mode="circular") if margin else x
    return padded.contiguous(memory_format=torch.channels_last)


def layer_averages(layers: Sequence[Conv2d], x: Tensor) -> Tensor:
    """Averages over the grid of every layer's output, (…, B, sum of the channels), for x (…, B, channels, H, W)."""
    stacked = x.dim() == 5
    parameters = zip(*(layer.seeds() for layer in layers), strict=True)
    found = []
    for one, own in zip(x.unbind(0) if stacked else [x], parameters, strict=True):
        averages = []
        for layer, (weight, bias) in zip(layers, own, strict=True):
            one = torch.relu(convolve(wrap(one, layer.kernel // 2), weight, bias, layer.stride))
            averages.append(one.mean((-2, -1)))
        found.append(torch.cat(averages, dim=-1))
    return torch.stack(found) if stacked else found[0]


def differences(fields: Tensor) -> Tensor:
    """Sum of a cell's four neighbours less four times itself, for periodic fields (…, H, W)."""
    neighbours = fields.roll(1, -1) + fields.roll(-1, -1) + fields.roll(1, -2) + fields.roll(-1, -2)
    return neighbours - 4 * fields

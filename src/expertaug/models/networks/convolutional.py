"""Convolutional networks for states that are fields on a periodic grid, (channels, height, width).

Like the layers of :mod:`expertaug.models.networks.layers`, they compute one seed or a block of seeds alike: inputs are
(S, B, C, H, W) for stacked parameters and (B, C, H, W) otherwise.  A block is a loop over its seeds: one grouped
convolution over all of them takes twice the time (benchmarks/reaction_diffusion_step.py).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn

from expertaug.errors import InputError
from expertaug.models.interactions.base import Interaction
from expertaug.models.networks.layers import MLP, Linear
from expertaug.models.posterior import Delta, Posterior, constrain
from expertaug.systems import System

PRECISIONS = {"float32": None, "bfloat16": torch.bfloat16}


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


class ConvInteraction(Interaction):
    """CNN on the state's fields, with z_a as constant channels (paper, appendix, reaction–diffusion).

    A constant channel adds the same to every cell of a hidden channel (the grid is periodic), so z_a enters as a bias
    of each sample: :meth:`context` computes it once for a trajectory.

    Arguments:
        latent: size of z_a.
        channels: of the hidden layers.
        kernels: sizes of every layer's kernel, one more than ``channels``; 1 makes a layer local.
        expert_parameters: as :class:`Interaction`.
        precision: float32, or bfloat16 for the convolutions, their sums staying in float32.
    """

    def __init__(
        self,
        system: System,
        latent: int,
        channels: Sequence[int] = (16, 16),
        kernels: Sequence[int] = (3, 3, 3),
        expert_parameters: bool = False,
        precision: str = "float32",
    ) -> None:
        super().__init__(system, latent, expert_parameters)
        if len(kernels) != len(channels) + 1 or any(k % 2 == 0 for k in kernels):
            raise InputError(
                "model.interaction.kernels", str(list(kernels)), f"{len(channels) + 1} odd sizes, one a layer"
            )
        if precision not in PRECISIONS:
            raise InputError("model.interaction.precision", repr(precision), f"one of {', '.join(PRECISIONS)}")
        fields = system.state_shape[0]
        self.precision = PRECISIONS[precision]
        self.margin = sum(k // 2 for k in kernels)
        self.state_layer = Conv2d(fields, channels[0], kernels[0], bias=False)
        self.latent_layer = Linear(self.inputs, channels[0])
        self.rest = nn.ModuleList(
            Conv2d(a, b, k) for (a, b), k in zip(pairwise((*channels, fields)), kernels[1:], strict=True)
        )

    def context(self, z_a: Tensor, z_e: Tensor) -> Tensor:
        """z_a (…, B, latent) and z_e (…, B, P) → (…, B, channels), for :meth:`forward`."""
        return self.latent_layer(self.latents(z_a, z_e))

    def forward(self, y: Tensor, context: Tensor) -> Tensor:
        """F_a at states y (…, B, fields, H, W), the shape of y."""
        layers = zip(self.state_layer.seeds(), *(layer.seeds() for layer in self.rest), strict=True)
        stacked = y.dim() == 5
        blocks = zip(y.unbind(0), context.unbind(0), strict=True) if stacked else [(y, context)]
        with torch.autocast(y.device.type, self.precision, enabled=self.precision is not None):
            rates = [self._one(*block, *own) for block, own in zip(blocks, layers, strict=True)]
        return (torch.stack(rates) if stacked else rates[0]).to(y.dtype)

    def _one(self, y: Tensor, context: Tensor, first: tuple, *rest: tuple) -> Tensor:
        hidden = convolve(wrap(y, self.margin), *first)
        hidden = hidden.add_(context[..., None, None])  # in place: nothing that autograd keeps
        for weight, bias in rest:
            hidden = convolve(hidden.relu_(), weight, bias)
        return hidden


class ConvEncoder(nn.Module):
    """Deep CNN over the observed frames, stacked as channels (paper, appendix, reaction–diffusion).

    Every frame enters with its five-point Laplacian, since what the diffusion coefficients leave behind is the decay of
    the finest structures; inputs are standardised by the training set, each channel on its own.  Convolutions are
    periodic and every layer is averaged over the grid, so that what the encoder returns does not change when the fields
    are shifted (by a multiple of the product of the strides).

    Arguments:
        channels, strides: of the layers, 3 × 3 each.
        layers: hidden layers of the MLP on the averages, which z_e and z_a share.
        latent: size of z_a.
        times: of the observed window; their number is that of the frames.
    """

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
        inputs = 2 * len(times) * system.state_shape[0]
        self.register_buffer("mean", torch.zeros(inputs, 1, 1))
        self.register_buffer("std", torch.ones(inputs, 1, 1))
        self.layers = nn.ModuleList(
            Conv2d(a, b, stride=s) for (a, b), s in zip(pairwise((inputs, *channels)), strides, strict=True)
        )
        self.trunk = MLP(sum(channels), layers[:-1], layers[-1])
        self.head = MLP(layers[-1], (), len(system.expert_parameters))
        self.latent_head = MLP(layers[-1], (), latent)

    def inputs(self, observed: Tensor) -> Tensor:
        """(T1, …, B, fields, H, W) → frames and their Laplacians (…, B, 2 · T1 · fields, H, W)."""
        frames = observed.movedim(0, -4).flatten(-4, -3)
        return torch.cat((frames, differences(frames)), dim=-3)

    def fit(self, observed: Tensor) -> None:
        """Standardise by the training set's observed window (T1, N, fields, H, W)."""
        variance, mean = torch.var_mean(self.inputs(observed), dim=(0, 2, 3))
        self.mean.copy_(mean.view(-1, 1, 1).expand_as(self.mean))
        self.std.copy_(variance.sqrt().clamp_min(1e-6).view(-1, 1, 1).expand_as(self.std))

    def forward(self, observed: Tensor) -> Posterior:
        """(T1, …, B, fields, H, W) → z_e (…, B, P), z_a (…, B, latent)."""
        x = self.inputs(observed)
        # The statistics have the seeds' axis only where they are stacked; they are for all samples alike.
        x = (x - self.mean.unsqueeze(-4)) / self.std.unsqueeze(-4)
        hidden = torch.relu(self.trunk(layer_averages(self.layers, x)))
        z_e = constrain(self.head(hidden), self.system.expert_parameters)
        return Posterior(Delta(z_e), Delta(self.latent_head(hidden)))


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

"""Layers that compute one seed or a group of seeds alike.

Weights are stored (in, out) and biases (1, out).  With parameters stacked along a leading seed axis, (S, in, out) and
(S, 1, out), the same line is one batched matrix product, faster than ``torch.vmap`` over ordinary layers
(benchmarks/training_step.py shows by how much).  Inputs are (S, B, in) for stacked parameters and (B, in) otherwise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn

from expertaug.errors import InputError
from expertaug.systems import System

ACTIVATIONS = {"relu": torch.relu, "silu": nn.functional.silu, "selu": torch.selu, "tanh": torch.tanh}


def feature_count(system: System, where: str) -> int:
    """How many numbers a network sees of one state.

    Raises:
        InputError: the state's features are no vector.
    """
    features = system.features(torch.zeros(1, *system.state_shape))
    if features.dim() != 2:
        problem = f"{type(system).__name__} has states of shape {system.state_shape}"
        raise InputError(
            where, problem, "choose one for fields (conv, moments, polynomial), or let features() be a vector"
        )
    return features.shape[-1]


class Linear(nn.Module):
    """x W + b, initialised as torch's own linear layer: uniform within ±1/√in."""

    def __init__(self, inputs: int, outputs: int, bias: bool = True) -> None:
        super().__init__()
        bound = 1 / math.sqrt(max(inputs, 1))
        self.weight = nn.Parameter(torch.empty(inputs, outputs).uniform_(-bound, bound))
        self.bias = nn.Parameter(torch.empty(1, outputs).uniform_(-bound, bound)) if bias else None

    def forward(self, x: Tensor) -> Tensor:
        """(…, B, in) → (…, B, out)."""
        if self.bias is None:
            return x @ self.weight
        return affine(x, self.weight, self.bias)


def affine(x: Tensor, weight: Tensor, bias: Tensor) -> Tensor:
    """x W + bias in one call; bias may also be (…, B, out)."""
    if x.dim() == 3 and weight.dim() == 3:
        return torch.baddbmm(bias, x, weight)
    return x @ weight + bias


class MLP(nn.Module):
    """Fully connected network: ``layers`` hidden layers, no activation after the last."""

    def __init__(self, inputs: int, layers: Sequence[int], outputs: int, activation: str = "relu") -> None:
        super().__init__()
        if activation not in ACTIVATIONS:
            raise InputError("activation", repr(activation), f"one of {', '.join(ACTIVATIONS)}")
        widths = (inputs, *layers, outputs)
        for width in widths:
            if type(width) is not int or width < 0:
                raise InputError("layers", f"a width of {width!r}", "widths are whole numbers, as in [128, 128]")
        self.layers = nn.ModuleList(Linear(a, b) for a, b in pairwise(widths))
        self.activation = ACTIVATIONS[activation]

    def forward(self, x: Tensor) -> Tensor:
        """(…, B, inputs) → (…, B, outputs)."""
        *hidden, last = self.layers  # a slice would make a module at every step of a solver
        for layer in hidden:
            x = self.activation(layer(x))
        return last(x)


class Standardise(nn.Module):
    """Subtracts the training set's mean and divides by its standard deviation, each input on its own.

    An input that the training set holds constant is not divided: a network before this one may vary it.
    """

    mean: Tensor
    std: Tensor

    def __init__(self, inputs: int) -> None:
        super().__init__()
        self.register_buffer("mean", torch.zeros(1, inputs))
        self.register_buffer("std", torch.ones(1, inputs))

    def fit(self, x: Tensor) -> None:
        """Take mean and standard deviation from x (N, inputs)."""
        self.mean.copy_(x.mean(0, keepdim=True).expand_as(self.mean))
        std = x.std(0, keepdim=True)
        self.std.copy_(torch.where(std > 1e-6, std, torch.ones_like(std)).expand_as(self.std))

    def forward(self, x: Tensor) -> Tensor:
        return (x - self.mean) / self.std


class GRU(nn.Module):
    """One-layer gated recurrent unit; returns the last hidden state.

    The gates have weights of their own: splitting one product into three makes autograd join three gradients at every
    step, a sixth of the whole training step's time.
    """

    def __init__(self, inputs: int, hidden: int) -> None:
        super().__init__()
        self.hidden = hidden
        self.inputs = nn.ModuleList(Linear(inputs, hidden) for _ in range(3))  # reset, update, new
        self.recurrent = nn.ModuleList(Linear(hidden, hidden, bias=k == 2) for k in range(3))
        bound = 1 / math.sqrt(hidden)
        for parameter in self.inputs.parameters():
            nn.init.uniform_(parameter, -bound, bound)

    def forward(self, x: Tensor) -> Tensor:
        """(T, …, B, inputs) → (…, B, hidden)."""
        reset_h, update_h, new_h = self.recurrent
        state = x.new_zeros(*x.shape[1:-1], self.hidden)
        flat = x.movedim(0, -3).flatten(-3, -2)  # one product for all times
        shape = (*x.shape[1:-2], len(x), *x.shape[-2:-1], self.hidden)
        # unbind, not gates[t]: autograd fills a full-size zero gradient for every slice.
        gates = zip(*(layer(flat).view(shape).unbind(-3) for layer in self.inputs), strict=True)
        for reset_in, update_in, new_in in gates:
            reset = torch.sigmoid(affine(state, reset_h.weight, reset_in))
            update = torch.sigmoid(affine(state, update_h.weight, update_in))
            new = torch.tanh(torch.addcmul(new_in, reset, new_h(state)))
            state = torch.lerp(new, state, update)
        return state

"""A fully connected network at many inputs, with the derivatives of its outputs by them.

Backpropagation from one output gives at every layer what that output changes by there.  Kept, it is the derivative by
the inputs now and, multiplied by the output's gradient, that by weights and biases later: one pass back, not two.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import torch
from torch import Tensor

from expertaug.models.networks.layers import affine

NUMBERS = 2**17  # of the widest layer at a time: what layers make of so many stays in the processor's cache


def linearised(
    x: Tensor, layers: Sequence[tuple[Tensor, Tensor]], activation: Callable[[Tensor], Tensor], outputs: Sequence[int]
) -> tuple[Tensor, Tensor]:
    """Outputs (S, N, K) of a network at inputs x (S, N, F), and ∂ output / ∂ input of R of them, (R, S, N, F), without
    a graph.  The outputs' gradients reach weights and biases, not x.

    Arguments:
        layers: weights (S, in, out) and biases (S, 1, out) or (S, N, out).
        activation: after each layer but the last, number by number.
        outputs: R of them; the gradient of others is taken for zero.
    """
    flat = [tensor for layer in layers for tensor in layer]
    return _Linearised.apply(x.detach(), activation, tuple(outputs), *flat)  # type: ignore[no-any-return]


class _Linearised(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any, x: Tensor, activation: Callable[[Tensor], Tensor], outputs: tuple[int, ...], *flat: Tensor
    ) -> tuple[Tensor, Tensor]:
        ctx.outputs, ctx.shapes, ctx.parts = outputs, [tensor.shape for tensor in flat], []
        values, slopes = [], []
        count, widest = x.shape[-2], max(tensor.shape[-1] for tensor in flat)
        each = max(1, min(count, NUMBERS // (widest * max(1, x.shape[:-2].numel()))))
        for begin in range(0, count, each):
            layers = [tensor.detach() for tensor in _part(flat, begin, each, count)]
            with torch.enable_grad():
                here = x.narrow(-2, begin, min(each, count - begin)).requires_grad_()
                seen, sums, value = [here], [], here
                for weight, bias in zip(layers[:-2:2], layers[1:-2:2], strict=True):
                    sums.append(affine(seen[-1], weight, bias))
                    seen.append(activation(sums[-1]))
                value = affine(seen[-1], layers[-2], layers[-1])
            changes = []
            for k in outputs:
                given = torch.zeros_like(value)
                given[..., k] = 1.0
                slope, *change = torch.autograd.grad(value, [here, *sums], given, retain_graph=k != outputs[-1])
                changes.append((slope, change))
            values.append(value.detach())
            slopes.append(torch.stack([slope for slope, _ in changes]))
            ctx.parts.append(([s.detach() for s in seen], [change for _, change in changes]))
        slope = torch.cat(slopes, -2)
        ctx.mark_non_differentiable(slope)
        return torch.cat(values, -2), slope

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, given: Tensor, _: Tensor) -> tuple[Tensor | None, ...]:
        wanted = ctx.needs_input_grad[3:]
        results: list[list[Tensor]] = [[] for _ in ctx.shapes]
        begin = 0
        for seen, changes in ctx.parts:
            part = given.narrow(-2, begin, seen[0].shape[-2])
            begin += seen[0].shape[-2]
            for k, before in enumerate(seen):
                by_sum = part
                if k < len(seen) - 1:
                    by_sum = changes[0][k] * part[..., ctx.outputs[0], None]
                    for change, output in zip(changes[1:], ctx.outputs[1:], strict=True):
                        by_sum = torch.addcmul(by_sum, change[k], part[..., output, None])
                if wanted[2 * k]:
                    results[2 * k].append(before.mT @ by_sum)
                if wanted[2 * k + 1]:
                    one = ctx.shapes[2 * k + 1][-2] == 1
                    results[2 * k + 1].append(by_sum.sum(-2, keepdim=True) if one else by_sum)
        count = given.shape[-2]
        joined = [
            None if not parts else torch.cat(parts, -2) if shape[-2] == count and k % 2 else sum(parts)
            for k, (parts, shape) in enumerate(zip(results, ctx.shapes, strict=True))
        ]
        return None, None, None, *joined


def _part(flat: Sequence[Tensor], begin: int, each: int, count: int) -> list[Tensor]:
    """Weights and biases, of biases that differ between inputs those of some."""
    return [
        x.narrow(-2, begin, min(each, count - begin)) if k % 2 and x.shape[-2] == count and count > 1 else x
        for k, x in enumerate(flat)
    ]

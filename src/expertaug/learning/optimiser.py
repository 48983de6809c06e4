"""Optimisation of a group of seeds: Adam, and gradients that are clipped for each seed on its own."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from inspect import unwrap

import torch
from torch import Tensor

_Adam = torch.optim.Adam
_step = unwrap(_Adam.step)


class Adam(_Adam):
    """As torch.optim.Adam, to the bit; nothing here compiles a step.

    torch's own imports its compiler for a guard against it: as much time again as importing torch itself.
    """

    add_param_group = unwrap(_Adam.add_param_group)
    zero_grad = unwrap(_Adam.zero_grad)
    state_dict = unwrap(_Adam.state_dict)
    load_state_dict = unwrap(_Adam.load_state_dict)

    @torch.no_grad()
    def step(self, closure: None = None) -> None:
        """Move the parameters by their gradients."""
        _step(self, closure)


def clip_each_seed(
    parameters: Iterable[Tensor], limit: float | None, alive: Tensor, doubts: Sequence[Tensor] = ()
) -> Tensor | None:
    """Clip each seed's gradient by its own norm; one that is not finite, or of a seed that has failed, becomes zero.

    Arguments:
        parameters: stacked, seeds first.
        limit: largest norm; None for no clipping.
        alive: which seeds (S,) have not failed.
        doubts: truth values on which the gradients rest.

    Returns:
        which seeds (S,) have a gradient that can be used, on the CPU: all that a step waits for.  None where a doubt
        was right: the gradients are then as they were.
    """
    gradients = [p.grad for p in parameters if p.grad is not None]
    norm = torch.stack([g.reshape(len(g), -1).square().sum(1) for g in gradients]).sum(0).sqrt()
    good = torch.isfinite(norm) & alive.to(norm.device, non_blocking=True)
    factor = torch.where(good, ((limit or math.inf) / norm.clamp_min(1e-12)).clamp_max(1.0), torch.zeros_like(norm))
    answers = torch.cat((good, *(doubt.reshape(1) for doubt in doubts))).cpu()
    usable = answers[: len(good)]
    if not answers[len(good) :].all():
        return None
    some = not usable.all()
    for g in gradients:
        if some:
            g.nan_to_num_(0.0, 0.0, 0.0)
        g.mul_(factor.view(-1, *[1] * (g.dim() - 1)))
    return usable

"""Forecasts that diverge: the bound beyond which one does, and the fallback, sample by sample."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from torch import Tensor

from expertaug.errors import SolveError
from expertaug.models.card import ModelCard
from expertaug.models.decoder import Decoder
from expertaug.models.hybrid import HybridNet
from expertaug.systems.solvers.solver import Solver

FACTOR = 10.0  # times the largest value of the training set
FLOOR = 1e-3  # of the largest component's bound: a component that is zero in the training set may move a little
FALLBACK = Solver("rk4")  # a fixed grid goes on where a solver with tolerances gives up
MOST_STEPS = 20  # from one time to the next; an ordinary batch of circuits, sampled every .1 s, takes half a one
PIECES = 8
PATIENCE = 4  # times as many steps for a piece: where all samples need many, few batches are solved twice
PART = 256  # samples of which sizes are found at a time
ALONE = 200  # steps of a sample alone; an oscillation of 100 rad/s, sampled every .1 s, takes 30


def divergence_bound(y: np.ndarray, start: Mapping[str, Sequence[float]] | None = None) -> list[float]:
    """The largest plausible size of each component of a state (K values), from a training set (N, T, *state), and from
    the ranges of first points where it has values that were not measured."""
    sizes = largest_sizes(torch.from_numpy(y).movedim(1, 0)).amax(0).double()
    if start is not None:
        ends = torch.tensor([[abs(float(end)) for end in ends] for ends in start.values()], dtype=sizes.dtype)
        sizes = torch.maximum(sizes, ends.amax(1))
    sizes = sizes.clamp_min(FLOOR * float(sizes.max()))
    return (FACTOR * torch.where(sizes > 0, sizes, 1.0)).tolist()


def largest_sizes(y: Tensor) -> Tensor:
    """The largest size of each component, the first axis of a state, of every sample: (T, N, *state) → (N, K)."""
    parts = y.split(PART, 1)  # what is made on the way is as large as what it is made of
    return torch.cat([part.nan_to_num().abs().amax(0).reshape(*part.shape[1:3], -1).amax(-1) for part in parts])


def bound_of_card(card: ModelCard, device: torch.device | str = "cpu") -> Tensor | None:
    """The bound (K,) that a model file has; None in files from before there was one."""
    bound = card.bound
    return None if bound is None else torch.tensor(bound, dtype=torch.float32, device=device)


def within_bound(y: Tensor, bound: Tensor | None) -> Tensor:
    """Which samples (S, B) of forecasts y (T, S, B, *state) are finite and nowhere beyond a bound (K,) or (B, K)."""
    y = y.detach()
    if bound is None:
        return torch.isfinite(y).movedim(0, 2).flatten(2).all(-1)
    # The largest size first: NaN stays NaN, which no bound admits, and a field is read once.
    return (y.abs().amax((0, *range(4, y.dim()))) <= bound.to(y)).all(-1)


def clamp_to_bound(y: Tensor, bound: Tensor | None) -> Tensor:
    """Forecasts y (T, S, B, *state) with what lies beyond the bound (K,) or (B, K), or is no number, moved to it."""
    if bound is None:
        return y
    if y.device.type == "cpu" and within_bound(y, bound).all():  # the usual case; a card would be waited for
        return y
    limit = _shape(bound, y).expand_as(y)
    return torch.where(torch.isnan(y), limit, y.clamp(-limit, limit))


def forecast_or_fallback(
    model: HybridNet | Decoder,
    y0: Tensor,
    z_e: Tensor,
    z_a: Tensor,
    t: Tensor,
    solver: Solver | BoundedSolver,
    u: Tensor | None = None,
) -> Tensor:
    """A forecast (T, S, B, *state) that never raises: a runaway is in its values instead."""
    try:
        return model.forecast(y0, z_e, z_a, t, solver, u)
    except SolveError:
        return model.forecast(y0, z_e, z_a, t, FALLBACK, u)


class BoundedSolver:
    """A solver that leaves a trajectory where it went beyond the bound: to follow one to infinity takes for ever.

    Arguments:
        solver: solves the others, to the same bits as alone.
        bound: (K,), or (B, K) for B samples or for several draws of each, in the order of the draws; None for no bound.
        most_steps: from one time to the next, beyond which an adaptive method gives up.
    """

    def __init__(self, solver: Solver, bound: Tensor | None, most_steps: int | None = None) -> None:
        self.solver, self.bound, self.splits = solver, bound, solver.splits
        self.limits = {} if most_steps is None else {"most_steps": most_steps}

    def __call__(self, f: Callable[..., Tensor], y0: Tensor, *args: Any, **named: Any) -> Tensor:
        """States (T, S, B, *state), as of :class:`Solver`."""
        named |= self.limits
        if self.bound is None:
            return self.solver(f, y0, *args, **named)
        bound = self.bound if self.bound.dim() == 1 else self.bound.repeat(y0.shape[1] // len(self.bound), 1)
        bound, on_cpu = bound.to(y0), y0.device.type == "cpu"

        def stopped(s: Tensor, y: Tensor, *side: Tensor) -> Tensor:
            sizes = y.detach().abs()
            near = (sizes.flatten(3).amax(-1) if y.dim() > 3 else sizes) <= bound  # not so of what is no number
            if on_cpu and near.all():  # the usual case; a card would be waited for
                return f(s, y, *side)
            near = near.all(-1)
            return torch.where(near.view(*near.shape, *[1] * (y.dim() - 2)), f(s, y, *side), 0.0)

        return self.solver(stopped, y0, *args, **named)


def _shape(bound: Tensor, y: Tensor) -> Tensor:
    return bound.to(y).view(*bound.shape, *[1] * (y.dim() - 4))


def solve_with_sample_fallback(
    predicted: Callable[[slice, BoundedSolver], Tensor],
    size: int,
    solver: Solver | BoundedSolver,
    bound: Tensor | None,
    axis: int = 2,
) -> tuple[Tensor, Tensor]:
    """States of ``size`` samples, and which of them (size,) the solver gave up on.

    An adaptive solver takes all samples of a batch by the steps of the one that needs the smallest, and gives up on all
    for one.  A batch that needs far more steps than others do, or cannot be solved, is taken in pieces, and each piece
    likewise; a sample alone may take more, and one for which these are too few, or that cannot be solved, is taken on
    a fixed grid.

    Arguments:
        predicted: samples and the solver to use → their states.
        bound: (K,) or (size, K), where a trajectory is left; None: nowhere.
        axis: of the samples, in the states.
    """
    if isinstance(solver, BoundedSolver):
        solver = solver.solver
    unsolved = torch.zeros(size, dtype=torch.bool)

    def solve(first: int, last: int, steps: int) -> list[Tensor]:
        part, alone = slice(first, last), last - first == 1
        limit = bound if bound is None or bound.dim() == 1 else bound[part]
        try:
            return [predicted(part, BoundedSolver(solver, limit, ALONE if alone else steps))]
        except SolveError:
            if alone:
                unsolved[first] = True
                return [predicted(part, BoundedSolver(FALLBACK, limit))]
        count = min(PIECES, last - first)
        ends = [first + (last - first) * k // count for k in range(count + 1)]
        return [states for begin, end in pairwise(ends) for states in solve(begin, end, PATIENCE * steps)]

    parts = solve(0, size, MOST_STEPS)
    states = parts[0] if len(parts) == 1 else torch.cat(parts, dim=axis)
    return states, unsolved.to(states.device)

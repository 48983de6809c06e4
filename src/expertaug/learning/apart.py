"""Samples that are solved together, and apart where one of them holds up the others."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import torch
from torch import Tensor

from expertaug.errors import SolveError
from expertaug.learning.bound import FALLBACK, Stopping
from expertaug.systems.solvers.solver import Solver

STEPS = 20  # from one time to the next; an ordinary batch of circuits, sampled every .1 s, takes half a one
PIECES = 8
PATIENCE = 4  # times as many steps for a piece: where all samples need many, few batches are solved twice
ALONE = 200  # steps of a sample alone; an oscillation of 100 rad/s, sampled every .1 s, takes 30


def solved_apart(
    predicted: Callable[[slice, Stopping], Tensor],
    size: int,
    solver: Solver | Stopping,
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
    if isinstance(solver, Stopping):
        solver = solver.solver
    unsolved = torch.zeros(size, dtype=torch.bool)

    def solve(first: int, last: int, steps: int) -> list[Tensor]:
        part, alone = slice(first, last), last - first == 1
        limit = bound if bound is None or bound.dim() == 1 else bound[part]
        try:
            return [predicted(part, Stopping(solver, limit, ALONE if alone else steps))]
        except SolveError:
            if alone:
                unsolved[first] = True
                return [predicted(part, Stopping(FALLBACK, limit))]
        count = min(PIECES, last - first)
        ends = [first + (last - first) * k // count for k in range(count + 1)]
        return [states for one, other in pairwise(ends) for states in solve(one, other, PATIENCE * steps)]

    found = solve(0, size, STEPS)
    states = found[0] if len(found) == 1 else torch.cat(found, dim=axis)
    return states, unsolved.to(states.device)

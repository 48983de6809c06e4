"""Forecasts that always end: what runs away is cut off at the bound, and counted."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from expertaug.errors import SolveError
from expertaug.learning.bound import FALLBACK, bounded, within
from expertaug.systems.solver import Solver


@dataclass(frozen=True)
class Forecast:
    """What a model says of B samples.

    Attributes:
        states: (T, S, B, *state), nowhere beyond the bound.
        z_e: estimates (S, B, P), or None where the model estimates nothing.
        runaways: (S, B), whether a forecast left the bound, was not finite, or had no solution to the tolerance.
    """

    states: Tensor
    z_e: Tensor | None
    runaways: Tensor


def forecast(
    model: nn.Module, observed: Tensor, t: Tensor, solver: Solver, start: str, bound: Tensor | None
) -> Forecast:
    """Forecast samples from their observed windows.

    Arguments:
        model: with a method ``predict``.
        observed: (T1, S, B, *state).
        t: (T,) in s.
        start: y0 or y_t1 (:meth:`HybridNet.predict`).
        bound: (K,), largest size of each component; None keeps what is not finite.
    """
    states, z_e, unsolved = _solve(model, observed, t, solver, start, bound)
    runaways = unsolved | ~within(states, bound)
    return Forecast(bounded(states, bound) if runaways.any() else states, z_e, runaways)


def _solve(
    model: nn.Module, observed: Tensor, t: Tensor, solver: Solver, start: str, bound: Tensor | None
) -> tuple[Tensor, Tensor | None, Tensor]:
    """States, estimates, and which samples (S, B) the solver gave up on.

    A solver to a tolerance gives up on a whole batch for one sample: that is found by halving the batch, and solved on
    a fixed grid.
    """
    seeds, size = observed.shape[1:3]
    try:
        states, z_e = model.predict(observed, t, solver, start)
    except SolveError:
        if size > 1:
            parts = (observed[:, :, : size // 2], observed[:, :, size // 2 :])
            solved = [_solve(model, part, t, solver, start, bound) for part in parts]
            (one, z_one, first), (other, z_other, second) = solved
            z_e = None if z_one is None else torch.cat((z_one, z_other), dim=1)
            return torch.cat((one, other), dim=2), z_e, torch.cat((first, second), dim=1)
        states, z_e = model.predict(observed, t, FALLBACK, start)
        near = within(states, bound)
        # Seeds are solved together: those that the grid shows to run away are at fault, all where it shows none.
        return states, z_e, torch.ones_like(near) if near.all() else ~near
    return states, z_e, torch.zeros(seeds, size, dtype=torch.bool, device=states.device)

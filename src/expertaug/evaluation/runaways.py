"""Forecasts that always end: what runs away is cut off at the bound, and counted."""

from __future__ import annotations

import time
from dataclasses import dataclass

import torch
from torch import Tensor

from expertaug.errors import SolveError
from expertaug.learning.bound import FALLBACK, Stopping, bounded, within
from expertaug.models.estimates import Estimates
from expertaug.models.prediction import Predictor
from expertaug.systems.solver import Solver


@dataclass(frozen=True)
class Forecast:
    """What a model says of B samples.

    Attributes:
        states: (T, S, B, *state), nowhere beyond the bound.
        found: the estimates (S, B, …) that the forecast follows from.
        runaways: (S, B), whether a forecast left the bound, was not finite, or had no solution to the tolerance.
        estimate_s: processor time of the estimates.
    """

    states: Tensor
    found: Estimates
    runaways: Tensor
    estimate_s: float


def forecast(
    model: Predictor,
    observed: Tensor,
    t: Tensor,
    solver: Solver,
    start: str,
    bound: Tensor | None,
    u: Tensor | None = None,
) -> Forecast:
    """Forecast samples from their observed windows.

    Arguments:
        model: estimates and forecasts.
        observed: (T1, S, B, *observed).
        t: (T,) in s.
        start: y0 or y_t1 (:meth:`Predictor.predicted`).
        bound: (K,) or (B, K), largest size of each component; None keeps what is not finite.
        u: known inputs (T, S, B, U) at all times; None for a system without.
    """
    before = time.process_time()
    found = model.estimate(observed)
    estimate_s = time.process_time() - before
    states, unsolved = _solve(model, found, observed, t, solver, start, bound, u)
    near = within(states, bound)
    # Seeds are solved together: those that a fixed grid shows to run away are at fault, all where it shows none.
    runaways = ~near | (unsolved & near.all(0))
    return Forecast(bounded(states, bound) if runaways.any() else states, found, runaways, estimate_s)


def _solve(
    model: Predictor,
    found: Estimates,
    observed: Tensor,
    t: Tensor,
    solver: Solver,
    start: str,
    bound: Tensor | None,
    u: Tensor | None,
) -> tuple[Tensor, Tensor]:
    """States, and which samples (B,) the solver gave up on.

    A solver to a tolerance gives up on a whole batch for one sample: that is found by halving the batch, and solved on
    a fixed grid.
    """
    size = observed.shape[2]

    def predicted(one: Solver) -> Tensor:
        stopping: Solver = one if bound is None else Stopping(one, bound)  # type: ignore[assignment]
        return model.predicted(found, observed, t, stopping, start, u)

    try:
        states = predicted(solver)
    except SolveError:
        if size == 1:
            states = predicted(FALLBACK)
            return states, torch.ones(1, dtype=torch.bool, device=states.device)
        halves = [slice(size // 2), slice(size // 2, None)]
        limits = [bound if bound is None or bound.dim() == 1 else bound[h] for h in halves]
        known = [None if u is None else u[:, :, h] for h in halves]
        (one, first), (other, second) = (
            _solve(model, found.part(h), observed[:, :, h], t, solver, start, limit, k)
            for h, limit, k in zip(halves, limits, known, strict=True)
        )
        return torch.cat((one, other), dim=2), torch.cat((first, second))
    return states, torch.zeros(size, dtype=torch.bool, device=states.device)

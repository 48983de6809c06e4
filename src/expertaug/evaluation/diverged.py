"""Forecasts that always end: what diverges is cut off at the bound, and counted."""

from __future__ import annotations

import time
from dataclasses import dataclass

from torch import Tensor

from expertaug.learning.divergence import clamp_to_bound, solve_with_sample_fallback, within_bound
from expertaug.models.posterior import Estimates, Predictor
from expertaug.systems.solvers.solver import Solver


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
    states, unsolved = solve_with_sample_fallback(
        lambda part, stopping: model.predicted(
            found.part(part), observed[:, :, part], t, stopping, start, None if u is None else u[:, :, part]
        ),
        observed.shape[2],
        solver,
        bound,
    )
    near = within_bound(states, bound)
    # Seeds are solved together: those that a fixed grid shows to run away are at fault, all where it shows none.
    runaways = ~near | (unsolved & near.all(0))
    return Forecast(clamp_to_bound(states, bound) if runaways.any() else states, found, runaways, estimate_s)

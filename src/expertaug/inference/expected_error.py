"""The squared error that fits of windows lead to expect of their forecasts: the best sign of which ones fail.

A misfit says little of that, since F_a may explain the observed window and fail behind it.  What is expected is the
mean squared distance of forecasts from draws (Laplace's approximation) to the forecast, and the variance between the
seeds' forecasts, each of which has learned another F_a.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from expertaug.inference.least_squares import LeastSquares
from expertaug.inference.posterior_predictive import forecasts, joint_draws
from expertaug.learning.divergence import bound_of_card, clamp_to_bound, solve_with_sample_fallback
from expertaug.learning.random_streams import RandomStreams
from expertaug.learning.residuals import record_residuals, squared_errors
from expertaug.models.card import MisfitRecord
from expertaug.models.posterior import Estimates
from expertaug.models.store import StoredModel
from expertaug.windows import Windows

DRAWS = 8  # of each window
KEY = 8  # of random numbers
KEPT = 200  # validation windows, at most, of which a model file keeps them
AT_A_TIME = 2**25  # bytes of drawn forecasts


@torch.no_grad()
def expected_errors(stored: StoredModel, estimates: Estimates, windows: Windows) -> tuple[Tensor, Tensor] | None:
    """Expected squared errors by each seed (S, N), and the variance of the forecasts between the seeds (N,), 0 of one,
    summed over the observed quantities and averaged over the training's times after the observed window; None of models
    that fit no windows, of systems with known inputs, and where the training's times end with the window.

    Arguments:
        stored: a model whose estimator is :class:`LeastSquares`.
        estimates: its, of the windows.
        windows: observed, y (T1, S, N, *state).
    """
    model, card = stored.model, stored.card
    if not isinstance(model, LeastSquares) or windows.u is not None or len(card.t) <= card.observed:
        return None
    device, begin = windows.y.device, card.observed
    t = torch.tensor(card.t, dtype=torch.float32, device=device)
    bound, random = bound_of_card(card, device), RandomStreams(stored.seeds, KEY, device=device)
    each = DRAWS * len(t) * windows.numbers * windows.y.element_size()
    size, within, between = max(1, AT_A_TIME // each), [], []
    for first in range(0, windows.y.shape[2], size):
        part = slice(first, first + size)
        here, seen = estimates.part(part), replace(windows.samples(part), t=t)
        states, _ = solve_with_sample_fallback(
            lambda some, solver, here=here, seen=seen: model.predicted(here.part(some), seen.samples(some), solver),
            seen.y.shape[2],
            stored.solver,
            bound,
        )
        states = clamp_to_bound(states, bound)[begin:]
        drawn = joint_draws(model, here, seen, DRAWS, random)
        assert drawn is not None, "a fit has Laplace's approximation"
        z_e, z_a, y0 = drawn
        others = forecasts(model.decoder, y0, z_e, z_a, t, stored.solver, bound)[:, begin:]
        within.append(torch.stack([squared_errors(model.system, other, states) for other in others]).mean(0))
        mean = states.mean(1, keepdim=True).expand_as(states)
        between.append(squared_errors(model.system, states, mean).sum(0) / max(states.shape[1] - 1, 1))
    return torch.cat(within, dim=1).nan_to_num(1e30, 1e30), torch.cat(between).nan_to_num(1e30, 1e30)


@torch.no_grad()
def record_misfits(stored: StoredModel, windows: Windows) -> MisfitRecord:
    """What a model file says of validation windows that all seeds share, y (T1, 1, N, *state): their misfits, and where
    windows are fitted their expected errors."""
    misfits, model = record_residuals(stored, windows), stored.model
    if not isinstance(model, LeastSquares) or windows.u is not None:
        return MisfitRecord.of(**misfits)
    index = torch.linspace(0, windows.y.shape[2] - 1, min(KEPT, windows.y.shape[2])).long()
    some = windows.samples(index.to(windows.y.device)).expand(len(stored.seeds))
    values = expected_errors(stored, model.estimate(some), some)
    if values is None:
        return MisfitRecord.of(**misfits)
    expected = [[float(f"{value:.6g}") for value in seed] for seed in values[0].tolist()]
    between = [float(f"{value:.6g}") for value in values[1].tolist()]
    return MisfitRecord.of(**misfits, expected=expected, between=between)

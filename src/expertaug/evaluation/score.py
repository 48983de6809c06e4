"""Forecasts of a set by a trained group of seeds, and their scores."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from expertaug.evaluation.expert_probe import ExpertProbe
from expertaug.evaluation.forecasting import DRAWN, DrawnScores, ExpectedError, drawing_of, forecast
from expertaug.evaluation.metrics import Outcome, values_of
from expertaug.evaluation.settings import Scoring
from expertaug.inference.posterior_predictive import z_e_draws
from expertaug.learning.divergence import bound_of_card, largest_sizes
from expertaug.learning.random_streams import RandomStreams
from expertaug.learning.residuals import squared_errors, window_residual
from expertaug.models.doubts import doubts_of
from expertaug.models.observation_noise import GivenNoise
from expertaug.models.store import StoredModel
from expertaug.models.support import outside_support
from expertaug.systems.inputs import check_given
from expertaug.trajectories import Trajectories
from expertaug.windows import Windows

CHUNK_BYTES = 2**25  # of the forecasts made at a time: bounds the memory, whatever the size of a state


@dataclass(frozen=True)
class Scored:
    """What a forecast of one set gave.

    Attributes:
        values: metric → (S,).
        index: samples whose forecasts are kept, (K,).
        prediction: these forecasts, (S, K, T, *state).
        z_e: estimates (S, N, P), or None where the model estimates nothing.
        stated, stated_std: z_e and, of the true equation, z_a, (S, N, K), and their standard deviations, where there
            are any.
        errors: squared error of every sample (S, N), as of :func:`squared_errors`; NaN of seeds that failed.
        median: squared error of the median over the seeds that could be trained, (N,), where there are several.
        draws: of z_e (S, N, K, P), where the estimator has a distribution.
        misfit: the same over the observed window after its first point, which needs no truth.
        expected, moved: what is expected of the errors, and of the encoder's (:class:`ExpectedError`), each (S, N),
            where it is.
        drawn: scores of forecasts from draws, where there are any.
        band: of the kept forecasts, (2, S, K, T, *state): ends of the 90 % band.
    """

    values: Mapping[str, Tensor]
    index: np.ndarray
    prediction: Tensor
    z_e: Tensor | None
    errors: Tensor
    misfit: Tensor
    expected: Tensor | None
    moved: Tensor | None
    median: Tensor | None
    draws: Tensor | None
    drawn: DrawnScores | None = None
    band: Tensor | None = None
    stated: Tensor | None = None
    stated_std: Tensor | None = None

    def of_seeds(self, seeds: Sequence[int]) -> Iterator[tuple[str, int, float]]:
        """Metric, seed and value."""
        for metric, value in self.values.items():
            yield from ((metric, seed, float(value[k])) for k, seed in enumerate(seeds))


def kept_of(count: int, keep: int) -> np.ndarray:
    """Which of a set's samples are kept, each once, evenly spread."""
    return np.arange(count) if count <= keep else np.linspace(0, count - 1, keep + 2)[1:-1].astype(int)


@torch.no_grad()
def score(
    stored: StoredModel,
    truth: Trajectories,
    scoring: Scoring,
    start: str,
    device: torch.device,
    keep: int = 0,
    noise: GivenNoise = 0.0,
) -> Scored:
    """Forecast a set, part by part, and score it; seeds that could not be trained have NaN.

    A forecast that runs away counts with the error that it has at the bound, and in ``runaway_share``.  ``estimate_ms``
    is the processor time in which one seed estimates one window's parameters, all windows at once.

    Arguments:
        scoring: how; which samples of the set are scored is the caller's.
        start: y0 or y_t1 (:meth:`Predictor.predicted`).
        keep: number of forecasts to keep, evenly spread.
        noise: standard deviation of the data's noise, which drawn forecasts get too.
    """
    system, observed, seeds = stored.model.system, stored.card.observed, len(stored.seeds)
    drawing = drawing_of(stored, scoring, noise, truth.t, start, device)
    t, begin, solver = drawing.t, drawing.begin, drawing.solver
    bound = bound_of_card(stored.card, device)
    if bound is not None:  # what turns at one speed goes as far as the time is long
        bound = bound * max(1.0, float(truth.t[-1]) / stored.card.t[-1])
    index = kept_of(len(truth), keep)
    check_given(system, None if truth.u is None else torch.from_numpy(truth.u), "set")
    size = max(1, CHUNK_BYTES // (seeds * truth.y[0].nbytes))
    late, early, after, estimates, kept, runaways, drawn, estimate_s = [], [], [], [], [], [], [], 0.0
    trained, medians = [k for k, seed in enumerate(stored.seeds) if seed not in stored.failed], []
    of_truth, stated = bool(stored.card.truth), []
    outside, doubtful, probe = [], [], ExpertProbe(stored.model, drawing, len(truth))
    few = min(drawing.count, scoring.expected_draws)
    expected = ExpectedError(stored.model, replace(drawing, count=few))
    chosen = np.linspace(0, len(truth) - 1, min(scoring.drawn_samples, len(truth))).astype(int)
    scores, bands, random = [], [], RandomStreams(stored.seeds, DRAWN, device=device)
    seen, of = truth.seen, truth.trajectories
    for first in range(0, len(truth), size):
        y = torch.from_numpy(seen[first : first + size]).to(device).movedim(1, 0).unsqueeze(1)
        # To follow the truth is not to diverge.
        limit = None if bound is None else torch.maximum(bound, largest_sizes(y[:, 0]))
        u = None
        if truth.u is not None:
            u = torch.from_numpy(truth.u[first : first + size]).to(device).movedim(1, 0).unsqueeze(1)
        whole = Windows(t, y, u, None if of is None else of[first : first + size])
        whole = (whole if u is None else whole.contiguous()).expand(seeds)  # rounding depends on how they lie
        forecasts = forecast(stored.model, whole.observed(observed), solver, start, limit)
        late.append(squared_errors(system, forecasts.states[begin:], y[begin:]).cpu())
        if len(trained) > 1:
            median = median_of_seeds(forecasts.states[begin:, trained])
            medians.append(squared_errors(system, median, y[begin:])[0].cpu())
        early.append(window_residual(system, forecasts.states, y[:observed]).cpu())
        expected.add(forecasts, whole, limit)
        if begin < observed:
            after.append(squared_errors(system, forecasts.states[observed:], y[observed:]).cpu())
        here = index[(index >= first) & (index < first + size)] - first
        kept.append(forecasts.states[:, :, here].cpu())
        runaways.append(forecasts.runaways.cpu())
        estimate_s += forecasts.estimate_s
        beyond = outside_support(system, stored.card, forecasts.found)
        outside += [] if beyond is None else [beyond]
        doubts = doubts_of(system, stored.card, forecasts.found)
        doubtful += [] if doubts is None else [doubts.any]
        if forecasts.found.z_e is not None and stored.model.knows_z_e:
            estimates.append(forecasts.found.z_e.cpu())
            stated.append(forecasts.found.stated(of_truth))
            of_each = z_e_draws(forecasts.found)
            drawn += [] if of_each is None else [of_each.cpu()]
        probe.add(forecasts, whole, truth.z_e[first : first + size], limit, first)
        if drawing.count and forecasts.found.z_e is not None:
            places = chosen[(chosen >= first) & (chosen < first + size)] - first
            for wanted, made, at in ((drawing.scores, scores, places), (drawing.band, bands, here)):
                some = torch.from_numpy(at).to(device)
                bounds = limit if limit is None or limit.dim() == 1 else limit[some]
                part = forecasts.found.part(some), whole.samples(some)
                result = wanted(stored.model, *part, bounds, random) if len(at) else None
                made += [] if result is None else [result]
    errors = torch.cat(late, dim=1)
    misfit = torch.cat(early, dim=1)
    z_e = torch.cat(estimates, dim=1) if estimates else None
    of_draws = DrawnScores.joined(scores)
    outcome = Outcome(
        system,
        errors,
        misfit,
        torch.cat(after, dim=1) if after else None,
        torch.cat(runaways, dim=1),
        None if forecasts.found.z_e is None else 1000 * estimate_s / (seeds * len(truth)),
        z_e,
        torch.from_numpy(truth.z_e).unsqueeze(0),
        None if of_draws is None else of_draws.averages(),
        torch.cat(outside, dim=1) if outside else None,
        torch.cat(doubtful, dim=1) if doubtful else None,
        *probe.joined(),
    )
    failed = torch.tensor([seed in stored.failed for seed in stored.seeds])
    values = {name: value.masked_fill(failed, math.nan) for name, value in values_of(outcome).items()}
    errors, misfit = (each.masked_fill(failed.unsqueeze(1), math.nan) for each in (errors, misfit))
    return Scored(
        values,
        index,
        torch.cat(kept, dim=2).movedim(0, 2),
        z_e,
        errors,
        misfit,
        *expected.joined(),
        torch.cat(medians) if medians else None,
        torch.cat(drawn, dim=1) if drawn else None,
        of_draws,
        torch.cat(bands, dim=3).movedim(1, 3).cpu() if bands else None,
        *(_together([pair[k] for pair in stated]) for k in range(2)),
    )


def median_of_seeds(states: Tensor) -> Tensor:
    """The median of each number over seeds, (T, S, N, *state): (T, 1, N, *state); of an even number of them the mean of
    the middle two."""
    ordered, seeds = states.sort(1).values, states.shape[1]
    return (ordered[:, (seeds - 1) // 2] + ordered[:, seeds // 2]).unsqueeze(1) / 2


def _together(parts: Sequence[Tensor | None]) -> Tensor | None:
    """Parts (S, B, K) of a set as one; None where there are none."""
    tensors = [part.cpu() for part in parts if part is not None]
    return torch.cat(tensors, dim=1) if tensors and len(tensors) == len(parts) else None

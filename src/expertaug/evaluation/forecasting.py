"""Forecasts that always end, what diverges being cut off at the bound and counted; and what a version's distribution
over forecasts is worth, on data and on windows of its own making: CRPS, energy score, coverage of its bands, and the
error that it expects of each forecast."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from expertaug.evaluation.forecasts import SetForecasts
from expertaug.evaluation.settings import Scoring
from expertaug.inference.diagnostics.calibration import TABLE_LEVELS, calibration, inside, ranks
from expertaug.inference.diagnostics.scores import crps, energy_score
from expertaug.inference.posterior_predictive import forecasts, joint_draws, z_e_draws
from expertaug.inference.settings import OwnWindows
from expertaug.inference.simulations import draw_simulations
from expertaug.learning.divergence import bound_of_card, clamp_to_bound, solve_with_sample_fallback, within_bound
from expertaug.learning.random_streams import RandomStreams
from expertaug.learning.residuals import squared_errors
from expertaug.models import store
from expertaug.models.hybrid import HybridNet
from expertaug.models.observation_noise import GivenNoise, NoiseLike, is_some, noise_of, shape_as_state
from expertaug.models.posterior import Estimates, Predictor
from expertaug.models.store import StoredModel
from expertaug.systems import System
from expertaug.systems.solvers.solver import Solver
from expertaug.trajectories import Trajectories
from expertaug.windows import Windows

DRAWN = 4  # of the keys of random numbers: a flow's end in 3
BYTES = 2**25  # of the forecasts that are scored at a time
BAND = (0.05, 0.95)  # of a figure's
KEY = 7  # of random numbers


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
    windows: Windows,
    solver: Solver,
    start: str,
    bound: Tensor | None,
) -> Forecast:
    """Forecast samples from their observed windows.

    Arguments:
        model: estimates and forecasts.
        windows: observed, y (T1, S, B, *state), with all times of the forecast and the known inputs then.
        start: y0 or y_t1 (:meth:`Predictor.predicted`).
        bound: (K,) or (B, K), largest size of each component; None keeps what is not finite.
    """
    before = time.process_time()
    estimates = model.estimate(windows)
    estimate_s = time.process_time() - before
    states, unsolved = solve_with_sample_fallback(
        lambda part, stopping: model.predicted(estimates.part(part), windows.samples(part), stopping, start),
        windows.y.shape[2],
        solver,
        bound,
    )
    near = within_bound(states, bound)
    # Seeds are solved together: those that a fixed grid shows to run away are at fault, all where it shows none.
    runaways = ~near | (unsolved & near.all(0))
    return Forecast(clamp_to_bound(states, bound) if runaways.any() else states, estimates, runaways, estimate_s)


@dataclass(frozen=True)
class DrawnScores:
    """Scores of the forecasts from draws, of M windows each, averaged over times and observed quantities; NaN of a
    window of which nothing was measured then.

    Attributes:
        crps: (S, M), in the mixed unit of the observed quantities.
        energy: (S, M), of their vector at each time.
        inside: shares of times and quantities at which the truth lies in the central intervals, (S, M, L).
    """

    crps: np.ndarray
    energy: np.ndarray
    inside: np.ndarray

    @staticmethod
    def joined(parts: Sequence[DrawnScores]) -> DrawnScores | None:
        """Those of parts of a set, one after the other; None of none."""
        if not parts:
            return None
        names = ("crps", "energy", "inside")
        return DrawnScores(*(np.concatenate([getattr(part, name) for part in parts], axis=1) for name in names))

    def averages(self) -> dict[str, Any]:
        """Means over windows by metric, each (S,); coverage in % by level."""
        scored, each = ~np.isnan(self.crps).any(0), (self.crps, self.energy, self.inside)
        means, energy, held = each if scored.all() else (values[:, scored] for values in each)
        levels = {f"{100 * level:.0f}": 100 * held[..., k].mean(1) for k, level in enumerate(TABLE_LEVELS)}
        return {"crps": means.mean(1), "energy_score": energy.mean(1), "forecast_coverage": levels}


@dataclass(frozen=True)
class Drawing:
    """How forecasts are drawn.

    Attributes:
        count: K, draws of each window.
        noise: standard deviation of the data's noise, which drawn forecasts get too: they are compared with data.
        seeds: of the group.
        t: times in s, (T,).
        begin: the first point that is scored.
        observed: points of the observed window.
        start: y0 or y_t1 (:meth:`Predictor.predicted`).
        solver: of the forecasts.
        draws_solver: of the drawn ones.
    """

    count: int
    noise: NoiseLike
    seeds: Sequence[int]
    t: Tensor
    begin: int
    observed: int
    start: str
    solver: Solver
    draws_solver: Solver

    def states(
        self, model: Predictor, estimates: Estimates, windows: Windows, bound: Tensor | None, random: RandomStreams
    ) -> Tensor | None:
        """Forecasts (K, T', S, B, *state) from draws, from the point ``begin`` on; None of a version without any.

        Arguments:
            estimates: the model's, of the windows.
            windows: y (T, S, B, *state), of which the observed points are used, and all known inputs.
            bound: (C,) or (B, C), how far they may go.
        """
        observed = windows.observed(self.observed)
        drawn = joint_draws(model, estimates, observed, self.count, random)
        if drawn is None:
            return None
        z_e, z_a, y0 = drawn
        first, u = 0, windows.u
        if self.start != "y0" and not observed.has_gaps:  # as Predictor.predicted
            first = min(self.observed - 1, self.begin)
        if first:
            y0 = model.state_of(windows.y[first]).expand_as(y0)
        decoder = model.decoder  # type: ignore[attr-defined]
        later = None if u is None else u[first:]
        states = forecasts(decoder, y0, z_e, z_a, self.t[first:], self.draws_solver, bound, later)
        return states[:, self.begin - first :]

    def scores(
        self, model: Predictor, estimates: Estimates, windows: Windows, bound: Tensor | None, random: RandomStreams
    ) -> DrawnScores | None:
        """Scores of windows, y (T, S, B, *state), a part of them at a time; arguments as of :meth:`states`."""
        each = self.count * len(self.t) * windows.numbers * windows.y.element_size()
        size, parts, system = max(BYTES // each, 1), [], model.system  # type: ignore[attr-defined]
        for k in range(0, windows.y.shape[2], size):
            part = slice(k, k + size)
            limit = bound if bound is None or bound.dim() == 1 else bound[part]
            states = self.states(model, estimates.part(part), windows.samples(part), limit, random)
            if states is None:
                return None
            if is_some(self.noise):  # (S, K, T', B, *state): a seed's numbers do not depend on the seeds beside it
                shape = (states.shape[0], states.shape[1], *states.shape[3:])
                drawn = random.normal(*shape).movedim(0, 2).to(states)
                states = states + shape_as_state(self.noise, states, system) * drawn
            parts.append(self._scored(system, states, windows.y[self.begin :, :, part]))
        return DrawnScores.joined(parts)

    def _scored(self, system: System, states: Tensor, y: Tensor) -> DrawnScores:
        drawn = system.observe(states).flatten(4).movedim(1, 3).double().cpu().numpy()  # (K, S, B, T', D)
        true = system.observe(y).flatten(3).movedim(0, 2).double().cpu().numpy()  # (S, B, T', D)
        measured = ~np.isnan(true)
        if not measured.all():  # where draws and truth are alike, a vector's distance is that of its other components
            drawn, true = np.where(measured, drawn, 0.0), np.where(measured, true, 0.0)
        each = ([], [], [])
        for k, mask in enumerate(measured):
            held = inside(ranks(drawn[:, k], true[k]), self.count, TABLE_LEVELS)
            each[0].append(_mean_where(mask, crps(drawn[:, k], true[k]), (1, 2)))
            each[1].append(_mean_where(mask.any(-1), energy_score(drawn[:, k], true[k]), 1))
            each[2].append(_mean_where(np.broadcast_to(mask, held.shape), held, (2, 3)).T)
        return DrawnScores(*(np.stack(scores) for scores in each))

    def band(
        self, model: Predictor, estimates: Estimates, windows: Windows, bound: Tensor | None, random: RandomStreams
    ) -> Tensor | None:
        """The ends of the 90 % band of each state, without noise, (2, T', S, B, *state); None of fields, of which no
        figure has one."""
        if len(model.system.state_shape) > 1:  # type: ignore[attr-defined]
            # Drawn all the same: later windows' numbers follow.
            joint_draws(model, estimates, windows.observed(self.observed), self.count, random)
            return None
        states = self.states(model, estimates, windows, bound, random)
        if states is None:
            return None
        return torch.quantile(states, torch.tensor(BAND).to(states), dim=0)


def drawing_of(
    stored: store.StoredModel, scoring: Scoring, noise: GivenNoise, t: np.ndarray, start: str, device: torch.device
) -> Drawing:
    """How forecasts over the times t (T,) are made, scored and drawn; arguments as of the stage's ``score``."""
    observed, begin, system = stored.card.observed, scoring.from_s, stored.model.system
    solver = store.accurate(system) if scoring.solver is None else Solver(**dict(scoring.solver))
    return Drawing(
        count=scoring.draws,
        noise=noise_of(noise, system, stored.card),
        seeds=stored.seeds,
        t=torch.from_numpy(t).float().to(device),
        begin=observed if begin is None else int(np.searchsorted(t, begin - 1e-9)),
        observed=observed,
        start=start,
        solver=solver,
        draws_solver=solver if scoring.draws_solver is None else Solver(**dict(scoring.draws_solver)),
    )


def _mean_where(measured: np.ndarray, values: np.ndarray, axes: int | tuple[int, ...]) -> np.ndarray:
    """Mean over axes of what was measured; NaN where nothing was."""
    if measured.all():
        return values.mean(axes)
    count = measured.sum(axes)
    return np.where(measured, values, 0.0).sum(axes) / np.where(count > 0, count, np.nan)


class ExpectedError:
    """What a version expects of its own forecasts, and, of refined ones, what they expect of the encoder's.

    The first is the mean squared distance of forecasts from draws to the forecast, where a version has a distribution;
    the second the squared distance between the forecasts before and after refinement.

    Arguments:
        model: whose forecasts they are.
        drawing: how forecasts are drawn, and how many of each window; a count of 0 leaves the first out.
    """

    def __init__(self, model: Predictor, drawing: Drawing) -> None:
        self.model, self.drawing = model, drawing
        self.random = RandomStreams(drawing.seeds, KEY, device=drawing.t.device)
        self.moved: list[Tensor] = []
        self.expected: list[Tensor] = []

    def add(self, made: Forecast, windows: Windows, bound: Tensor | None) -> None:
        """Of further windows.

        Arguments:
            made: their forecasts.
            windows: y (T, S, B, *state), of which the observed points are used, and all known inputs.
            bound: (C,) or (B, C), how far forecasts may go.
        """
        drawing, begin = self.drawing, self.drawing.begin
        first = getattr(self.model, "first", None)
        if isinstance(first, HybridNet):
            observed = windows.observed(drawing.observed)
            before = forecast(first, observed, drawing.solver, drawing.start, bound)
            self.moved.append(squared_errors(self.model.system, before.states[begin:], made.states[begin:]).cpu())
        if drawing.count and made.found.z_e is not None:
            self._add_own(made, windows, bound)

    def _add_own(self, made: Forecast, windows: Windows, bound: Tensor | None) -> None:
        drawing = self.drawing
        each = windows.points * windows.numbers * windows.y.element_size()
        size = max(BYTES // (drawing.count * each), 1)
        for k in range(0, windows.y.shape[2], size):
            part = slice(k, k + size)
            limit = bound if bound is None or bound.dim() == 1 else bound[part]
            drawn = drawing.states(self.model, made.found.part(part), windows.samples(part), limit, self.random)
            if drawn is None:
                return
            states = made.states[drawing.begin :, :, part]
            self.expected.append(
                torch.stack([squared_errors(self.model.system, draw, states) for draw in drawn]).mean(0).cpu()
            )

    def joined(self) -> tuple[Tensor | None, Tensor | None]:
        """What is expected of forecasts, and of the encoder's, each (S, N); None where it is not."""
        expected, moved = (torch.cat(parts, dim=1) if parts else None for parts in (self.expected, self.moved))
        return expected, moved


def score_draws(z_e: np.ndarray, draws: Tensor | None, scores: DrawnScores | None) -> SetForecasts:
    """Where the true z_e, (N, P) or each seed's own (S, N, P), lies among draws (S, N, K, P), no ranks where a true one
    is not known; and what the drawn forecasts are worth."""
    ranks_of_z_e = tarp = None
    if draws is not None and z_e.shape[-1] and not np.isnan(z_e).any():
        true = np.broadcast_to(z_e, (len(draws), *z_e.shape[-2:]))
        pairs = zip(draws, true, strict=True)
        each = [calibration(seed_draws.movedim(1, 0).double().nan_to_num().numpy(), own) for seed_draws, own in pairs]
        ranks_of_z_e, tarp = (
            np.stack([seed_ranks.marginal for seed_ranks in each]),
            np.stack([seed_ranks.tarp for seed_ranks in each]),
        )
    crps_and_inside = (None, None) if scores is None else (scores.crps, scores.inside)
    return SetForecasts(ranks=ranks_of_z_e, tarp=tarp, crps=crps_and_inside[0], inside=crps_and_inside[1])


@torch.no_grad()
def of_simulations(
    stored: StoredModel, train: Trajectories, own: OwnWindows, noise: GivenNoise, count: int, drawing: Drawing
) -> tuple[SetForecasts | None, int]:
    """Ranks and scores on ``count`` windows that each seed's model has made, None where all have run away; and the
    number of draws among which the ranks are.

    Arguments:
        own, noise: as of :func:`draw_simulations`.
        drawing: how forecasts are drawn and scored.
    """
    device = drawing.t.device
    windows, z_e = draw_simulations(stored, Windows.of(train, device), own, noise, count)
    if not windows.y.shape[2]:
        return None, 0
    estimates = stored.model.estimate(windows.until(drawing.observed))
    draws = z_e_draws(estimates)
    bound, random = bound_of_card(stored.card, device), RandomStreams(stored.seeds, DRAWN, device=device)
    scores = drawing.scores(stored.model, estimates, windows, bound, random)
    each = None if draws is None else draws.cpu()
    return score_draws(z_e.cpu().numpy(), each, scores), 0 if each is None else each.shape[2]

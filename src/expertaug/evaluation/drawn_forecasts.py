"""What a version's distribution over forecasts is worth, on data and on windows of its own making: CRPS, energy score,
coverage of its bands, and the error that it expects of each forecast."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from expertaug.evaluation.diverged import Forecast, forecast
from expertaug.evaluation.samples import CRPS, EXPECTED, INSIDE, MOVED, OWN, ranks_of
from expertaug.inference.diagnostics.calibration import TABLE_LEVELS, inside, ranks
from expertaug.inference.diagnostics.scores import crps, energy_score
from expertaug.inference.posterior_predictive import forecasts, joint_draws, z_e_draws
from expertaug.inference.simulations import own_draws
from expertaug.learning.divergence import bound_of_card
from expertaug.learning.random_streams import RandomStreams
from expertaug.learning.residuals import squared_errors
from expertaug.learning.training_data import StackedSet
from expertaug.models import store
from expertaug.models.hybrid import HybridNet
from expertaug.models.observation_noise import NoiseLike, is_some, noise_of, shaped
from expertaug.models.posterior import Estimates, Predictor
from expertaug.models.store import StoredModel
from expertaug.systems import System
from expertaug.systems.inputs import inputs_of, states_of
from expertaug.systems.solvers.solver import Solver
from expertaug.trajectories import Trajectories

DRAWN = 4  # of the keys of random numbers: a flow's end in 3
BYTES = 2**25  # of the forecasts that are scored at a time
BAND = (0.05, 0.95)  # of a figure's


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
        return DrawnScores(*(np.concatenate([getattr(one, name) for one in parts], axis=1) for name in names))

    def arrays(self, name: str) -> dict[str, np.ndarray]:
        """Of a forecasts.npz: <set>_crps (S, M) and <set>_inside (S, M, L)."""
        return {f"{name}_{CRPS}": self.crps, f"{name}_{INSIDE}": self.inside}

    def averages(self) -> dict[str, Any]:
        """Means over windows by metric, each (S,); coverage in % by level."""
        told, each = ~np.isnan(self.crps).any(0), (self.crps, self.energy, self.inside)
        means, energy, held = each if told.all() else (one[:, told] for one in each)
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
        self, model: Predictor, found: Estimates, y: Tensor, bound: Tensor | None, random: RandomStreams
    ) -> Tensor | None:
        """Forecasts (K, T', S, B, *state) from draws, from the point ``begin`` on; None of a version without any.

        Arguments:
            found: the model's estimates of the windows.
            y: (T, S, B, *observed), of which the observed points are used, and all known inputs.
            bound: (C,) or (B, C), how far they may go.
        """
        drawn = joint_draws(model, found, y[: self.observed], self.count, random)
        if drawn is None:
            return None
        z_e, z_a, y0 = drawn
        system, first = model.system, 0  # type: ignore[attr-defined]
        seen, u = states_of(system, y), inputs_of(system, y)
        if self.start != "y0" and not torch.isnan(seen[: self.observed]).any():  # as Predictor.predicted
            first = min(self.observed - 1, self.begin)
        if first:
            y0 = seen[first].expand_as(y0)
        decoder = model.decoder  # type: ignore[attr-defined]
        later = None if u is None else u[first:]
        states = forecasts(decoder, y0, z_e, z_a, self.t[first:], self.draws_solver, bound, later)
        return states[:, self.begin - first :]

    def scores(
        self, model: Predictor, found: Estimates, y: Tensor, bound: Tensor | None, random: RandomStreams
    ) -> DrawnScores | None:
        """Scores of the windows y (T, S, B, *observed), a part of them at a time; arguments as of :meth:`states`."""
        each = self.count * len(self.t) * y[0, 0, 0].numel() * y.element_size()
        size, parts, system = max(BYTES // each, 1), [], model.system  # type: ignore[attr-defined]
        for k in range(0, y.shape[2], size):
            part = slice(k, k + size)
            limit = bound if bound is None or bound.dim() == 1 else bound[part]
            states = self.states(model, found.part(part), y[:, :, part], limit, random)
            if states is None:
                return None
            if is_some(self.noise):  # (S, K, T', B, *state): a seed's numbers do not depend on the seeds beside it
                shape = (states.shape[0], states.shape[1], *states.shape[3:])
                states = states + shaped(self.noise, states, system) * random.normal(*shape).movedim(0, 2).to(states)
            parts.append(self._scored(system, states, states_of(system, y[self.begin :, :, part])))
        return DrawnScores.joined(parts)

    def _scored(self, system: System, states: Tensor, y: Tensor) -> DrawnScores:
        drawn = system.observe(states).flatten(4).movedim(1, 3).double().cpu().numpy()  # (K, S, B, T', D)
        true = system.observe(y).flatten(3).movedim(0, 2).double().cpu().numpy()  # (S, B, T', D)
        known = ~np.isnan(true)
        if not known.all():  # where draws and truth are alike, a vector's distance is that of its other components
            drawn, true = np.where(known, drawn, 0.0), np.where(known, true, 0.0)
        each = ([], [], [])
        for k, told in enumerate(known):
            held = inside(ranks(drawn[:, k], true[k]), self.count, TABLE_LEVELS)
            each[0].append(_mean_where(told, crps(drawn[:, k], true[k]), (1, 2)))
            each[1].append(_mean_where(told.any(-1), energy_score(drawn[:, k], true[k]), 1))
            each[2].append(_mean_where(np.broadcast_to(told, held.shape), held, (2, 3)).T)
        return DrawnScores(*(np.stack(one) for one in each))

    def band(
        self, model: Predictor, found: Estimates, y: Tensor, bound: Tensor | None, random: RandomStreams
    ) -> Tensor | None:
        """The ends of the 90 % band of each state, without noise, (2, T', S, B, *state)."""
        states = self.states(model, found, y, bound, random)
        if states is None:
            return None
        return torch.quantile(states, torch.tensor(BAND).to(states), dim=0)


def drawing_of(stored: store.StoredModel, options: Mapping, t: np.ndarray, start: str, device: torch.device) -> Drawing:
    """How forecasts over the times t (T,) are made, scored and drawn; ``options`` as of the stage's ``score``."""
    observed, begin, system = stored.card.observed, options.get("from_s"), stored.model.system
    solver = options.get("solver") or store.accurate(system)
    return Drawing(
        count=int(options.get("draws", 0)),
        noise=noise_of(options.get("noise", 0.0), system, stored.card),
        seeds=stored.seeds,
        t=torch.from_numpy(t).float().to(device),
        begin=observed if begin is None else int(np.searchsorted(t, begin - 1e-9)),
        observed=observed,
        start=start,
        solver=Solver.from_mapping(solver),
        draws_solver=Solver.from_mapping(options.get("draws_solver") or solver),
    )


def _mean_where(known: np.ndarray, values: np.ndarray, axes: int | tuple[int, ...]) -> np.ndarray:
    """Mean over axes of what was measured; NaN where nothing was."""
    if known.all():
        return values.mean(axes)
    count = known.sum(axes)
    return np.where(known, values, 0.0).sum(axes) / np.where(count > 0, count, np.nan)


KEY = 7  # of random numbers


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
        self.found: dict[str, list[Tensor]] = {}

    def add(self, made: Forecast, y: Tensor, windows: Tensor, bound: Tensor | None, u: Tensor | None) -> None:
        """Of further windows.

        Arguments:
            made: their forecasts.
            y: (T, S, B, *observed), of which the observed points are used, and all known inputs.
            windows: observed, (T1, S, B, *observed).
            bound: (C,) or (B, C), how far forecasts may go.
            u: known inputs (T, S, B, U); None for a system without.
        """
        drawing, begin = self.drawing, self.drawing.begin
        first = getattr(self.model, "first", None)
        if isinstance(first, HybridNet):
            before = forecast(first, windows, drawing.t, drawing.solver, drawing.start, bound, u)
            self._keep(MOVED, squared_errors(self.model.system, before.states[begin:], made.states[begin:]))
        if drawing.count and made.found.z_e is not None:
            self._add_own(made, y, bound)

    def _add_own(self, made: Forecast, y: Tensor, bound: Tensor | None) -> None:
        drawing = self.drawing
        size = max(BYTES // (drawing.count * y[:, 0, 0].numel() * y.element_size()), 1)
        for k in range(0, y.shape[2], size):
            part = slice(k, k + size)
            limit = bound if bound is None or bound.dim() == 1 else bound[part]
            drawn = drawing.states(self.model, made.found.part(part), y[:, :, part], limit, self.random)
            if drawn is None:
                return
            states = made.states[drawing.begin :, :, part]
            self._keep(EXPECTED, torch.stack([squared_errors(self.model.system, one, states) for one in drawn]).mean(0))

    def _keep(self, name: str, values: Tensor) -> None:
        self.found.setdefault(name, []).append(values.cpu())

    def joined(self) -> dict[str, Tensor]:
        """By the name of the array, (S, N)."""
        return {name: torch.cat(parts, dim=1) for name, parts in self.found.items()}


@torch.no_grad()
def of_own_windows(
    stored: StoredModel, train: Trajectories, settings: Mapping, count: int, drawing: Drawing
) -> dict[str, np.ndarray]:
    """Ranks and scores on ``count`` windows that each seed's model has made, as of a set called own.

    Arguments:
        settings: as of :func:`own_draws`.
        drawing: how forecasts are drawn and scored.
    """
    device = drawing.t.device
    y, z_e = own_draws(stored, StackedSet.of(train, device).windows(len(train.t))[:, 0], settings, count)
    if not y.shape[2]:
        return {}
    found = stored.model.estimate(y[: drawing.observed])
    draws = z_e_draws(found)
    bound, random = bound_of_card(stored.card, device), RandomStreams(stored.seeds, DRAWN, device=device)
    scores = drawing.scores(stored.model, found, y, bound, random)
    each = None if draws is None else draws.cpu()
    return ranks_of(OWN, z_e.cpu().numpy(), each) | ({} if scores is None else scores.arrays(OWN))

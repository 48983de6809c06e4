"""Least squares of (z_e, z_a, y0) on observed windows through a decoder, and the estimators made of it.

A window's problem (:mod:`expertaug.inference.window_problem`) is solved from several starts by Levenberg and
Marquardt's method (:class:`WindowFit`): with the expert alone, or refining what a trained model estimates
(:class:`LeastSquares`).
"""

from __future__ import annotations

import copy
import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor, nn

from expertaug.errors import InputError
from expertaug.inference.coordinates import (
    LatentCoordinates,
)
from expertaug.inference.levenberg_marquardt import LARGEST, Minimum, cost_of, minimise, of_columns
from expertaug.inference.population import PopulationPull, overdispersion
from expertaug.inference.window_problem import MEMORY, WindowProblem, assumed_noise
from expertaug.learning.random_streams import RandomStreams
from expertaug.models.decoder import Decoder
from expertaug.models.fit_settings import Constant, Population, Refinement, RefinementSettings, SensorConstants
from expertaug.models.observation_noise import GivenNoise, is_some, noise_of
from expertaug.models.posterior import Estimates, Estimator, Gaussian, Posterior, Predictor, log_slope, unconstrain
from expertaug.models.sensors import Sensors, check_components
from expertaug.models.store import StoredModel
from expertaug.settings import given_ranges
from expertaug.systems import System
from expertaug.systems.settings import FIXED
from expertaug.systems.solvers.solver import Solver
from expertaug.trajectories import Trajectories
from expertaug.windows import Windows
from expertaug.wording import check_keys

logger = logging.getLogger(__name__)
TOLD = 32  # training windows at most, that tell how much residuals tell
CHECKED = 16  # windows at most, of which the steps are checked
WIDEST = 3.0  # of Laplace's approximation in any direction of the coordinates: far from the fit it says nothing


class WindowFit(WindowProblem):
    """Estimates of (z_e, z_a, y0) for each window, by the least squared residuals of its observed points."""

    steps_checked = False

    @torch.no_grad()
    def __call__(self, windows: Tensor, first: Estimates | None = None) -> Estimates:
        """Fit windows (T1, S, B, *observed), also from the first estimates (…, S, B) where there are some.

        The fits run on the CPU, in double precision, wherever the windows lie.
        """
        here = windows.cpu()
        first = None if first is None else first.to(here)
        free = sum(self.sizes)
        if self.grid is None and first is None:
            raise InputError("refinement.starts", "found 0", "least squares needs a range of starts, or a model's")
        each = windows[:, :, :1].numel() * 8 * (free + 1)
        size = max(1, MEMORY // max(each, 1))
        parts = [
            self._fit(here[:, :, k : k + size].double(), None if first is None else first.part(slice(k, k + size)))
            for k in range(0, windows.shape[2], size)
        ]
        estimates = Estimates.joined(parts)
        self._check_steps(estimates, here)
        return estimates.to(windows)

    def _check_steps(self, estimates: Estimates, windows: Tensor) -> None:
        """Warn, once, where steps half as long move what noisy windows are compared with so far that the estimates of a
        quarter of them may be off by their standard error: by so much in units of the noise, all points together."""
        if self.steps_checked or not self.transform.start.size or self.solver.method not in FIXED:
            return
        if self.system.has_events:
            return
        self.steps_checked = True
        few = torch.linspace(0, windows.shape[2] - 1, min(CHECKED, windows.shape[2])).long()
        some = windows[:, :, few].double()
        x = self.coordinates(estimates.part(few), self.first(some))
        finer = copy.copy(self)
        over = self.solver.points_per_step
        half = {"points_per_step": over // 2} if over > 1 else {"substeps": 2 * self.solver.substeps}
        finer.solver = self.solver.model_copy(update=half)
        forecasts = [fit.differences(fit.states(x, some), some) for fit in (self, finer)]
        errors = (forecasts[0] - forecasts[1]).nan_to_num(LARGEST).clamp(-LARGEST, LARGEST).square().sum(-1).sqrt()
        far = float(errors.quantile(0.75)) if errors.numel() else 0.0
        if far > 1.0:
            parts = max(2, math.ceil(2 * (far / 0.1) ** 0.25))
            enough = (
                f"points_per_step: {max(1, over // parts)}" if over > 1 else f"substeps: {parts * self.solver.substeps}"
            )
            text = "fits of windows: the solver's steps are too coarse, estimates off by up to %.2g errors: give "
            logger.warning(text + "refinement.solver, in Python solver=, {%s}", far, enough)

    def _fit(self, windows: Tensor, first: Estimates | None) -> Estimates:
        starts = None if first is not None else self.best_of_grid(windows)
        x = self.coordinates(first, self.first(windows)) if starts is None else starts[:, :, 0]
        best = self._minimum(x, windows)
        wanting = ~self._sufficient(best, windows)
        seeds = torch.arange(len(wanting)).unsqueeze(-1)
        for k in range(0 if first is not None else 1, self.tries):
            if not wanting.any():
                break
            # Each seed's own windows first, so many as the seed with most has: the others try for nothing.
            place = wanting.int().argsort(dim=1, descending=True, stable=True)[:, : int(wanting.sum(1).max())]
            part = windows[:, seeds, place]
            if starts is None:
                starts = best.x.new_zeros(*wanting.shape, self.tries, best.x.shape[-1])
                starts[seeds, place] = self.best_of_grid(part)
            further = self._minimum(starts[seeds, place, k], part)
            before = best.cost[seeds, place]
            better = wanting[seeds, place] & (further.cost < before)
            for value, other in zip(vars(best).values(), vars(further).values(), strict=True):
                chosen = better.view(*better.shape, *[1] * (value.dim() - 2))
                value[seeds, place] = torch.where(chosen, other, value[seeds, place])
            again = (further.cost - before).abs() <= self.settings.agreement * torch.minimum(before, further.cost)
            wanting[seeds, place] &= ~(again | self._sufficient(further, part))
        return replace(
            self._estimates(best.x, best.cost, best.curvature, windows),
            stuck=~best.moved & ~self._sufficient(best, windows),
        )

    @property
    def rows(self) -> int:
        """Points in time that a window is compared at."""
        return len(self.t) - (0 if self.transform.start.size else 1)

    def _minimum(self, x: Tensor, windows: Tensor) -> Minimum:
        """The minima that are reached from starts (S, B, K)."""

        def residuals(candidates: Tensor, columns: Tensor) -> Tensor:
            return self.residuals(candidates, of_columns(windows, columns))

        if not x.shape[-1]:  # everything is shared, and the first point is what was observed
            cost = cost_of(self.residuals(x.unsqueeze(0), windows)[0])
            return Minimum(x, cost, x.new_zeros(*x.shape, 0), torch.ones_like(cost, dtype=torch.bool))
        return minimise(residuals, x, self.settings.steps, self.longest)

    def _sufficient(self, minimum: Minimum, windows: Tensor) -> Tensor:
        """Whether minima (S, B) explain their windows within the noise."""
        squares = minimum.cost - self._pulled(minimum.x)
        return torch.special.gammainc(self.degrees_of_freedom(windows) / 2, squares / 2) <= self.settings.sufficient

    def degrees_of_freedom(self, windows: Tensor) -> Tensor:
        """Of the χ² of windows (T1, S, B, *observed): measured numbers less fitted ones, at least 1, (S, B)."""
        return (self.observations - self.missing(windows) - self.sizes[0] - self.sizes[2]).clamp_min(1)

    def _pulled(self, x: Tensor) -> Tensor:
        """What is known beforehand adds so much to the sum of squares at parameters (S, B, K)."""
        return self.pull(x).square().sum(-1)

    def _estimates(self, x: Tensor, cost: Tensor, curvature: Tensor, windows: Tensor) -> Estimates:
        """What the best parameters (S, B, K) are, with Laplace's approximation of their posterior."""
        p, q, _ = self.sizes
        z_e, z_a, start = self.parts(x, self.first(windows))
        size = torch.eye(x.shape[-1], dtype=x.dtype)
        covariance = torch.linalg.pinv(
            curvature + 1e-12 * curvature.diagonal(dim1=-2, dim2=-1).sum(-1)[..., None, None] * size
        )
        covariance = self.overdispersion.view(-1, 1, 1, 1) * covariance
        std = covariance.diagonal(dim1=-2, dim2=-1).clamp_min(0).sqrt()
        squares, axes = torch.linalg.eigh(0.5 * (covariance + covariance.mT))
        root = axes * squares.clamp(0.0, WIDEST**2).sqrt().unsqueeze(-2)
        parameters = self.system.expert_parameters
        held_std = torch.tensor([self.shared[n.name].std if n.name in self.shared else 0.0 for n in parameters]).to(std)
        of_z_e = held_std.expand(*std.shape[:-1], -1).index_copy(
            -1, self.expert.own, std[..., :p] * self.expert.slope(x[..., :p])
        )
        raw = unconstrain(z_e, parameters)
        log_std = of_z_e.clamp_min(1e-30).log() - log_slope(raw, parameters)
        spread = self.transform.latent.spread(std[..., p : p + q]).clamp_min(1e-30).log()
        misfit = (cost - self._pulled(x)) / self.degrees_of_freedom(windows)
        posterior = Posterior(Gaussian(raw, log_std, parameters), Gaussian(z_a, spread))
        return Estimates(start, z_e, z_a, posterior, misfit, root=root)

    @torch.no_grad()
    def draws(self, estimates: Estimates, first: Tensor, normal: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """z_e (K, S, B, P), z_a (K, S, B, Q) and y0 (K, S, B, *state) of Laplace's approximation.

        Arguments:
            estimates: of this fit.
            first: observed first points (S, B, *state).
            normal: standard normal numbers (S, K, B, D), D the number of coordinates.
        """
        seeds, count = normal.shape[:2]
        here, y0 = estimates.to(first.cpu().double()), first.cpu().double()
        assert here.root is not None
        x = self.coordinates(here, y0).unsqueeze(1) + torch.einsum("sbij,skbj->skbi", here.root, normal.cpu().double())
        y0 = y0.unsqueeze(1).expand(-1, count, *y0.shape[1:]).flatten(1, 2)
        parts = self.parts(x.flatten(1, 2), y0)
        z_e, z_a, start = (part.unflatten(1, (count, -1)).transpose(0, 1).to(first) for part in parts)
        return z_e, z_a.expand(-1, seeds, *z_a.shape[2:]), start


class LeastSquares(Predictor, nn.Module):
    """Nonlinear least squares on each window, and the decoder's forecast from it.

    Arguments:
        decoder: what forecasts.
        fit: of windows, with the same decoder.
        first: whose estimates are a start of each fit: the result is then *refined*.
        trajectories: what pulls the windows of a known trajectory instead, by its name.
    """

    def __init__(
        self,
        decoder: Decoder,
        fit: WindowFit,
        first: Estimator | None = None,
        trajectories: Mapping[str, PopulationPull] | None = None,
    ) -> None:
        super().__init__()
        self.decoder, self.fit, self.trajectories = decoder, fit, dict(trajectories or {})
        self.__dict__["first"] = first  # no part of this module: its parameters are its own
        self.alone = first is None and not any(True for _ in decoder.parameters())

    @property
    def system(self) -> System:
        return self.decoder.system

    @torch.no_grad()
    def estimate(self, windows: Windows) -> Estimates:
        """Observed windows, y (T1, S, B, *state) → estimates, with χ² per degree of freedom and Laplace's posterior."""
        of = windows.trajectories
        if of is None or not self.trajectories:
            return self._estimate(windows, self.fit)
        parts, places = [], []
        for name in (None, *self.trajectories):
            chosen = ~np.isin(of, list(self.trajectories)) if name is None else of == name
            if chosen.any():
                places.append(torch.from_numpy(chosen.nonzero()[0]))
                fit = self.fit if name is None else self.fit.pulled(self.trajectories[name])
                parts.append(self._estimate(windows.samples(places[-1]), fit))
                self.fit.steps_checked = fit.steps_checked  # told once, not of each
        return Estimates.joined(parts).part(torch.cat(places).argsort())

    def _estimate(self, windows: Windows, fit: WindowFit) -> Estimates:
        observed = windows.joined
        shared = observed[:, :1].expand_as(observed)
        if self.alone and torch.allclose(observed, shared, 0.0, 0.0, equal_nan=True):  # the same for every seed
            return fit(observed[:, :1]).expand(observed.shape[1])
        return fit(observed, None if self.first is None else self.first.estimate(windows))

    def joint_draws(
        self, estimates: Estimates, windows: Windows, count: int, random: RandomStreams
    ) -> tuple[Tensor, Tensor, Tensor]:
        """As :func:`expertaug.inference.posterior_predictive.joint_draws`, by Laplace's approximation."""
        normal = random.normal(count, windows.y.shape[2], sum(self.fit.sizes))
        return self.fit.draws(estimates, self.state_of(windows.y[0]), normal)

    def forecast(
        self, y0: Tensor, z_e: Tensor, z_a: Tensor, t: Tensor, solver: Solver, u: Tensor | None = None
    ) -> Tensor:
        """The decoder's: states (T, …, B, *state) at the times t (T,), from y0 (…, B, *state)."""
        return self.decoder.forecast(y0, z_e, z_a, t, solver, u)


def estimator_of(
    stored: StoredModel,
    settings: Mapping | RefinementSettings | None,
    noise: GivenNoise,
    prior: Mapping[str, tuple[float, float]] | None,
    shared: Mapping[str, Constant] | None = None,
    sensors: Mapping[str, SensorConstants] | None = None,
    population: PopulationPull | None = None,
    overdispersion: Sequence[float] | None = None,
) -> LeastSquares:
    """Least squares with a stored model's decoder: from its own estimates too, where it has any.

    Arguments:
        stored: hybrid, a flow's, or a decoder without estimates of its own (kinds alternating and least_squares).
        settings: see :class:`RefinementSettings`.
        noise: standard deviation of the data's noise (:func:`expertaug.models.observation_noise.noise_of`).
        prior: range of each expert parameter in which starts lie; None: only the model's own estimates are starts.
        shared: constants of all windows.
        sensors: constants of the sensors that show the state; None: as the model file says.
        population: what pulls parameters towards the middle of their distribution.
        overdispersion: see :class:`WindowProblem`.

    Raises:
        InputError: a model without a decoder, or a name that is no expert parameter or no component.
    """
    options = RefinementSettings.from_mapping(settings)
    check_names(stored.model.system, options)
    card, kind = stored.card, stored.kind
    if sensors is None and card.refinement is not None:
        sensors = card.refinement.sensors
    if not kind.has_expert:
        raise InputError("refinement", "a mean of the training set", "only models with an expert can be fitted")
    if missing := sorted(set(options.shared) - set(shared or {})):
        remedy = "windows tell it together, in Python by together(): leave units out here"
        raise InputError(f"units.{missing[0]}", "shared, and its value is not known", remedy)
    if missing := sorted(set(options.sensors or ()) - set(sensors or ())):
        remedy = "only least squares with the expert alone and alternation estimate sensors: leave it out"
        raise InputError(f"sensors.{missing[0]}", "its constants are not known", remedy)
    if options.population and population is None:
        remedy = "windows tell it together, in Python by together(): leave it out here"
        raise InputError(f"population.{next(iter(options.population))}", "its distribution is not known", remedy)
    if kind.has_objective and card.latent is None:
        raise InputError("refinement", "the model file does not say where its z_a lie", "train it again")
    first = None if kind.fits_windows else stored.model
    decoder: Decoder = stored.model if first is None else stored.model.decoder
    starts = card.start
    if sensors:
        decoder = decoder.seen_by(Sensors.of(decoder.system, sensors))
        starts = None if starts is None or decoder.sensors is None else decoder.sensors.state_ranges(starts)
    fields_set = options.model_fields_set
    solver = options.solver if "solver" in fields_set else card.training.solver
    noise_std = noise_of(noise, decoder.system, card)
    free = options.free_start if "free_start" in fields_set else is_some(noise_std)
    fit = WindowFit(
        decoder,
        torch.tensor(card.t[: card.observed], dtype=torch.float64),
        options,
        assumed_noise(options, noise_std, card.bound),
        bool(free),
        prior,
        LatentCoordinates.of(card, options.latent),
        Solver(**dict(solver or {})),
        starts,
        shared,
        population,
        overdispersion,
    )
    return LeastSquares(decoder, fit, first)


def check_names(system: System, settings: RefinementSettings) -> None:
    """Refuse what is no parameter or component of a system, and distributions that cannot be.

    Raises:
        InputError: what is wrong first.
    """
    parameters = {p.name: p for p in system.expert_parameters}
    for block in ("units", "population"):
        check_keys(getattr(settings, block) or {}, parameters, block, "expert parameter")
    check_components(system, settings.sensors or {})
    for name, form in (settings.population or {}).items():
        if name in settings.shared:
            raise InputError(f"population.{name}", "is shared by all windows", "leave it out here, or in units")
        if form == "lognormal" and not parameters[name].positive:
            raise InputError(f"population.{name}", "a parameter that may be negative", "give normal")


def refine_by(stored: StoredModel, refinement: Refinement) -> LeastSquares:
    """As :func:`estimator_of`, as a refinement says."""
    prior = None if refinement.prior is None else given_ranges(refinement.prior)
    system = stored.model.system
    constants = refinement.shared, refinement.sensors, pull_of(system, refinement), refinement.overdispersion
    estimator = estimator_of(stored, refinement.settings, refinement.noise, prior, *constants)
    estimator.trajectories = _pulls_of_trajectories(system, refinement)
    return estimator


def _pulls_of_trajectories(system: System, refinement: Refinement) -> dict[str, PopulationPull]:
    """What is known of a window of each training trajectory: its own estimates, of other parameters distributions."""
    populations: dict[str, dict[str, Population]] = {}
    for name, constants in (refinement.trajectories or {}).items():
        for of, constant in constants.items():
            # Its error is the width of a pull that has no other.
            exact, error = constant.model_copy(update={"std": 0.0}), Constant(value=constant.std, std=0.0)
            population = Population(form="normal", middle=exact, spread=error, unit="trajectory")
            populations.setdefault(of, dict(refinement.population or {}))[name] = population
    return {of: PopulationPull.of(system, distributions) for of, distributions in populations.items()}


@torch.no_grad()
def with_overdispersion(stored: StoredModel, refinement: Refinement, train: Trajectories) -> Refinement:
    """The refinement with the overdispersion of fits of the training windows, as far as they are observed.

    Arguments:
        stored: whose windows are fitted, of any number of seeds.
        train: of which at most :data:`TOLD` windows are fitted, evenly spread.
    """
    if refinement.overdispersion is not None:
        return refinement
    estimator, seeds = refine_by(stored, refinement), len(stored.seeds)
    fit, some = estimator.fit, Windows.of(train.spread(TOLD)).until(stored.card.observed)
    fit.steps_checked, parts = True, []  # the one that is used tells it
    for part in some.expand(seeds).split(max(1, MEMORY // (8 * seeds * some.joined[:, 0, 0].numel()))):
        windows, estimates = part.joined.double(), estimator.estimate(part.contiguous())
        x = fit.coordinates(estimates.to(windows), fit.first(windows))
        residuals = fit.residuals(x.unsqueeze(0), windows)[0]
        parts.append((residuals[..., : residuals.shape[-1] - fit.pulls], fit.degrees_of_freedom(windows)))
    residuals, freedom = (torch.cat([pair[k] for pair in parts], dim=1) for k in range(2))
    each = [overdispersion(*of_seed, fit.rows)[0] for of_seed in zip(residuals, freedom, strict=True)]
    return refinement.model_copy(update={"overdispersion": each[:1] if estimator.alone else each})


def pull_of(
    system: System, refinement: Refinement, units: Sequence[str] = ("window", "trajectory")
) -> PopulationPull | None:
    """What pulls a window's parameters, of a refinement that knows their distributions.

    Arguments:
        units: of which values these are.
    """
    population = {
        name: distribution for name, distribution in (refinement.population or {}).items() if distribution.unit in units
    }
    return PopulationPull.of(system, population) if population else None


def refinement_of(stored: StoredModel, refinement: Refinement | None) -> Refinement | None:
    """How a version's windows are fitted: as settings say, else as its model file does; None where they are not."""
    return refinement or stored.card.refinement

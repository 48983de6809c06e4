"""What windows share: one pendulum has one length, however many windows show it.

Constants of all windows and of their sensors, values of each trajectory, and distributions of what windows or
trajectories have of their own, fitted to all training windows together.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from torch import Tensor

from expertaug import systems
from expertaug.errors import InputError
from expertaug.inference.joint_fit import (
    BLOCKS,
    FEWEST_GROUPS,
    STEPS,
    NormalEquations,
    Tied,
    clustered_variances,
    eliminate,
    minimise_together,
    normal_equations,
    of_groups,
)
from expertaug.inference.least_squares import check_names, estimator_of, pull_of
from expertaug.inference.population import distribution, overdispersion
from expertaug.inference.sensed_fit import SensedFit, SensorCoordinates, constants_from
from expertaug.learning.settings import UntrainedJob
from expertaug.learning.train import Calibration, describe_recipe, make_untrained
from expertaug.learning.training_data import set_files
from expertaug.models import store
from expertaug.models.card import RecipeRecord
from expertaug.models.fit_settings import Constant, Population, Refinement, RefinementSettings, SensorConstants
from expertaug.models.observation_noise import ESTIMATED
from expertaug.models.stacking import select
from expertaug.models.store import StoredModel
from expertaug.settings import given_ranges
from expertaug.systems import System
from expertaug.trajectories import Trajectories, places_by_trajectory
from expertaug.windows import Windows

logger = logging.getLogger(__name__)
POPULATION_ROUNDS = 4  # of distributions and fits that they pull
FEWEST_UNITS = 2  # windows or trajectories that have a distribution
LEAST = -12.0  # of a positive parameter's coordinate, below which it counts as zero
ROUNDS = 2  # of fits with the noise that the one before has left
UNTOLD = 1e-7  # of a direction's curvature, each constant's own being 1: two constants make up for each other there


def run_stage(data: Path, output: Path, settings: UntrainedJob, calibration: Path | None = None) -> None:
    """Stage: fit what all windows of ``data/train.npz`` share, and write the model whose file has these constants.

    Arguments:
        data: folder of the sets.
        output: model file.
        settings: of the job; its refinement says what is shared.
        calibration: JSON whose ``constants`` complete the system's settings.

    Raises:
        InputError: unusable data or settings.
    """
    described = describe_recipe(settings, None if calibration is None else Calibration.load(calibration))
    stored = share(Trajectories.load(set_files(data)[0]), settings, described)
    store.save(output, stored.model, stored.card)


def share(train: Trajectories, settings: UntrainedJob, described: RecipeRecord) -> StoredModel:
    """The model that knows what all windows of a training set share.

    Arguments:
        settings: its refinement says what is shared.
        described: what a file says of the recipe (:func:`expertaug.learning.train.describe_recipe`).

    Raises:
        InputError: nothing is shared, or as of :func:`fit_shared`.
    """
    system, build = systems.load(described.system), settings.build
    stored = make_untrained(build.kind, system, train, settings, described, bool(build.truth))
    if settings.refinement is None or not settings.refinement.settings.shares:
        raise InputError("refinement.units", "nothing is shared", "say of a parameter that it is: NAME: shared")
    began = time.perf_counter()
    refinement = fit_shared(stored, settings.refinement, train)
    return replace(stored, card=stored.card.but(refinement=refinement, wall_s=time.perf_counter() - began))


def fit_shared(
    stored: StoredModel, refinement: Refinement, train: Trajectories, start: Tensor | None = None
) -> Refinement:
    """The refinement with what its settings say that windows share, fitted to the whole training windows (what they
    show after the observed part is known, and tells it best): constants of all windows and of sensors, estimates for
    each trajectory, and distributions of parameters.

    Standard errors of constants are those of clustered observations (Liang & Zeger 1986), by trajectory, or, of fewer
    than eight, by blocks of windows in their order: residuals of a model that is not quite right are correlated along a
    trajectory and over windows that overlap, and the curvature alone, which is their least, gives errors that are
    several times too small.

    Where the noise is estimated and sensors are among the constants, it is in the end what these fits leave of each
    component.  Without the sensors what is left is no noise: one component contradicts the integral of another.

    Arguments:
        stored: the expert alone, or one seed of a model whose windows are fitted.
        refinement: with a prior, in which the fits of single windows start; distributions that it knows are kept.
        train: windows of what shares the parameters, with their identities, where they have any.
        start: coordinates (M,) of the constants, parameters first; None: the medians of fits of single windows.

    Raises:
        InputError: a name that is no expert parameter or no component, no prior, or windows that do not tell a
            sensor's constant.
    """
    system, settings = stored.model.system, refinement.settings
    names = [p.name for p in system.expert_parameters]
    shared, tied, sought = settings.shared, settings.tied, settings.of_sensors
    check_names(system, settings)
    if not settings.shares:
        return refinement
    if refinement.prior is None:
        raise InputError("units", "given without a prior", "give a range of each parameter in which fits start")
    whole = Windows.of(train)
    sensors = SensorCoordinates.of(system, sought, whole.y)
    trajectories = {} if train.id is None else places_by_trajectory(train.id, len(train))
    together = Tied.of([names.index(name) for name in tied], trajectories) if tied and trajectories else None
    # The observed part first: a forecast over all of a window has more minima, and is near the best one from there.
    parts = sorted({stored.card.observed, whole.points})
    before: tuple[SensedFit, Tensor, Tensor] | None = None  # the last fit, its windows and coordinates
    for points in (*parts, *[whole.points] * _rounds(system, refinement)):
        if before is not None and len(before[1]) == whole.points:
            refinement = refinement.model_copy(update={"noise": before[0].left(before[2], before[1])})
        sensed = _problem(stored, refinement, points, sensors)
        windows, own = whole.until(points).joined.double(), sum(sensed.fit.sizes)
        places = [*(names.index(name) for name in shared), *range(own, own + len(sought))]
        if before is None:
            x = sensed.start(windows)
            x[..., places] = x[..., places].median(dim=1, keepdim=True).values if start is None else start
            x = x if together is None else together.alike(x)
        else:
            x = before[0].carried(before[2], windows, sensed)
        x, equations, ended = minimise_together(sensed, windows, x, places, tied=together)
        before = sensed, windows, x
    dispersion = _Dispersion.of(sensed, windows, x)
    if wanted := [name for name in settings.population or {} if name not in (refinement.population or {})]:
        of_population = _PopulationFit(stored, sensors, windows, places, together, groups_of(train))
        refinement = of_population.with_distributions(refinement, wanted, x, dispersion)
        if together is None or not set(wanted) <= set(tied):  # a trajectory's windows are not pulled one by one
            refinement, x, equations, ended = of_population.pulled(refinement, wanted, x, dispersion)
    if not ended:
        text = "shared parameters: the fit has not ended after %d steps; narrow the prior or share less"
        logger.warning(text, STEPS)
    of_all, at = of_groups(equations, places, together)
    if sought:
        _check_told(of_all, at, [*shared, *(f"sensors.{component}.{name}" for component, name in sought)])
    groups = groups_of(train) if together is None else np.arange(len(of_all.cost))
    std = clustered_variances(of_all, at, groups).sqrt()
    z_e = sensed.fit.parts(x[..., :own], sensed.fit.first(windows))[0][0]
    slope = sensed.fit.expert.slope(x[0, :, : len(names)])
    changes: dict[str, object] = {"overdispersion": [dispersion.overdispersion]}
    if shared:
        some = places[: len(shared)]
        errors = std[: len(shared)] * slope[0, some]
        changes["shared"] = dict(zip(shared, constants_from(z_e[0, some], errors, groups), strict=True))
    if sought:
        sensors.check_curves(x[0, 0, own:], whole.y.double())
        changes["sensors"] = sensors.constants(x[0, 0, own:], std[len(shared) :], groups)
    if together is not None:
        variances = together.variances(equations, places, dispersion.overdispersion)
        changes["trajectories"] = {
            name: together.constants(z_e[:, place], variances[:, k].sqrt() * slope[:, place], list(trajectories))
            for k, (name, place) in enumerate(zip(tied, together.places, strict=True))
        }
    return refinement.model_copy(update=changes)


def _problem(stored: StoredModel, refinement: Refinement, points: int, sensors: SensorCoordinates) -> SensedFit:
    """Of windows of so many points, where each has its own parameters, pulled by the distributions that are known."""
    of_part = replace(stored, card=stored.card.but(observed=points))
    ranges, pull = given_ranges(refinement.prior), pull_of(stored.model.system, refinement, ("window",))
    options = {"population": pull, "overdispersion": refinement.overdispersion}
    fit = estimator_of(of_part, refinement.settings.alone, refinement.noise, ranges, **options).fit
    return SensedFit(fit, sensors)


@dataclass(frozen=True)
class _Dispersion:
    """By how much residuals of fits to windows tell less than independent ones of the stated noise would.

    Attributes:
        overdispersion: correlation time of the residuals times the median of the windows' χ² per degree of freedom,
            at least 1.
        of_each: the same with each window's own χ², where it is larger, (N,).
    """

    overdispersion: float
    of_each: Tensor

    @classmethod
    def of(cls, sensed: SensedFit, windows: Tensor, x: Tensor) -> _Dispersion:
        """Of fits (1, N, K) of windows (T1, 1, N, *observed)."""
        residuals = sensed.residuals(x.unsqueeze(0), windows)[0, 0]
        data = residuals[:, : residuals.shape[1] - sensed.fit.pulls]
        return cls(*overdispersion(data, sensed.fit.degrees_of_freedom(windows)[0], sensed.fit.rows))


@dataclass(frozen=True)
class _PopulationFit:
    """Windows whose parameters have distributions, which are estimated with them.

    Attributes:
        stored: see :func:`fit_shared`.
        sensors: what is estimated of sensors.
        windows: (T, 1, N, *observed), float64.
        places: of the coordinates of all windows.
        tied: those of trajectories.
        groups: numbers (N,) of the groups of windows that are independent.
    """

    stored: StoredModel
    sensors: SensorCoordinates
    windows: Tensor
    places: Sequence[int]
    tied: Tied | None
    groups: np.ndarray

    def with_distributions(
        self, refinement: Refinement, wanted: Sequence[str], x: Tensor, dispersion: _Dispersion
    ) -> Refinement:
        """The refinement with the distributions of the wanted parameters, as windows at coordinates (1, N, K) tell
        them."""
        bare = _problem(
            self.stored, refinement.model_copy(update={"population": None}), len(self.windows), self.sensors
        )
        population = {**(refinement.population or {}), **self._estimated(bare, refinement, wanted, x, dispersion)}
        return refinement.model_copy(update={"population": population, "overdispersion": [dispersion.overdispersion]})

    def pulled(
        self, refinement: Refinement, wanted: Sequence[str], x: Tensor, dispersion: _Dispersion
    ) -> tuple[Refinement, Tensor, NormalEquations, bool]:
        """The refinement with distributions and estimates that agree with each other, the windows' coordinates
        (1, N, K) as they are pulled, the equations there, and whether it is a minimum.

        Arguments:
            refinement: with first distributions.
            wanted: those that are estimated.
            x: at the minimum without them.
            dispersion: of the windows' fits there.
        """
        for k in range(POPULATION_ROUNDS):
            refinement = refinement if k == 0 else self.with_distributions(refinement, wanted, x, dispersion)
            pulled = _problem(self.stored, refinement, len(self.windows), self.sensors)
            if k == 0:  # from where the distributions say, too: a window that tells little may lie anywhere
                other = pulled.start(self.windows)
                held = [*self.places, *(self.tied.places if self.tied is not None else ())]
                other[..., held] = x[..., held]
                costs = [normal_equations(pulled, self.windows, candidate).cost for candidate in (x, other)]
                x = torch.where((costs[1] < costs[0]).unsqueeze(-1), other, x)
            x, equations, ended = minimise_together(pulled, self.windows, x, self.places, tied=self.tied)
        return refinement, x, equations, ended

    def _estimated(
        self, bare: SensedFit, refinement: Refinement, wanted: Sequence[str], x: Tensor, dispersion: _Dispersion
    ) -> dict[str, Population]:
        """Distributions by name, from what windows, or trajectories, tell by themselves at coordinates (1, N, K)."""
        settings, system = refinement.settings, self.stored.model.system
        names = [p.name for p in system.expert_parameters]
        equations = normal_equations(bare, self.windows, x)
        weight = 1 / dispersion.of_each
        equations = NormalEquations(
            equations.cost * weight, equations.curvature * weight[:, None, None], equations.slope * weight[:, None]
        )
        populations: dict[str, Population] = {}
        held = [*self.places, *(self.tied.places if self.tied is not None else ())]
        for unit in ("window", "trajectory"):
            of_trajectories = settings.tied if self.tied is not None else ()
            chosen = [name for name in wanted if (name in of_trajectories) == (unit == "trajectory")]
            if not chosen:
                continue
            places = [names.index(name) for name in chosen]
            kept = [k for k in range(x.shape[-1]) if k not in held or k in places]
            part = equations.of(kept)
            curvature, slope, *_ = eliminate(part, [kept.index(k) for k in places], 0.0)
            at, units, clusters = x[0][:, places], NormalEquations(part.cost, curvature, slope), self.groups
            if unit == "trajectory" and self.tied is not None:
                units, at = self.tied.summed(units), at[self.tied.first]
                clusters = np.arange(self.tied.count)
            if len(at) < FEWEST_UNITS:
                raise InputError(f"population.{chosen[0]}", f"one {unit} has no distribution", "leave it out")
            populations |= zip(chosen, _populations(system, chosen, settings, units, at, clusters, unit), strict=True)
        return {name: populations[name] for name in wanted}


def _populations(
    system: System,
    chosen: Sequence[str],
    settings: RefinementSettings,
    units: NormalEquations,
    at: Tensor,
    clusters: np.ndarray,
    unit: Literal["window", "trajectory"],
) -> list[Population]:
    """Of what G units, of which some groups are independent, say of R parameters' coordinates (G, R)."""
    parameters = {p.name: p for p in system.expert_parameters}
    scale = torch.tensor([parameters[name].scale for name in chosen], dtype=at.dtype)
    positive = torch.tensor([parameters[name].positive for name in chosen])
    forms = [(settings.population or {})[name] for name in chosen]
    logarithmic = torch.tensor([form == "lognormal" for form in forms])
    values = scale * torch.where(positive, at.clamp_min(LEAST).exp(), at)
    values, steepness = (
        torch.where(logarithmic, at + scale.log(), values),
        torch.where(logarithmic, 1.0, torch.where(positive, values, scale)),
    )
    information = units.curvature.diagonal(dim1=1, dim2=2).sum(0)
    if bool((information <= 0).any()):
        name = chosen[int((information <= 0).nonzero()[0])]
        raise InputError(f"refinement.population.{name}", "the windows do not tell it", "leave it out")
    slopes = steepness.unsqueeze(-1) * steepness.unsqueeze(-2)
    numbers = torch.from_numpy(np.unique(clusters, return_inverse=True)[1])
    estimate = distribution(units.curvature / slopes, units.slope / steepness, values, numbers)
    if not all(bool(part.isfinite().all()) for part in vars(estimate).values()):
        raise InputError(f"population.{chosen[0]}", "no distribution is found", "leave it out, or narrow the prior")
    middle = torch.where(logarithmic, estimate.mean.exp(), estimate.mean)
    error = estimate.mean_std * torch.where(logarithmic, middle, 1.0)
    pairs = zip(
        constants_from(middle, error, clusters),
        constants_from(estimate.spread, estimate.spread_std, clusters),
        forms,
        strict=True,
    )
    return [Population(form=form, middle=m, spread=spread, unit=unit) for m, spread, form in pairs]


def fit_shared_of_seeds(
    stored: StoredModel, refinement: Refinement, train: Trajectories, starts: Tensor | None = None
) -> Refinement:
    """As :func:`fit_shared`, for each seed of a model with its own F_a: its constants have a value of each, that of a
    seed that failed being the others' mean.

    Arguments:
        stored: a model whose windows are fitted, stacked over S seeds.
        starts: coordinates (S, M) of the constants; None: the medians of fits of single windows.
    """
    each, seeds = [], len(stored.seeds)
    trained = [k for k, seed in enumerate(stored.seeds) if seed not in stored.failed]
    for k in trained:
        of_seed = StoredModel(select(stored.model, [k], seeds), stored.card.of_seeds([k]), stored.classes)
        each.append(fit_shared(of_seed, refinement.of_seeds([k]), train, None if starts is None else starts[k]))
    changes: dict[str, object] = {}
    for block, kind in (("shared", Constant), ("sensors", SensorConstants), ("population", Population)):
        if first := getattr(each[0], block):
            changes[block] = {name: kind.of_seeds([getattr(fitted, block)[name] for fitted in each]) for name in first}
    if each[0].trajectories:
        changes["trajectories"] = {
            name: {of: Constant.of_seeds([fitted.trajectories[name][of] for fitted in each]) for of in constants}
            for name, constants in each[0].trajectories.items()
        }
    if each[0].overdispersion is not None:
        changes["overdispersion"] = [fitted.overdispersion[0] for fitted in each]
    if isinstance(each[0].noise, Mapping):
        changes["noise"] = {name: sum(fitted.noise[name] for fitted in each) / len(each) for name in each[0].noise}
    places = [trained.index(k) if k in trained else None for k in range(seeds)]
    return refinement.model_copy(update={name: _at(value, places) for name, value in changes.items()})


def _at(value: Any, places: Sequence[int | None]) -> Any:
    """What was estimated of some seeds, as that of a group in which they have these places."""
    if isinstance(value, Constant):
        own = value.seeds or []
        return value.model_copy(update={"seeds": [value.value if k is None else own[k] for k in places]})
    if isinstance(value, Mapping):
        return {name: _at(part, places) for name, part in value.items()}
    if isinstance(value, SensorConstants | Population):
        return value.model_copy(update={name: _at(getattr(value, name), places) for name in value.model_fields_set})
    if isinstance(value, list):
        return [sum(value) / len(value) if k is None else value[k] for k in places]
    return value


def on_training_windows(stored: StoredModel, refinement: Refinement, train: Trajectories) -> Refinement:
    """The refinement of a trained model with what its settings say that windows share, as each seed's F_a and the
    training windows tell it; the same where they share nothing.

    Raises:
        InputError: as of :func:`fit_shared`.
    """
    return fit_shared_of_seeds(stored, refinement, train) if refinement.settings.shares else refinement


def _rounds(system: System, refinement: Refinement) -> int:
    """How often the noise is estimated anew: where nobody gave it, sensors are estimated, and each observed quantity is
    a component."""
    state = torch.linspace(0.1, 0.2, len(system.state), dtype=torch.float64)
    plain = len(system.state_shape) == 1 and system.observe(state).shape == state.shape
    sensed = bool(refinement.settings.of_sensors)
    return ROUNDS if refinement.noise == ESTIMATED and plain and sensed else 0


def groups_of(data: Trajectories) -> np.ndarray:
    """Numbers (N,) of the groups of windows whose residuals are taken as independent: trajectories, or blocks."""
    count = len(data)
    if data.id is None:
        return np.arange(count)
    names, places = np.unique(data.trajectories, return_inverse=True)  # type: ignore[arg-type]
    if len(names) >= FEWEST_GROUPS:
        return places
    return np.minimum(np.arange(count) * BLOCKS // count, BLOCKS - 1) + BLOCKS * places


def _check_told(equations: NormalEquations, places: Sequence[int], names: Sequence[str]) -> None:
    """Refuse shared constants that make up for each other, or that move nothing.

    Raises:
        InputError: their names.
    """
    total = eliminate(equations, places, 0.0)[0].sum(0)
    own = total.diagonal().clamp_min(1e-300).sqrt()
    curvature, axes = torch.linalg.eigh(total / torch.outer(own, own))
    of_sensors = [k for k, name in enumerate(names) if name.startswith("sensors.")]
    dead = [k for k in of_sensors if float(own[k]) < UNTOLD * float(own.max())]
    flat = axes[:, 0].abs() if float(curvature[0]) < UNTOLD else torch.zeros(len(names))
    alike = [k for k in range(len(names)) if float(flat[k]) > 0.1]
    if dead or (set(alike) & set(of_sensors)):
        several = dead or alike
        first = names[next(k for k in several if k in of_sensors)]
        others = [names[k] for k in several if names[k] != first]
        problem = f"cannot be told apart from {' and '.join(others)}" if others and not dead else "moves nothing"
        raise InputError(f"refinement.{first}", f"{problem} in these windows", "leave it out")

"""Parameters that all windows share: one pendulum has one length, however many windows show it.

The windows' sum of squares is minimised over the shared parameters and each window's own ones together.  Given the
former, windows are independent, so that their own parameters are eliminated from the normal equations window by window
(a Schur complement); what is left is a system of the size of what is shared.  Scale and offset of a component's sensor
may be among it: they are seen in how far what is measured contradicts the equation.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
import torch
from torch import Tensor

from expertaug import systems
from expertaug.errors import InputError
from expertaug.inference.least_squares import MEMORY, WindowFit, WindowProblem, estimator_of, pull_of
from expertaug.inference.levenberg_marquardt import DAMPING, LESS, LONGEST, MORE, TIGHTEST, linearised, minimise
from expertaug.inference.population import correlation_time, distribution
from expertaug.learning.settings import UntrainedJob
from expertaug.learning.train import Calibration, describe_recipe, make_untrained
from expertaug.learning.training_data import set_files
from expertaug.models import store
from expertaug.models.observation_noise import ESTIMATED
from expertaug.models.posterior import Estimates
from expertaug.models.sensors import Sensors, check_components
from expertaug.models.settings import Constant, Population, Refinement, RefinementSettings, SensorConstants
from expertaug.models.stacking import select
from expertaug.models.store import StoredModel
from expertaug.settings import given_ranges
from expertaug.systems import System
from expertaug.trajectories import Trajectories, places_by_trajectory
from expertaug.windows import Windows

logger = logging.getLogger(__name__)
STEPS = 60
POPULATION_ROUNDS = 4  # of distributions and fits that they pull
LEAST = -12.0  # of a positive parameter's coordinate, below which it counts as zero
ROUNDS = 2  # of fits with the noise that the one before has left
TOLERANCE = 1e-9  # of the cost: the windows together are at their minimum
FEWEST_GROUPS = 8  # of windows whose residuals are independent, below which blocks of windows stand for groups
BLOCKS = 10
UNTOLD = 1e-7  # of a direction's curvature, each constant's own being 1: two constants make up for each other there
WEAK = 0.25  # standard error of a sensor's constant, of a scale or of the component's spread, which is told


@dataclass(frozen=True)
class NormalEquations:
    """The problem in its linear approximation: of N windows with K coordinates each, M of them shared.

    Attributes:
        cost: sum of squares of each window, (N,).
        curvature: JᵀJ, (N, K, K).
        slope: Jᵀr, (N, K).
    """

    cost: Tensor
    curvature: Tensor
    slope: Tensor

    def of(self, places: Sequence[int]) -> NormalEquations:
        """Of some of the coordinates, the others held."""
        some = list(places)
        return NormalEquations(self.cost, self.curvature[:, some][:, :, some], self.slope[:, some])


@dataclass(frozen=True)
class Tied:
    """Coordinates that all windows of a trajectory have in common.

    Attributes:
        places: of the coordinates.
        groups: number of each window's trajectory, (N,), from 0 on without a gap.
    """

    places: Sequence[int]
    groups: Tensor

    @classmethod
    def of(cls, places: Sequence[int], trajectories: Mapping[str, np.ndarray]) -> Tied:
        """Of the windows' places by trajectory."""
        groups = torch.zeros(sum(map(len, trajectories.values())), dtype=torch.long)
        for k, windows in enumerate(trajectories.values()):
            groups[torch.from_numpy(windows)] = k
        return cls(places, groups)

    @property
    def count(self) -> int:
        """Number of trajectories."""
        return int(self.groups.max()) + 1

    @property
    def first(self) -> Tensor:
        """A window of each trajectory."""
        return torch.stack([(self.groups == k).nonzero()[0, 0] for k in range(self.count)])

    def alike(self, x: Tensor) -> Tensor:
        """Coordinates (1, N, K) with the median of each trajectory's windows at these places."""
        x = x.clone()
        for k in range(self.count):
            windows = self.groups == k
            for place in self.places:
                x[:, windows, place] = x[:, windows, place].median()
        return x

    def summed(self, equations: NormalEquations) -> NormalEquations:
        """Of what windows say of the same coordinates: of each trajectory."""

        def total(values: Tensor) -> Tensor:
            return values.new_zeros(self.count, *values.shape[1:]).index_add_(0, self.groups, values)

        return NormalEquations(total(equations.cost), total(equations.curvature), total(equations.slope))

    def variances(self, equations: NormalEquations, places: Sequence[int], overdispersion: float) -> Tensor:
        """Of each window's coordinates at these places, (N, M), the shared ones being held: by the curvature, or, where
        it is larger, by how blocks of the trajectory's windows scatter.

        Arguments:
            overdispersion: by how much less residuals tell than independent ones of the stated noise.
        """
        kept = [k for k in range(equations.slope.shape[1]) if k not in places]
        part, at = equations.of(kept), [kept.index(k) for k in self.places]
        found = part.slope.new_zeros(len(part.cost), len(at))
        for k in range(self.count):
            windows = self.groups == k
            own = NormalEquations(part.cost[windows], part.curvature[windows], part.slope[windows])
            count = len(own.cost)
            blocks = np.arange(count) * BLOCKS // count if count >= FEWEST_GROUPS else np.zeros(count, dtype=int)
            least = overdispersion * clustered_variances(own, at, np.zeros(count, dtype=int))
            found[windows] = torch.maximum(least, clustered_variances(own, at, blocks))
        return found

    def constants(self, values: Tensor, errors: Tensor, names: Sequence[str]) -> dict[str, Constant]:
        """By trajectory, of values and errors (N,) of its windows."""
        counts = torch.bincount(self.groups).tolist()
        pairs = zip(names, values[self.first].tolist(), errors[self.first].tolist(), counts, strict=True)
        return {name: Constant(value=value, std=error, groups=count) for name, value, error, count in pairs}


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
    train, build = Trajectories.load(set_files(data)[0]), settings.build
    system = systems.load(described.system)
    stored = make_untrained(build.kind, system, train, settings, described, bool(build.truth))
    if settings.refinement is None or not settings.refinement.settings.shares:
        raise InputError("refinement.units", "nothing is shared", "say of a parameter that it is: NAME: shared")
    began = time.perf_counter()
    refinement = fit_shared(stored, settings.refinement, train)
    card = stored.card.but(refinement=refinement, wall_s=time.perf_counter() - began)
    store.save(output, stored.model, card)


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
    _check_names(system, settings)
    if not settings.shares:
        return refinement
    if refinement.prior is None:
        raise InputError("units", "given without a prior", "give a range of each parameter in which fits start")
    whole = Windows.of(train)
    sensors = SensorCoordinates.of(system, sought, whole.y)
    trajectories = places_by_trajectory(train.id, len(train))
    together = Tied.of([names.index(name) for name in tied], trajectories) if tied else None
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
    trusted = _Trust.of(sensed, windows, x)
    if wanted := [name for name in settings.population or {} if name not in (refinement.population or {})]:
        several = Several(stored, sensors, windows, places, together, groups_of(train))
        refinement = several.told(refinement, wanted, x, trusted)
        if not set(wanted) <= set(tied):  # a trajectory's windows are not pulled one by one
            refinement, x, equations, ended = several.pulled(refinement, wanted, x, trusted)
    if not ended:
        text = "shared parameters: the fit has not ended after %d steps; narrow the prior or share less"
        logger.warning(text, STEPS)
    of_all, at = _of_groups(equations, places, together)
    if sought:
        _check_told(of_all, at, [*shared, *(f"sensors.{component}.{name}" for component, name in sought)])
    groups = groups_of(train) if together is None else np.arange(len(of_all.cost))
    std = clustered_variances(of_all, at, groups).sqrt()
    z_e = sensed.fit.parts(x[..., :own], sensed.fit.first(windows))[0][0]
    slope = sensed.fit.expert.slope(x[0, :, : len(names)])
    changes: dict[str, object] = {}
    if shared:
        some = places[: len(shared)]
        errors = std[: len(shared)] * slope[0, some]
        changes["shared"] = dict(zip(shared, _constants(z_e[0, some], errors, groups), strict=True))
    if sought:
        changes["sensors"] = sensors.constants(x[0, 0, own:], std[len(shared) :], groups)
    if together is not None:
        variances = together.variances(equations, places, trusted.overdispersion)
        changes["overdispersion"] = trusted.overdispersion
        changes["trajectories"] = {
            name: together.constants(z_e[:, place], variances[:, k].sqrt() * slope[:, place], list(trajectories))
            for k, (name, place) in enumerate(zip(tied, together.places, strict=True))
        }
    return refinement.model_copy(update=changes)


def _problem(stored: StoredModel, refinement: Refinement, points: int, sensors: SensorCoordinates) -> SensedFit:
    """Of windows of so many points, where each has its own parameters, pulled by the distributions that are known."""
    of_part = replace(stored, card=stored.card.but(observed=points))
    ranges, pull = given_ranges(refinement.prior), pull_of(stored.model.system, refinement, ("window",))
    fit = estimator_of(of_part, refinement.settings.alone, refinement.noise, ranges, population=pull).fit
    return SensedFit(fit, sensors)


def _check_names(system: System, settings: RefinementSettings) -> None:
    """Refuse what is no parameter or component of a system, and distributions that cannot be."""
    parameters = {p.name: p for p in system.expert_parameters}
    for block in ("units", "population"):
        if wrong := sorted({*(getattr(settings, block) or {})} - set(parameters)):
            raise InputError(f"{block}.{wrong[0]}", "is no expert parameter", f"known: {', '.join(parameters)}")
    check_components(system, settings.sensors or {})
    for name, form in (settings.population or {}).items():
        if name in settings.shared:
            raise InputError(f"population.{name}", "is shared by all windows", "leave it out here, or in units")
        if form == "lognormal" and not parameters[name].positive:
            raise InputError(f"population.{name}", "a parameter that may be negative", "give normal")


@dataclass(frozen=True)
class _Trust:
    """How far fits to windows are to be trusted.

    Attributes:
        overdispersion: correlation time of the residuals times the median of the windows' χ² per degree of freedom,
            at least 1.
        of_each: the same with each window's own χ², where it is larger, (N,).
    """

    overdispersion: float
    of_each: Tensor

    @classmethod
    def of(cls, sensed: SensedFit, windows: Tensor, x: Tensor) -> _Trust:
        """Of fits (1, N, K) of windows (T1, 1, N, *observed)."""
        residuals = sensed.residuals(x.unsqueeze(0), windows)[0, 0]
        data = residuals[:, : residuals.shape[1] - sensed.fit.pulls].nan_to_num(0.0, 0.0, 0.0)
        rows = len(windows) - (0 if sensed.fit.transform.start.size else 1)
        if not rows:
            return cls(1.0, torch.ones(len(data), dtype=data.dtype))
        time = correlation_time(data.unflatten(1, (rows, -1)))
        chi2 = data.square().sum(1) / sensed.fit.degrees_of_freedom(windows)[0]
        middle = float(chi2.median())
        return cls(max(1.0, time * middle), (time * chi2.clamp_min(middle)).clamp_min(1.0))


@dataclass(frozen=True)
class Several:
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

    def told(self, refinement: Refinement, wanted: Sequence[str], x: Tensor, trusted: _Trust) -> Refinement:
        """The refinement with the distributions of the wanted parameters, as windows at coordinates (1, N, K) tell
        them."""
        bare = _problem(
            self.stored, refinement.model_copy(update={"population": None}), len(self.windows), self.sensors
        )
        known = {**(refinement.population or {}), **self._estimated(bare, refinement, wanted, x, trusted)}
        return refinement.model_copy(update={"population": known, "overdispersion": trusted.overdispersion})

    def pulled(
        self, refinement: Refinement, wanted: Sequence[str], x: Tensor, trusted: _Trust
    ) -> tuple[Refinement, Tensor, NormalEquations, bool]:
        """The refinement with distributions and estimates that agree with each other, the windows' coordinates
        (1, N, K) as they are pulled, the equations there, and whether it is a minimum.

        Arguments:
            refinement: with first distributions.
            wanted: those that are estimated.
            x: at the minimum without them.
            trusted: of the windows' fits there.
        """
        for k in range(POPULATION_ROUNDS):
            refinement = refinement if k == 0 else self.told(refinement, wanted, x, trusted)
            pulled = _problem(self.stored, refinement, len(self.windows), self.sensors)
            if k == 0:  # from where the distributions say, too: a window that tells little may lie anywhere
                other = pulled.start(self.windows)
                held = [*self.places, *(self.tied.places if self.tied is not None else ())]
                other[..., held] = x[..., held]
                costs = [normal_equations(pulled, self.windows, one).cost for one in (x, other)]
                x = torch.where((costs[1] < costs[0]).unsqueeze(-1), other, x)
            x, equations, ended = minimise_together(pulled, self.windows, x, self.places, tied=self.tied)
        return refinement, x, equations, ended

    def _estimated(
        self, bare: SensedFit, refinement: Refinement, wanted: Sequence[str], x: Tensor, trusted: _Trust
    ) -> dict[str, Population]:
        """Distributions by name, from what windows, or trajectories, tell by themselves at coordinates (1, N, K)."""
        settings, system = refinement.settings, self.stored.model.system
        names = [p.name for p in system.expert_parameters]
        equations = normal_equations(bare, self.windows, x)
        weight = 1 / trusted.of_each
        equations = NormalEquations(
            equations.cost * weight, equations.curvature * weight[:, None, None], equations.slope * weight[:, None]
        )
        found: dict[str, Population] = {}
        known = [*self.places, *(self.tied.places if self.tied is not None else ())]
        for unit in ("window", "trajectory"):
            chosen = [name for name in wanted if (name in settings.tied) == (unit == "trajectory")]
            if not chosen:
                continue
            places = [names.index(name) for name in chosen]
            kept = [k for k in range(x.shape[-1]) if k not in known or k in places]
            part = equations.of(kept)
            curvature, slope, *_ = eliminated(part, [kept.index(k) for k in places], 0.0)
            at, units, clusters = x[0][:, places], NormalEquations(part.cost, curvature, slope), self.groups
            if unit == "trajectory" and self.tied is not None:
                units, at = self.tied.summed(units), at[self.tied.first]
                clusters = np.arange(self.tied.count)
            found |= zip(chosen, _populations(system, chosen, settings, units, at, clusters, unit), strict=True)
        return {name: found[name] for name in wanted}


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
    told = units.curvature.diagonal(dim1=1, dim2=2).sum(0)
    if bool((told <= 0).any()):
        name = chosen[int((told <= 0).nonzero()[0])]
        raise InputError(f"refinement.population.{name}", "the windows do not tell it", "leave it out")
    slopes = steepness.unsqueeze(-1) * steepness.unsqueeze(-2)
    numbers = torch.from_numpy(np.unique(clusters, return_inverse=True)[1])
    one = distribution(units.curvature / slopes, units.slope / steepness, values, numbers)
    middle = torch.where(logarithmic, one.mean.exp(), one.mean)
    error = one.mean_std * torch.where(logarithmic, middle, 1.0)
    pairs = zip(
        _constants(middle, error, clusters), _constants(one.spread, one.spread_std, clusters), forms, strict=True
    )
    return [Population(form=form, middle=m, spread=spread, unit=unit) for m, spread, form in pairs]


def fit_shared_of_seeds(
    stored: StoredModel, refinement: Refinement, train: Trajectories, starts: Tensor | None = None
) -> Refinement:
    """As :func:`fit_shared`, for each seed of a model with its own F_a: its constants have a value of each.

    Arguments:
        stored: a model whose windows are fitted, stacked over S seeds.
        starts: coordinates (S, M) of the constants; None: the medians of fits of single windows.
    """
    each, seeds = [], len(stored.seeds)
    for k in range(seeds):
        of_seed = StoredModel(select(stored.model, [k], seeds), stored.card.of_seeds([k]), stored.classes)
        each.append(fit_shared(of_seed, refinement, train, None if starts is None else starts[k]))
    known: dict[str, object] = {}
    for block, kind in (("shared", Constant), ("sensors", SensorConstants), ("population", Population)):
        if first := getattr(each[0], block):
            known[block] = {name: kind.of_seeds([getattr(one, block)[name] for one in each]) for name in first}
    if each[0].trajectories:
        known["trajectories"] = {
            name: {of: Constant.of_seeds([one.trajectories[name][of] for one in each]) for of in constants}
            for name, constants in each[0].trajectories.items()
        }
    if each[0].overdispersion is not None:
        known["overdispersion"] = sum(one.overdispersion for one in each) / seeds
    if isinstance(each[0].noise, Mapping):
        known["noise"] = {name: sum(one.noise[name] for one in each) / seeds for name in each[0].noise}
    return refinement.model_copy(update=known)


def _rounds(system: System, refinement: Refinement) -> int:
    """How often the noise is estimated anew: where nobody gave it, sensors are estimated, and each observed quantity is
    a component."""
    state = torch.linspace(0.1, 0.2, len(system.state), dtype=torch.float64)
    plain = len(system.state_shape) == 1 and system.observe(state).shape == state.shape
    sensed = bool(refinement.settings.of_sensors)
    return ROUNDS if refinement.noise == ESTIMATED and plain and sensed else 0


def _constants(values: Tensor, errors: Tensor, groups: np.ndarray) -> list[Constant]:
    count, pairs = len(set(groups.tolist())), zip(values.tolist(), errors.tolist(), strict=True)
    return [Constant(value=value, std=error, groups=count) for value, error in pairs]


def groups_of(data: Trajectories) -> np.ndarray:
    """Numbers (N,) of the groups of windows whose residuals are taken as independent: trajectories, or blocks."""
    count = len(data)
    if data.id is None:
        return np.arange(count)
    names = [str(name).rpartition("/")[0] for name in data.id]
    places = np.unique(names, return_inverse=True)[1]
    if len(set(names)) >= FEWEST_GROUPS:
        return places
    return np.minimum(np.arange(count) * BLOCKS // count, BLOCKS - 1) + BLOCKS * places


@dataclass(frozen=True)
class SensorCoordinates:
    """Constants of sensors that are estimated: logarithms of scales, offsets in units of the component's spread.

    Attributes:
        sought: component and name, scale or offset, of each.
        places: of their components in the state of K.
        units: standard deviation of each one's component over the windows, in its unit.
        components: K.
        axes: of a state.
    """

    sought: Sequence[tuple[str, str]]
    places: Sequence[int]
    units: Tensor
    components: int
    axes: int

    @classmethod
    def of(cls, system: System, sought: Sequence[tuple[str, str]], windows: Tensor) -> SensorCoordinates:
        """Of a system, and what was measured of it, (T, 1, N, *state)."""
        names = [p.name for p in system.state]
        places, axis = [names.index(component) for component, _ in sought], windows.dim() - len(system.state_shape)
        columns = [windows.select(axis, place) for place in places]
        spreads = [float(one[~one.isnan()].std()) if (~one.isnan()).sum() > 1 else 1.0 for one in columns]
        units = torch.tensor([spread or 1.0 for spread in spreads], dtype=torch.float64)
        return cls(sought, places, units, len(names), len(system.state_shape))

    def sensors(self, x: Tensor) -> Sensors:
        """Of coordinates (…, M)."""
        of_component = torch.nn.functional.one_hot(torch.tensor(self.places, dtype=torch.long), self.components).to(x)
        is_scale = torch.tensor([name == "scale" for _, name in self.sought])
        scale = (torch.where(is_scale, x, 0.0) @ of_component).exp()
        return Sensors(scale, torch.where(is_scale, 0.0, x * self.units) @ of_component, self.axes)

    def coordinates(self, constants: Mapping[str, SensorConstants]) -> Tensor:
        """Of constants in their units, by component: (M,)."""
        values = torch.tensor([getattr(constants[c], name).value for c, name in self.sought], dtype=torch.float64)
        is_scale = torch.tensor([name == "scale" for _, name in self.sought], dtype=torch.bool)
        return torch.where(is_scale, values.clamp_min(1e-30).log(), values / self.units)

    def constants(self, x: Tensor, std: Tensor, groups: np.ndarray) -> dict[str, SensorConstants]:
        """The constants in their units, by component, of coordinates (M,) with their standard errors; what is hardly
        told is told.

        Arguments:
            groups: numbers of the groups of windows that they are from.
        """
        is_scale = torch.tensor([name == "scale" for _, name in self.sought])
        values, slopes = torch.where(is_scale, x.exp(), x * self.units), torch.where(is_scale, x.exp(), self.units)
        each: dict[str, dict[str, Constant]] = {}
        for (component, name), one, weak in zip(
            self.sought, _constants(values, std * slopes, groups), (std > WEAK).tolist(), strict=True
        ):
            each.setdefault(component, {})[name] = one
            if weak:
                text = "sensors.%s.%s: %.3g (± %.2g): the windows hardly tell it; leave it out"
                logger.warning(text, component, name, one.value, one.std)
        return {component: SensorConstants.of(**constants) for component, constants in each.items()}


class SensedFit:
    """A window's problem with the constants of sensors as further coordinates, after those of the fit.

    Arguments:
        fit: of states that are measured as they are.
        sensors: what is estimated of sensors.
    """

    def __init__(self, fit: WindowFit, sensors: SensorCoordinates) -> None:
        self.fit, self.sensors = fit, sensors
        limits = torch.full((len(sensors.sought),), LONGEST, dtype=torch.float64)
        self.longest = torch.cat((fit.longest, limits))

    def start(self, windows: Tensor) -> Tensor:
        """Coordinates (1, N, K) of fits of each window as if sensors showed the state."""
        x = self.fit.coordinates(self.fit(windows), self.fit.first(windows))
        return torch.cat((x, x.new_zeros(*x.shape[:-1], len(self.sensors.sought))), dim=-1)

    def carried(self, x: Tensor, windows: Tensor, other: SensedFit) -> Tensor:
        """Coordinates (1, N, K) of the same estimates in another fit, of another noise or of longer windows."""
        own, constants = x.tensor_split([sum(self.fit.sizes)], dim=-1)
        seen = self.sensors.sensors(constants).state(windows) if self.sensors.sought else windows
        z_e, z_a, y0 = self.fit.parts(own, self.fit.first(seen))
        own = other.fit.coordinates(Estimates(y0, z_e, z_a), other.fit.first(seen))
        return torch.cat((own, constants), dim=-1)

    def left(self, x: Tensor, windows: Tensor) -> dict[str, float]:
        """Root mean square of what is left of each component at coordinates (1, N, K), with so many degrees of freedom
        as windows have parameters of their own."""
        states = [p.name for p in self.fit.system.state]
        residuals = self.residuals(x.unsqueeze(0), windows)[0]
        data = residuals[..., : residuals.shape[-1] - self.fit.pulls].unflatten(-1, (-1, len(states)))
        count = data.numel() / len(states) - self.fit.missing(windows).sum() / len(states)
        free = 1 - (x.shape[1] * sum(self.fit.sizes) / len(states)) / float(count)
        squares = data.square().sum((0, 1, 2)) / count / max(free, 0.1)
        noise = torch.as_tensor(self.fit.observed_noise, dtype=torch.float64).expand(len(states))
        return dict(zip(states, (squares.sqrt() * noise).tolist(), strict=True))

    def residuals(self, x: Tensor, windows: Tensor) -> Tensor:
        """As :meth:`WindowProblem.residuals`, in units of what is measured."""
        if not self.sensors.sought:
            return self.fit.residuals(x, windows)
        copies, seeds, count = x.shape[:3]
        wide = x.movedim(0, 1).flatten(1, 2)
        observed = windows.repeat(1, 1, copies, *[1] * (windows.dim() - 3))
        own, constants = wide.tensor_split([sum(self.fit.sizes)], dim=-1)
        sensors = self.sensors.sensors(constants)
        states = sensors.measured(self.fit.states(own, sensors.state(observed)))
        data = self.fit.differences(states, observed)
        return torch.cat((data, self.fit.pull(own)), -1).view(seeds, copies, count, -1).movedim(1, 0)


@torch.no_grad()
def minimise_together(
    fit: WindowProblem | SensedFit,
    windows: Tensor,
    x: Tensor,
    places: Sequence[int],
    tolerance: float = TOLERANCE,
    steps: int = STEPS,
    tied: Tied | None = None,
) -> tuple[Tensor, NormalEquations, bool]:
    """Coordinates (1, N, K) at the minimum of all windows' sum of squares, the equations there, and whether it is one.

    Arguments:
        fit: the windows' problems.
        windows: (T, 1, N, *observed), float64.
        x: where to start, (1, N, K), the same for all windows at the shared places.
        places: of the shared coordinates.
        tolerance: of the cost, within which the windows together are at their minimum.
        steps: at most so many.
        tied: coordinates of trajectories, where x is the same for all of its windows.
    """
    if not places and tied is None:
        x = minimise_each(fit, windows, x)
        return x, normal_equations(fit, windows, x), True
    now, damping, done = normal_equations(fit, windows, x), DAMPING, False
    for _ in range(steps):
        trial = x + _step(now, places, damping, fit.longest, tied)
        new = normal_equations(fit, windows, trial)
        gain = float(now.cost.sum() - new.cost.sum())
        if gain > 0:
            x, now, damping = trial, new, damping * LESS
        else:
            damping *= MORE
        done = damping > TIGHTEST or 0 < gain <= tolerance * float(now.cost.sum())
        if done:
            break
    return x, now, done


@torch.no_grad()
def normal_equations(fit: WindowProblem | SensedFit, windows: Tensor, x: Tensor) -> NormalEquations:
    """The equations of windows (T, 1, N, *observed) at coordinates (1, N, K)."""
    parts, size = [], max(1, MEMORY // (windows[:, :, :1].numel() * 8 * (x.shape[-1] + 1)))
    for first in range(0, x.shape[1], size):
        some = windows[:, :, first : first + size]

        def residuals(candidates: Tensor, columns: Tensor, some: Tensor = some) -> Tensor:
            return fit.residuals(candidates, some[:, :, columns])

        parts.append(linearised(residuals, x[:, first : first + size]))
    return NormalEquations(*(torch.cat([part[k][0] for part in parts]) for k in range(3)))


def eliminated(
    equations: NormalEquations, places: Sequence[int], damping: float
) -> tuple[Tensor, Tensor, Tensor, Tensor, list[int]]:
    """What each window says of the shared coordinates once its own are eliminated: curvature (N, M, M) and slope
    (N, M); how its own follow, (N, K − M, M) and (N, K − M); and the places of its own."""
    own = [k for k in range(equations.slope.shape[1]) if k not in places]
    curvature, slope = equations.curvature, equations.slope
    inner = curvature[:, own][:, :, own]
    diagonal = inner.diagonal(dim1=1, dim2=2)
    floor = 1e-9 * diagonal.amax(-1, keepdim=True).clamp_min(1e-30) if own else diagonal
    inner = inner + torch.diag_embed(damping * diagonal + floor)
    across = curvature[:, own][:, :, places]
    follow = torch.linalg.solve(inner, across)
    rest = torch.linalg.solve(inner, slope[:, own].unsqueeze(-1)).squeeze(-1)
    reduced = curvature[:, places][:, :, places] - across.mT @ follow
    left = slope[:, places] - (across.mT @ rest.unsqueeze(-1)).squeeze(-1)
    return reduced, left, follow, rest, own


def _step(
    equations: NormalEquations, places: Sequence[int], damping: float, longest: Tensor, tied: Tied | None = None
) -> Tensor:
    """The damped step (1, N, K)."""
    step, count = torch.zeros_like(equations.slope), len(equations.cost)
    if tied is None:
        reduced, left, follow, rest, own = eliminated(equations, places, damping)
        shared = _shared_step(reduced, left, damping, longest[list(places)])
        outer, moved, along = list(places), shared.expand(count, -1), follow @ shared
    else:
        outer, size = [*tied.places, *places], len(tied.places)
        reduced, left, follow, rest, own = eliminated(equations, outer, damping)
        of_groups = tied.summed(NormalEquations(equations.cost, reduced, left))
        reduced, left, follow_group, rest_group, _ = eliminated(of_groups, range(size, len(outer)), damping)
        shared = _shared_step(reduced, left, damping, longest[list(places)])
        limit = longest[list(tied.places)]
        of_each = -(rest_group + follow_group @ shared).clamp(-limit, limit)
        moved = torch.cat((of_each[tied.groups], shared.expand(count, -1)), dim=-1)
        along = (follow @ moved.unsqueeze(-1)).squeeze(-1)
    step[:, outer] = moved
    step[:, own] = -(rest + along)
    return step.nan_to_num(0.0, 0.0, 0.0).clamp(-longest, longest).unsqueeze(0)


def _shared_step(reduced: Tensor, left: Tensor, damping: float, limit: Tensor) -> Tensor:
    """Of the shared coordinates, (M,), by what each window or trajectory says of them."""
    total = reduced.sum(0)
    if not len(total):
        return left.sum(0)
    damped = total + torch.diag(damping * total.diagonal() + 1e-12 * total.diagonal().amax())
    return -torch.linalg.solve(damped, left.sum(0)).clamp(-limit, limit)


def _of_groups(
    equations: NormalEquations, places: Sequence[int], tied: Tied | None
) -> tuple[NormalEquations, Sequence[int]]:
    """Equations in which whatever tells shared coordinates apart is a row: windows, or trajectories where windows have
    something in common; and the places of the shared coordinates there."""
    if tied is None:
        return equations, places
    outer = [*tied.places, *places]
    reduced, left, *_ = eliminated(equations, outer, 0.0)
    return tied.summed(NormalEquations(equations.cost, reduced, left)), range(len(tied.places), len(outer))


@torch.no_grad()
def minimise_each(
    fit: WindowProblem | SensedFit, windows: Tensor, x: Tensor, fixed: Sequence[int] = (), steps: int = STEPS
) -> Tensor:
    """Coordinates (1, N, K) at each window's own minimum, after at most so many steps, some of them held."""
    own = [k for k in range(x.shape[-1]) if k not in fixed]
    if not own:
        return x
    parts, size = [], max(1, MEMORY // (windows[:, :, :1].numel() * 8 * (len(own) + 1)))
    for first in range(0, x.shape[1], size):
        some, held = windows[:, :, first : first + size], x[:, first : first + size]

        def residuals(candidates: Tensor, columns: Tensor, some: Tensor = some, held: Tensor = held) -> Tensor:
            whole = held[:, columns].expand(len(candidates), -1, -1, -1).clone()
            whole[..., own] = candidates
            return fit.residuals(whole, some[:, :, columns])

        found = held.clone()
        found[..., own] = minimise(residuals, held[..., own], steps, fit.longest[own]).x
        parts.append(found)
    return torch.cat(parts, dim=1)


def _check_told(equations: NormalEquations, places: Sequence[int], names: Sequence[str]) -> None:
    """Refuse shared constants that make up for each other, or that move nothing.

    Raises:
        InputError: their names.
    """
    total = eliminated(equations, places, 0.0)[0].sum(0)
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
        told = f"cannot be told apart from {' and '.join(others)}" if others and not dead else "moves nothing"
        raise InputError(f"refinement.{first}", f"{told} in these windows", "leave it out")


def clustered_variances(equations: NormalEquations, places: Sequence[int], groups: np.ndarray) -> Tensor:
    """Of the shared coordinates, (M,), from how the groups' slopes scatter, as leaving each group out once would tell
    (Bell & McCaffrey 2002): errors are not too small where groups are few.  Where few of them tell a constant their
    scatter is often too small by chance: never less than what the noise alone makes, by the curvature."""
    reduced, left, *_ = eliminated(equations, places, 0.0)
    inverse = torch.linalg.pinv(reduced.sum(0))
    numbers = torch.from_numpy(np.unique(groups, return_inverse=True)[1])
    count, size = int(numbers.max()) + 1, len(places)
    least = inverse.diagonal().clamp_min(0)
    if count == 1:
        return least
    slopes = torch.zeros(count, size, dtype=left.dtype).index_add_(0, numbers, left)
    curvatures = torch.zeros(count, size, size, dtype=left.dtype).index_add_(0, numbers, reduced)
    others = torch.eye(size, dtype=left.dtype) - curvatures @ inverse
    slopes = (torch.linalg.pinv(others) @ slopes.unsqueeze(-1)).squeeze(-1)
    scatter = (count - 1) / count * inverse @ (slopes.mT @ slopes) @ inverse
    return torch.maximum(scatter.diagonal(), least)

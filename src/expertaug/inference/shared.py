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

import numpy as np
import torch
from torch import Tensor

from expertaug import systems
from expertaug.errors import InputError
from expertaug.inference.least_squares import MEMORY, WindowFit, WindowProblem, estimator_of
from expertaug.inference.levenberg_marquardt import DAMPING, LESS, LONGEST, MORE, TIGHTEST, linearised
from expertaug.learning.settings import UntrainedJob
from expertaug.learning.train import Calibration, describe_recipe, make_untrained
from expertaug.learning.training_data import set_files
from expertaug.models import store
from expertaug.models.observation_noise import ESTIMATED
from expertaug.models.posterior import Estimates
from expertaug.models.sensors import Sensors, check_components
from expertaug.models.settings import Constant, Refinement, SensorConstants
from expertaug.models.stacking import select
from expertaug.models.store import StoredModel
from expertaug.settings import given_ranges
from expertaug.systems import System
from expertaug.trajectories import Trajectories
from expertaug.windows import Windows

logger = logging.getLogger(__name__)
STEPS = 60
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
    """The refinement with constants for what its settings call shared, parameters and sensors' constants, fitted to
    the whole training windows: what they show after the observed part is known, and tells the constants best.

    Standard errors are those of clustered observations (Liang & Zeger 1986), by trajectory, or, of fewer than eight, by
    blocks of windows in their order: residuals of a model that is not quite right are correlated along a trajectory and
    over windows that overlap, and the curvature alone, which is their least, gives errors that are several times too
    small.

    Where the noise is estimated and sensors are among the constants, it is in the end what these fits leave of each
    component.  Without the sensors what is left is no noise: one component contradicts the integral of another.

    Arguments:
        stored: the expert alone, or one seed of a model whose windows are fitted.
        refinement: with a prior, in which the fits of single windows start.
        train: windows of what shares the parameters, with their identities, where they have any.
        start: coordinates (M,) of the constants, parameters first; None: the medians of fits of single windows.

    Raises:
        InputError: a name that is no expert parameter or no component, no prior, or windows that do not tell a
            sensor's constant.
    """
    names = [p.name for p in stored.model.system.expert_parameters]
    shared, sought = refinement.settings.shared, refinement.settings.of_sensors
    if wrong := sorted({*(refinement.settings.units or {})} - set(names)):
        raise InputError(f"units.{wrong[0]}", "is no expert parameter", f"known: {', '.join(names)}")
    check_components(stored.model.system, refinement.settings.sensors or {})
    if not refinement.settings.shares:
        return refinement
    if refinement.prior is None:
        raise InputError("units", "given without a prior", "give a range of each parameter in which fits start")
    each = refinement.settings.model_copy(update={"units": {}, "sensors": {}})
    whole = Windows.of(train)
    sensors = SensorCoordinates.of(stored.model.system, sought, whole.y)
    # The observed part first: a forecast over all of a window has more minima, and is near the best one from there.
    parts = sorted({stored.card.observed, whole.points})
    before: tuple[SensedFit, Tensor, Tensor] | None = None  # the last fit, its windows and coordinates
    for points in (*parts, *[whole.points] * _rounds(stored.model.system, refinement)):
        if before is not None and len(before[1]) == whole.points:
            refinement = refinement.model_copy(update={"noise": before[0].left(before[2], before[1])})
        of_part = replace(stored, card=stored.card.but(observed=points))
        fit = estimator_of(of_part, each, refinement.noise, given_ranges(refinement.prior)).fit
        windows, own = whole.until(points).joined.double(), sum(fit.sizes)
        places = [*(names.index(name) for name in shared), *range(own, own + len(sought))]
        sensed = SensedFit(fit, sensors)
        if before is None:
            x = sensed.start(windows)
            x[..., places] = x[..., places].median(dim=1, keepdim=True).values if start is None else start
        else:
            x = before[0].carried(before[2], windows, sensed)
        x, equations, ended = minimise_together(sensed, windows, x, places)
        if not ended:
            text = "shared parameters: the fit has not ended after %d steps; narrow the prior or share less"
            logger.warning(text, STEPS)
        before = sensed, windows, x
    if sought:
        _check_told(equations, places, [*shared, *(f"sensors.{component}.{name}" for component, name in sought)])
    groups = groups_of(train)
    std = clustered_variances(equations, places, groups).sqrt()
    values = fit.parts(x[..., :own], fit.first(windows))[0][0, 0, places[: len(shared)]]
    errors = std[: len(shared)] * fit.expert.slope(x[0, 0, : len(names)])[places[: len(shared)]]
    changes: dict[str, object] = {}
    if shared:
        changes["shared"] = dict(zip(shared, _constants(values, errors, groups), strict=True))
    if sought:
        changes["sensors"] = sensors.constants(x[0, 0, own:], std[len(shared) :], groups)
    return refinement.model_copy(update=changes)


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
    known: dict[str, dict] = {}
    for block, kind in (("shared", Constant), ("sensors", SensorConstants)):
        if first := getattr(each[0], block):
            known[block] = {name: kind.of_seeds([getattr(one, block)[name] for one in each]) for name in first}
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
        data = residuals[..., : residuals.shape[-1] - self.fit.sizes[1]].unflatten(-1, (-1, len(states)))
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
) -> tuple[Tensor, NormalEquations, bool]:
    """Coordinates (1, N, K) at the minimum of all windows' sum of squares, the equations there, and whether it is one.

    Arguments:
        fit: the windows' problems.
        windows: (T, 1, N, *observed), float64.
        x: where to start, (1, N, K), the same for all windows at the shared places.
        places: of the shared coordinates, at least one.
        tolerance: of the cost, within which the windows together are at their minimum.
        steps: at most so many.
    """
    now, damping, done = normal_equations(fit, windows, x), DAMPING, False
    for _ in range(steps):
        trial = x + _step(now, places, damping, fit.longest)
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


def _step(equations: NormalEquations, places: Sequence[int], damping: float, longest: Tensor) -> Tensor:
    """The damped step (1, N, K)."""
    reduced, left, follow, rest, own = eliminated(equations, places, damping)
    total = reduced.sum(0)
    damped = total + torch.diag(damping * total.diagonal() + 1e-12 * total.diagonal().amax())
    limit = longest[list(places)]
    shared = -torch.linalg.solve(damped, left.sum(0)).clamp(-limit, limit)
    step = torch.zeros_like(equations.slope)
    step[:, places] = shared
    step[:, own] = -(rest + follow @ shared)
    return step.nan_to_num(0.0, 0.0, 0.0).clamp(-longest, longest).unsqueeze(0)


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

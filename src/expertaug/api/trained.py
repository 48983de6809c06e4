"""Trained models: forecasts, estimates, metrics, files; which windows they explain as well as validation windows."""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TypeVar, Unpack

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from expertaug.api import arguments
from expertaug.api.arguments import Array, Noise, Ranges, RefinementOptions
from expertaug.api.forecasts import Forecast
from expertaug.errors import InputError
from expertaug.evaluation.estimates import MOST_OPEN, Estimate, Stated, open_in, summarise
from expertaug.evaluation.forecasts import constants_of
from expertaug.evaluation.score import score
from expertaug.evaluation.settings import Scoring
from expertaug.inference.diagnostics.alarm import FALSE_ALARMS, attainable, threshold
from expertaug.inference.diagnostics.goodness import find_unexplained, is_too_small
from expertaug.inference.expected_error import expected_errors, record_misfits
from expertaug.inference.flow import load as load_any
from expertaug.inference.least_squares import LeastSquares, refine_by, with_overdispersion
from expertaug.inference.shared import fit_shared, fit_shared_of_seeds
from expertaug.learning.residuals import window_residual
from expertaug.models import store
from expertaug.models.card import MisfitRecord
from expertaug.models.doubts import doubts_of
from expertaug.models.fit_settings import Refinement, RefinementSettings
from expertaug.models.observation_noise import is_some, noise_of
from expertaug.models.posterior import Estimates, Predictor
from expertaug.models.stacking import select
from expertaug.models.store import StoredModel, device_of
from expertaug.models.support import outside_support
from expertaug.rows import frame
from expertaug.systems import System
from expertaug.systems.solvers.solver import Solver
from expertaug.trajectories import Trajectories, brief
from expertaug.windows import Windows

T = TypeVar("T")

STARTS = ("y0", "y_t1")
FEWEST = 19  # validation windows of which one in twenty can be told
RARE = 0.01  # share of false alarms by the misfit where the error to be expected is the alarm
DOUBT = (
    "%d of %d windows are explained worse than 95 %% of the validation windows (trusted is False): the model may not "
    "hold there"
)
LARGE = (
    "%d of %d windows are not to be trusted (trusted is False): the expected error of the forecast is larger "
    "than for 95 %% of the validation windows, or the window is explained worse than 99 %% of them"
)
OUTSIDE = (
    "%d of %d windows have a z_e or z_a outside the range of the training windows' (outside is True): nothing has "
    "tested the model there"
)
UNEXPLAINED = (
    "the model does not explain %d of %d windows to within their noise (p_chi2 is small): the expert lacks "
    "something, or the noise is larger than stated"
)
TOO_WELL = (
    "these windows are explained far better than their noise allows (χ² %.2g per degree of freedom, not 1): the noise "
    "is stated about %.2g times too large, and intervals are as much too wide"
)
BEYOND = "the forecast goes on to %g s, beyond the %g s of the training's times: trusted is about what comes before"
NO_NOISE = (
    "the noise is 0, and residuals are about %.2g times what that allows: intervals are too narrow and the first point "
    "counts as exact; give the data's noise, or a model that explains them"
)
OPEN = (
    "%.0f %% of the windows do not tell %s by themselves: a mean of their estimates is not told; where windows share "
    "it, fit it to all of them (units={'%s': 'shared'})"
)
UNSTATED = 9.0  # of residuals' mean square, with a noise of 0
logger = logging.getLogger(__name__)


def warn_of_noise(refinement: Refinement) -> None:
    """Tell where fits of training windows leave far more than a noise that was given as 0."""
    most = max(refinement.overdispersion or [0.0])
    if refinement.noise == 0 and "noise" not in refinement.settings.model_fields_set and most > UNSTATED:
        logger.warning(NO_NOISE, most**0.5)


@dataclass(frozen=True, eq=False)
class TrainedModel:
    """A model trained for a group of seeds; ``model[0]`` is its first seed alone, ``len(model)`` their number.

    What one seed returns is batch first, (N, …); what a group returns has the seeds before, (S, N, …).

    Attributes:
        stored: network and card, as a model file holds them.
        history: course of the training: columns step, seed, metric, value; empty for a model from a file.
        single: whether this is one seed.
        refinement: settings, noise and prior of the least squares by which estimates are found on each window; None for
            the model's own estimates (:meth:`refined`).
        misfits: of validation windows, where they are not the file's (:meth:`watched`).
    """

    stored: StoredModel
    history: pd.DataFrame = field(default_factory=lambda: pd.DataFrame(columns=["step", "seed", "metric", "value"]))
    single: bool = False
    refinement: Refinement | None = None
    misfits: MisfitRecord | None = None

    @cached_property
    def predictor(self) -> Predictor:
        """What estimates and forecasts."""
        if self.refinement is None:
            return self.stored.model  # type: ignore[return-value]
        with arguments.one_thread():
            return refine_by(self.stored, self.refinement)

    @property
    def seeds(self) -> list[int]:
        """The seeds, in the group's order."""
        return self.stored.seeds

    @property
    def system(self) -> System:
        """The system, which gives the expert."""
        return self.stored.model.system  # type: ignore[return-value]

    @property
    def t(self) -> np.ndarray:
        """All times of the training set in s, (T,)."""
        return np.array(self.stored.card.t, dtype=np.float64)

    @property
    def observed(self) -> int:
        """Points of the observed window, T1."""
        return self.stored.card.observed

    @property
    def solver(self) -> Solver:
        """What forecasts are solved with, unless they are asked for with another."""
        return self.stored.solver

    @property
    def label(self) -> str:
        """Name of the method, as tables and figures show it."""
        return self.stored.card.label

    def __repr__(self) -> str:
        window = brief(self.t[: self.observed])
        return f"TrainedModel({self.label}, {type(self.system).__name__}, seeds {self.seeds}, observes {window})"

    def __len__(self) -> int:
        return len(self.seeds)

    def __getitem__(self, place: int | slice | Sequence[int]) -> TrainedModel:
        """One seed by its place in the group, or some of them by a slice or their places."""
        every = range(len(self))
        places = [every[k] for k in place] if isinstance(place, Sequence) else every[place]
        single = isinstance(places, int)
        chosen = [places] if single else list(places)
        if not chosen:
            raise IndexError(f"no seeds at {place}: the group has {len(self)}")
        card = self.stored.card.of_seeds(chosen)
        model = select(self.stored.model, chosen, len(self))
        history = self.history.loc[self.history["seed"].isin(card.seeds)]
        misfits = None if self.misfits is None else self.misfits.of_seeds(chosen)
        stored = StoredModel(model, card, self.stored.classes)
        refinement = None if self.refinement is None else self.refinement.of_seeds(chosen)
        return TrainedModel(stored, history, single, refinement, misfits)

    def __iter__(self) -> Iterator[TrainedModel]:
        return (self[k] for k in range(len(self)))

    def forecast(
        self,
        window: Array,
        t: Array | Sequence[float],
        *,
        u: Array | None = None,
        solver: Solver | None = None,
        start: str = "y0",
        of: Sequence[str] | None = None,
    ) -> Forecast:
        """Forecast from observed windows.

        An adaptive solver takes steps that suit all windows and seeds at once: forecasts of one among others differ
        from those of it alone within its tolerance.

        Arguments:
            window: observed states, (N, T1, *state), NumPy or torch; of a model that learned from measurements with NaN
                where nothing was measured.
            t: times in s, (T,); the first T1 are the window's and must be those that the model was trained on, the
                others, where states are wanted, are free.
            u: known inputs at all these times, (N, T, U), of a system that has some.
            solver: instead of :attr:`solver`.
            start: y0: integrate from the first point; y_t1: from the last observed one, and return the window before.
            of: names of the trajectories that the windows are of, (N,): those of training trajectories, where a
                model knows parameters of each (``units={NAME: "trajectory"}``), have these.

        Returns:
            states and estimates, NumPy or torch as the window is.

        Raises:
            InputError: another shape than the model's, other times, or values that are not finite.
            SolveError: an adaptive solver fails.
        """
        windows, t = self._windows(window, t, u, of)
        if start not in STARTS:
            raise InputError("start", repr(start), f"one of {', '.join(STARTS)}")
        with torch.no_grad(), arguments.one_thread():
            estimates = self.predictor.estimate(windows)  # type: ignore[attr-defined]
            states = self.predictor.predicted(estimates, windows, solver or self.solver, start)
        y = states.movedim(0, 2)
        units = {p.name: p.unit for p in self.system.state} | {
            f"z_e {p.name}": p.unit for p in self.system.expert_parameters
        }
        y = arguments.like(y[0] if self.single else y, window)
        named, std = self._named(estimates.z_e, window), self._named(estimates.z_e_std, window)
        chi2, misfit = estimates.chi2, None
        if start == "y0":  # else the forecast begins with the window itself
            misfit = window_residual(self.system, states, windows.y)
        outside = outside_support(self.system, self._as_used.card, estimates)
        trusted = None if misfit is None else self._trusted(misfit, outside, estimates, windows)
        _warn_of_most(outside, OUTSIDE)
        if trusted is not None and t[-1] > self.t[-1] + arguments.TIME_TOLERANCE * (self.t[-1] - self.t[0]):
            logger.warning(BEYOND, t[-1], self.t[-1])
        doubts = doubts_of(self.system, self._as_used.card, estimates)
        if doubts is not None:
            doubts.warn()
        each = [
            None if value is None else arguments.like(value[0] if self.single else value, window)
            for value in (chi2, misfit, self._probability(chi2, windows), outside, trusted)
        ]
        return Forecast(t, y, named, units, self.seeds, std, *each, doubts=doubts, failed=self.stored.failed)

    def estimate(
        self,
        window: Array,
        t: Array | Sequence[float],
        *,
        u: Array | None = None,
        of: Sequence[str] | None = None,
    ) -> dict[str, Array]:
        """Estimates of the expert parameters, without a forecast.

        Arguments:
            window, t, u, of: as of :meth:`forecast`.

        Returns:
            by name, (N,) each, in the system's units; nothing for a model that estimates none.
        """
        windows, _ = self._windows(window, t, u, of)
        with torch.no_grad(), arguments.one_thread():
            estimates = self.predictor.estimate(windows)  # type: ignore[attr-defined]
        return self._named(estimates.z_e, window)

    def estimates(self, data: Trajectories) -> pd.DataFrame:
        """The parameters as the model states them of a set's windows, with standard errors and 90 % intervals: shared
        ones, the mean and the spread of all trajectories, and each trajectory (:mod:`expertaug.evaluation.estimates`).

        Arguments:
            data: with the times of the training up to the end of the observed window; windows of one trajectory have
                identities ``trajectory/first row`` (``id``), without which each is a trajectory of its own.

        Returns:
            a row for each :class:`expertaug.evaluation.estimates.Estimate`.

        Raises:
            InputError: the set is of another system or of other times.
        """
        data = arguments.trajectories(data, "data")
        windows, _ = self._windows(data.seen[:, : self.observed], data.t, data.u, data.trajectories)
        with torch.no_grad(), arguments.one_thread():
            estimates = self.predictor.estimate(windows)  # type: ignore[attr-defined]
        rows = []
        if estimates.z_e is not None and self.stored.model.knows_z_e:
            truth = bool(self.stored.card.truth)
            parameters = [*self.system.expert_parameters, *(self.system.interaction_parameters if truth else ())]
            values, std = (None if v is None else v.cpu().double().numpy() for v in estimates.stated(truth))
            fit = self.refinement
            shared = (self.stored.card if fit is None else self.stored.card.but(refinement=fit)).shared_groups
            names, units = [p.name for p in parameters], [p.unit for p in parameters]
            ranges = fit.prior if fit is not None and isinstance(fit.prior, Mapping) else {}
            constants = constants_of(fit, *({p.name: p.unit for p in of} for of in (parameters, self.system.state)))
            positive = [p.name for p in parameters if p.positive]
            stated = Stated(values, std, names, units, data.id, shared, constants, positive)  # type: ignore[arg-type]
            rows = summarise(stated, ranges)
            for name, share in open_in(stated, ranges).items():
                if share > MOST_OPEN and name not in shared:
                    logger.warning(OPEN, 100 * share, name, name)
        return frame(Estimate, rows)

    def evaluate(
        self,
        data: Trajectories,
        *,
        from_s: float | None = None,
        max_samples: int | None = None,
        solver: Solver | None = None,
        start: str = "y0",
    ) -> pd.DataFrame:
        """Metrics of the forecasts of a set (:mod:`expertaug.evaluation.metrics`).

        Arguments:
            data: with the times of the training up to the end of the observed window, and with z_e.
            from_s: the metrics see times from there on; None: those after the observed window.
            max_samples: at most so many, evenly spread.
            solver, start: as of :meth:`forecast`.

        Returns:
            columns seed, metric, value.

        Raises:
            InputError: the set is of another system or of other times.
        """
        data = arguments.trajectories(data, "data").spread(max_samples)
        first = self.t[self.observed - 1] if from_s is None else from_s
        if not (data.t > first if from_s is None else data.t >= first).any():
            problem = f"has the times {brief(data.t)}"
            raise InputError(
                "data", problem, f"none {'after' if from_s is None else 'from'} {first:g} s: nothing to score"
            )
        windows, _ = self._windows(data.seen[:, : self.observed], data.t, data.u)
        if data.z_e.shape[1] != len(self.system.expert_parameters):
            names = ", ".join(p.name for p in self.system.expert_parameters)
            raise InputError("data", f"z_e has shape {data.z_e.shape}", f"the expert parameters are {names}")
        if start not in STARTS:
            raise InputError("start", repr(start), f"one of {', '.join(STARTS)}")
        scoring = Scoring.of(from_s=from_s, solver=dict(vars(solver or self.solver)), draws=0)
        with arguments.one_thread():
            scored = score(self._as_used, data, scoring, start, windows.y.device)
        rows = [(seed, metric, value) for metric, seed, value in scored.of_seeds(self.seeds)]
        return pd.DataFrame(rows, columns=["seed", "metric", "value"])

    def refined(
        self, *, noise: Noise = 0.0, prior: Ranges | None = None, **options: Unpack[RefinementOptions]
    ) -> TrainedModel:
        """The same model with estimates refined by least squares on each window: z_e, z_a, and y0 where data are noisy.

        Arguments:
            noise: standard deviation of the data's noise.
            prior: ranges [low, high] by parameter, in its unit, in which further starts lie; None: each fit starts from
                the model's own estimate alone.
            options: see :class:`expertaug.models.fit_settings.RefinementSettings`.

        Raises:
            InputError: an option that cannot be used, or a model without an expert.
        """
        names = [p.name for p in self.system.expert_parameters]
        ranges = None if prior is None else arguments.ranges(prior, names, "prior")
        how = RefinementSettings.from_mapping(options)
        refinement = Refinement.of(settings=how, noise=arguments.noise(noise), prior=ranges)
        model = replace(self, refinement=refinement, misfits=None)
        _ = model.predictor  # says what is wrong with the options
        return model

    def together(
        self, data: Trajectories, *, prior: Ranges | None = None, **options: Unpack[RefinementOptions]
    ) -> TrainedModel:
        """The same model for one apparatus: constants that all of these windows share, fitted to their observed parts
        together.  Nothing after the observed window is looked at, so that they may be the windows to be forecast.

        Arguments:
            data: windows of the apparatus, with the times of the training at least to the end of the observed window.
            prior: ranges [low, high] by parameter in which fits start; None: those of the model.
            options: of which ``units`` says what is shared, and ``sensors`` which constants of sensors; else as of the
                model.

        Raises:
            InputError: a model whose estimates are no fits of windows, nothing that is shared, or other times.
        """
        if self.refinement is None:
            problem = f"the estimates of {self.label} are no fits of windows"
            raise InputError("model", problem, "give least squares, or an alternating or refined model (refined())")
        data = arguments.trajectories(data, "data")
        _ = self._windows(data.seen[:, : self.observed], data.t[: self.observed], data.u)
        overrides = RefinementSettings.from_mapping(options)
        how = self.refinement.settings.model_copy(
            update={name: getattr(overrides, name) for name in overrides.model_fields_set}
        )
        how = how.model_copy(update={"population": _without(how.population, how.shared)})
        if not how.shares:
            raise InputError("units", "nothing is shared", "say of a parameter that it is: units={NAME: 'shared'}")
        names = [p.name for p in self.system.expert_parameters]
        ranges = self.refinement.prior if prior is None else arguments.ranges(prior, names, "prior")
        fitting = self.refinement.model_copy(
            update={
                **{"settings": how, "prior": ranges, "shared": None, "sensors": None, "trajectories": None},
                # The apparatus is one of what the distributions of the training are of.
                "population": _without(self.refinement.population, {*how.shared, *(overrides.population or {})}),
            }
        )
        with arguments.one_thread():
            fit = fit_shared if self.stored.kind.is_classical() else fit_shared_of_seeds
            return replace(self, refinement=fit(self.stored, fitting, data.window(0, self.observed)), misfits=None)

    def watched(self, validation: Trajectories) -> TrainedModel:
        """The same model with an alarm: misfits of these windows say above which one a forecast is not trusted, and, of
        a refined model, how far residuals are from the noise, by which intervals widen.

        What trains a model with a validation set keeps them already; refined models and least squares need it.

        Arguments:
            validation: windows like the training's, on which nothing was fitted; 19 or more.
        """
        seen = arguments.trajectories(validation, "validation").seen[:, : self.observed]
        windows, _ = self._windows(seen, validation.t, validation.u)
        with arguments.one_thread():
            model = self
            if self.refinement is not None:
                model = replace(self, refinement=with_overdispersion(self.stored, self.refinement, validation))
            return replace(model, misfits=record_misfits(model._as_used, windows.seed(slice(1))))

    @property
    def _as_used(self) -> StoredModel:
        """What estimates and forecasts, with a card that says how windows are fitted."""
        card = self.stored.card
        changed = card if self.refinement == card.refinement else card.but(refinement=self.refinement)
        return replace(self.stored, model=self.predictor, card=changed)

    def _probability(self, chi2: Tensor | None, windows: Windows) -> Tensor | None:
        """Of so large a χ² (S, N) per degree of freedom, with the noise that is known; None where none is."""
        used, refinement = self.predictor, self.refinement
        if chi2 is None or refinement is None or not isinstance(used, LeastSquares):
            return None
        noise_is_given = "noise" in refinement.settings.model_fields_set
        if not noise_is_given and not is_some(noise_of(refinement.noise, self.system, self.stored.card)):
            return None
        freedom = used.fit.degrees_of_freedom(windows.joined.cpu()).to(chi2).expand_as(chi2)
        each = zip(chi2.double().cpu().numpy(), freedom.double().cpu().numpy(), strict=True)
        beyond = np.stack([find_unexplained(np.nan_to_num(of_seed, nan=np.inf), dof) for of_seed, dof in each])
        _warn_of_most(torch.from_numpy(beyond), UNEXPLAINED)
        total = float((chi2.nan_to_num() * freedom).sum() / freedom.sum())
        if is_too_small(total, float(freedom.sum()) / len(freedom)):  # seeds see the same windows
            logger.warning(TOO_WELL, total, total**-0.5 if total > 0 else np.inf)
        return torch.special.gammaincc(freedom / 2, freedom * chi2 / 2)

    def _trusted(self, misfit: Tensor, outside: Tensor | None, estimates: Estimates, windows: Windows) -> Tensor | None:
        """Whether each misfit (S, N) is one that the validation windows have too, the error that is expected likewise,
        and the window none outside; None where theirs are not known."""
        kept = self.misfits
        if kept is None and self.refinement == self.stored.card.refinement:
            kept = self.stored.card.misfit
        expected = None
        if kept is not None and kept.expected is not None:
            expected = expected_errors(self._as_used, estimates, windows)
        trusted = judge(misfit, kept, expected)
        return trusted if trusted is None or outside is None else trusted & ~outside.to(trusted.device)

    def save(self, path: str | Path) -> None:
        """Write a model file, which :func:`load` and the command line read; of a refined model the model itself.

        Raises:
            InputError: it cannot be written.
        """
        store.save(path, self.stored.model, self.stored.card)

    def _windows(
        self, window: object, t: object, u: object = None, of: Sequence[str] | np.ndarray | None = None
    ) -> tuple[Windows, np.ndarray]:
        """Windows, y (T1, S, N, *state), on the model's device, and all times in double precision."""
        y, t = arguments.tensor(window, "window", self.stored.card.start is not None), arguments.times(t)
        state, points = self.system.state_shape, self.observed
        if y.dim() != 2 + len(state) or y.shape[2:] != state or not len(y):
            names = ", ".join(p.name for p in self.system.state)
            wanted = f"(N, {points}, {', '.join(map(str, state))})"
            raise InputError("window", f"has shape {tuple(y.shape)}", f"give {wanted}: the state is {names}")
        remedy = "give the window at these times, the first of t"
        arguments.same_times(t[: y.shape[1]], self.t[:points], "window", remedy)
        if self.stored.kind.fixed_times and len(t) > points:
            arguments.same_times(t, self.t, "t", "the mean of the training set has no others")
        names = None if of is None else np.array(list(map(str, of)))
        if names is not None and len(names) != len(y):
            raise InputError("of", f"{len(names)} names for {len(y)} windows", "give the trajectory of each")
        inputs = arguments.inputs(u, self.system, len(y), t)
        y, inputs = (None if x is None else arguments.stack_seeds(x.to(self._device), len(self)) for x in (y, inputs))
        windows = Windows(torch.from_numpy(t).float().to(self._device), y, inputs, names)  # type: ignore[arg-type]
        return windows if inputs is None else windows.contiguous(), t  # rounding depends on how they lie

    @property
    def _device(self) -> torch.device:
        return next((x.device for x in self.stored.model.state_dict().values()), torch.device("cpu"))

    def _named(self, z_e: Tensor | None, window: object) -> dict[str, Array]:
        """Estimates (S, N, P) by name."""
        if z_e is None or not self.stored.model.knows_z_e:
            return {}
        z_e = z_e[0] if self.single else z_e
        return {p.name: arguments.like(z_e[..., k], window) for k, p in enumerate(self.system.expert_parameters)}


def load(path: str | Path, *, classes: Collection[str | Callable] = (), device: str = "cpu") -> TrainedModel:
    """Read a model file, of this package's functions or of a workflow's run.

    Arguments:
        classes: where the model is made of classes of your own: these, or their names ``package.module:Class``.  A file
            that names others is refused: nothing is imported that you do not name.
        device: auto, cpu or cuda.

    Raises:
        InputError: the file is missing, damaged or no model file, or needs a class that ``classes`` does not name.
    """
    with arguments.one_thread():
        stored = load_any(path, device_of(device), classes)
    return TrainedModel(stored, refinement=stored.card.refinement)


def forecast(model: TrainedModel, window: Array, t: Array | Sequence[float], **options: object) -> Forecast:
    """:meth:`TrainedModel.forecast`."""
    return model.forecast(window, t, **options)  # type: ignore[arg-type]


def evaluate(model: TrainedModel | Mapping[str, TrainedModel], data: Trajectories, **options: object) -> pd.DataFrame:
    """:meth:`TrainedModel.evaluate`, of one model or of several by label (a column ``label`` is then added)."""
    if isinstance(model, TrainedModel):
        return model.evaluate(data, **options)  # type: ignore[arg-type]
    each = {label: trained.evaluate(data, **options) for label, trained in model.items()}  # type: ignore[arg-type]
    return pd.concat(each, names=["label"]).reset_index(level="label").reset_index(drop=True)


def judge(misfit: Tensor, kept: MisfitRecord | None, expected: tuple[Tensor, Tensor] | None = None) -> Tensor | None:
    """Whether misfits (S, N) are no larger than 95 % of the kept ones; where an error is expected, it is to be that,
    and the misfit no larger than 99 % of those.  None where too few are kept.

    A window that at least half of the seeds do not trust is told in a warning.

    Arguments:
        expected: by each seed (S, N), and the variance between seeds (N,)
            (:func:`expertaug.inference.expected_error.expected_errors`).
    """
    if kept is None or min(map(len, kept.validation)) < FEWEST:
        return None
    if expected is None or kept.expected is None or min(map(len, kept.expected)) < FEWEST:
        trusted, text = _within(misfit, kept.validation), DOUBT
    else:
        by_seed, between = expected
        record = np.array(kept.expected)
        if kept.between is not None:
            record, by_seed = record + np.array(kept.between), by_seed + between
        trusted, text = _within(by_seed, record) & _within(misfit, kept.validation, RARE), LARGE
    _warn_of_most(~trusted, text)
    return trusted


def _within(values: Tensor, kept: Iterable[Sequence[float]], alarms: float = FALSE_ALARMS) -> Tensor:
    """Which values (S, N) are no larger than those kept, a list a seed, but for a share of false alarms."""
    limits = values.new_tensor([threshold(np.array(of_seed), attainable(len(of_seed), alarms)) for of_seed in kept])
    return values <= limits.unsqueeze(1)


def _warn_of_most(which: Tensor | None, text: str) -> None:
    """Of windows (S, N) that are so for at least half of the seeds."""
    count = 0 if which is None else int((which.double().mean(0) >= 0.5).sum())
    if which is not None and count:
        logger.warning(text, count, which.shape[1])


def _without(each: Mapping[str, T] | None, names: Collection[str]) -> dict[str, T]:
    return {name: value for name, value in (each or {}).items() if name not in names}

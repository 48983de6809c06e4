"""Learning F_a without an encoder: each window's own estimates and gradient steps on F_a, in turns.

A nonlinear mixed-effects model fitted by alternation (hard expectation maximisation; with the estimates at their
minimum, the gradient is that of variable projection).

Of all F_a that explain the data the smallest is wanted (APHYNITY, Yin et al. 2021): it leaves to the expert what the
expert can do.  Along the data's own trajectories that is not so: in a swing that dies away angle and speed are
correlated, and the smallest F_a with a damping there has a share of the restoring force as well.  Here F_a is measured
where the components of the state are independent (:func:`expertaug.learning.expert_share.decorrelate`).
"""

from __future__ import annotations

import copy
import logging
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from expertaug import systems
from expertaug.errors import InputError, SolveError
from expertaug.inference.coordinates import LatentCoordinates
from expertaug.inference.expected_error import record_misfits
from expertaug.inference.held_constants import HeldConstants
from expertaug.inference.least_squares import WindowFit, refine_by, with_overdispersion
from expertaug.inference.levenberg_marquardt import DAMPING, adapt_damping, cost_of, minimise, of_columns, trial
from expertaug.inference.settings import AlternateJob, AlternateOptions, AlternatingSettings
from expertaug.inference.shared import fit_shared, fit_shared_of_seeds
from expertaug.inference.teacher_forcing import check_measured, expert_from_points, learn_next_points
from expertaug.inference.window_problem import assumed_noise
from expertaug.learning.divergence import clamp_to_bound, forecast_or_fallback
from expertaug.learning.expert_share import expert_sizes, squares_beside_expert
from expertaug.learning.job import Job
from expertaug.learning.optimiser import Adam, clip_each_seed
from expertaug.learning.random_streams import RandomStreams
from expertaug.learning.residuals import mean_squared_error
from expertaug.learning.settings import one_cycle
from expertaug.learning.train import Calibration, card_fields, describe_recipe
from expertaug.learning.trainer import Progress, State, moments
from expertaug.learning.training_data import StackedSet, Task, set_files, task_of
from expertaug.models import describe, store
from expertaug.models.card import ModelCard, RecipeRecord
from expertaug.models.decoder import Decoder
from expertaug.models.estimators import Alternating, LeastSquares, SharedAlternating
from expertaug.models.fit_settings import Constant, Refinement, RefinementSettings
from expertaug.models.gaps import ends_of
from expertaug.models.observation_noise import is_some, noise_of
from expertaug.models.posterior import Estimates
from expertaug.models.support import support_of
from expertaug.settings import given_ranges
from expertaug.systems import System
from expertaug.systems.inputs import check_given, check_trainable, inputs_of, states_of
from expertaug.tracking.settings import Tracking
from expertaug.trajectories import Trajectories
from expertaug.windows import Windows, fill

logger = logging.getLogger(__name__)
PROGRESS_S = 10.0
FIRST_STEPS = 8  # of Levenberg and Marquardt, with which every training window begins
SPREAD = 0.3  # standard deviation of the first z_a: F_a learns what they are good for
WORST = 0.1  # share of the training windows that are started anew at each validation
SUPPORTING = 200  # training windows, at most, whose estimates say where F_a was learned
CHI2_MEDIAN = 0.4549  # of one degree of freedom
WIDTH = 1.0  # standard deviation of z_a's prior in training
LEAST_RATE = 0.3  # of the data's own, below which the expert's are no measure of F_a's size
STEPS = 10  # of Levenberg and Marquardt, at most, where windows are started anew and in a validation
_RECORD = ("best", "best_score", "best_step", "best_latent", "constants", "step_", "seconds")


class Alternation:
    """The training of one decoder, stacked over seeds; every seed has its own estimates, data order and best state.

    Arguments:
        fit: of training windows; its decoder is trained.
        first_fit: of the same with the expert alone.
        validation_fit: of the observed part of validation windows.
        train: training windows (T1, 1, N, *observed).
        validation: validation trajectories (T, 1, V, *observed).
        task: its times, solver and bound.
        seeds: in the group's order.
        settings: how to train.
        name: for messages.
        held: what all windows share; None: nothing.

    Attributes:
        best: state of the decoder of each seed's best selection score, by the names of its tensors.
        best_latent: mean and standard deviation of the training windows' z_a then, (2, S, Q).
    """

    def __init__(
        self,
        fit: WindowFit,
        first_fit: WindowFit,
        validation_fit: WindowFit,
        train: Tensor,
        validation: Tensor,
        task: Task,
        seeds: Sequence[int],
        settings: AlternatingSettings,
        name: str,
        held: HeldConstants | None = None,
    ) -> None:
        self.held = held
        self.fit, self.first_fit, self.validation_fit, self.task = fit, first_fit, validation_fit, task
        self.model = fit.decoder.requires_grad_(True)
        validation_fit.decoder = self.model
        self.seeds, self.settings, self.name = list(seeds), settings, name
        size = len(self.seeds)
        self.train = train.double()
        self.validation = validation.double().expand(-1, size, *validation.shape[2:])
        self.count = train.shape[2]
        self.batch = min(settings.batch_size, self.count)
        self.parameters = list(self.model.parameters())
        self.optimiser = Adam(self.parameters, lr=settings.learning_rate)
        self.x = torch.zeros(size, self.count, sum(fit.sizes), dtype=torch.float64)
        self.damping = torch.full((size, self.count), DAMPING, dtype=torch.float64)
        self.misfit = torch.full((size, self.count), math.inf, dtype=torch.float64)
        self.rates = torch.ones(size, len(fit.system.state), dtype=torch.float64)
        self.found: Estimates | None = None  # of the validation windows
        self.best = {k: v.detach().clone() for k, v in self.model.state_dict().items()}
        self.best_score = torch.full((size,), math.inf)
        self.best_step = torch.zeros(size, dtype=torch.long)
        self.best_latent = torch.zeros(2, size, fit.sizes[1], dtype=torch.float64)
        self.constants = torch.zeros(size, 0, dtype=torch.float64) if held is None else held.values  # at the best step
        self.constants = self.constants.clone()
        self._hold()
        self.step_, self.seconds = 0, 0.0
        self.failed: dict[int, str] = {}

    @torch.no_grad()
    def begin(self) -> None:
        """First estimates of every training window, by the expert alone, and the size of its rates along them."""
        p, q, _ = self.fit.sizes
        self._fit_all(self.first_fit, lambda windows, _: self.first_fit.best_of_grid(windows)[:, :, 0])
        self.x[..., p : p + q] = SPREAD * RandomStreams(self.seeds, 0).normal(self.count, q).double()
        index = torch.arange(self.batch).expand(len(self.seeds), -1)
        windows, x = self._windows(index), self._of(self.x, index)
        z_e, system = self.fit.parts(x, self.fit.first(windows))[0], self.fit.system
        states = self.model.state_of(self.fit.states(x, windows))
        self.rates = expert_sizes(system, states, z_e, self.fit.t, inputs_of(system, windows))
        # An expert that without F_a had better not move at all says nothing of how large a rate is.
        self.rates = torch.maximum(self.rates, LEAST_RATE * self._slopes())

    def learn_next_points(self) -> None:
        """First steps from each measured point to the next, and estimates with what F_a is then."""
        settings = self.settings.teacher_forcing
        assert settings is not None
        batches = (self._batch(step) for step in range(settings.steps))
        if settings.estimates == "least_squares":
            self.x = expert_from_points(self.first_fit, self.train, self.x, self.batch)
        self.x = learn_next_points(self.fit, self.train, self.x, batches, settings, self.name)
        self._fit_all(self.fit, lambda _, x: x)
        self.refit()
        self._select()

    @torch.no_grad()
    def _fit_all(self, fit: WindowFit, start: Callable[[Tensor, Tensor], Tensor]) -> None:
        """A few steps of every training window's estimates, from what ``start`` makes of windows and estimates."""
        size = len(self.seeds) if fit is self.fit else 1
        for first in range(0, self.count, self.batch):
            some = slice(first, first + self.batch)
            part = self.train[:, :, some]
            windows = part.expand(-1, size, *part.shape[2:])
            x = start(windows, self.x[:, some])
            self.x[:, some] = minimise(partial(_residuals, fit, windows), x, FIRST_STEPS, fit.longest).x

    def _slopes(self) -> Tensor:
        """Root mean square slope of each component of the training windows, (K,); 0 of what nobody measured."""
        steps = self.fit.t.diff().view(-1, *[1] * (self.train.dim() - 1))
        slopes = (states_of(self.fit.system, self.train).diff(dim=0) / steps).square()
        axes = [axis for axis in range(slopes.dim()) if axis != 3]
        return slopes.nan_to_num(0.0).mean(axes).sqrt()

    def _hold(self) -> None:
        if self.held is not None:
            self.held.hold((self.fit, self.first_fit, self.validation_fit))

    @torch.no_grad()
    def refit(self) -> None:
        """Fit what all windows share, with F_a as it is, to so many of them that they tell it."""
        if self.held is not None:
            few = torch.from_numpy(np.linspace(0, self.count - 1, min(SUPPORTING, self.count)).astype(int))
            self.x[:, few] = self.held.refit(self.model, self.train[:, :, few], self.x[:, few])
            self._hold()

    def step(self) -> dict[str, Tensor]:
        """Improve a batch's estimates by one step each, then F_a by one gradient step; the loss's parts, each (S,)."""
        index = self._batch(self.step_)
        windows, x, damping = self._windows(index), self._of(self.x, index), self._of(self.damping, index)
        x_new, cost = trial(partial(_residuals, self.fit, windows), x, damping, self.fit.longest)
        states = self.fit.states(x_new, windows)
        data = self.fit.differences(states, windows)
        new_cost = cost_of(torch.cat((data.detach(), self.fit.pull(x_new)), -1))
        better = new_cost < cost if x.shape[-1] else torch.ones_like(cost, dtype=torch.bool)
        rows = torch.arange(len(self.seeds)).unsqueeze(1)
        self.x[rows, index] = torch.where(better[..., None], x_new, x)
        self.damping[rows, index] = adapt_damping(damping, better)
        self.misfit[rows, index] = torch.where(better, new_cost, cost)
        each = torch.where(better, self._robust(data).mean(-1), torch.zeros_like(cost))
        fitted = each.sum(-1) / better.sum(-1).clamp_min(1)  # what a step has led astray teaches nothing
        size, share = self._sizes(states.detach(), x, inputs_of(self.fit.system, windows))
        self.optimiser.zero_grad(set_to_none=True)
        (fitted + self.settings.penalty * size + self.settings.share * share).sum().backward()
        clip_each_seed(self.parameters, self.settings.clip_norm, torch.ones(len(self.seeds), dtype=torch.bool))
        rate = self.settings.learning_rate * one_cycle(self.step_, self.settings.steps, self.settings.warmup)
        for group in self.optimiser.param_groups:
            group["lr"] = rate
        self.optimiser.step()
        self.step_ += 1
        parts = {"loss": fitted, "size": size.sqrt(), "expert_share": share.sqrt()}
        return {name: value.detach() for name, value in parts.items()}

    def _robust(self, data: Tensor) -> Tensor:
        """Squares of what is small beside the threshold; of what is large (Cauchy's loss) the logarithm."""
        limit, unit = self.settings.threshold**2, 1.0
        if self.held is not None:
            # A window has little of its own by which it could come near the first F_a's forecast: until F_a explains
            # the windows, what is left counts as noise, beside which the penalties keep their weight.
            typical = data.detach().square().flatten(1).median(dim=1).values / CHI2_MEDIAN
            unit = typical.clamp_min(1.0).view(-1, 1, 1)
        squares = data.square() / unit
        return limit * torch.log1p(squares / limit)

    def _sizes(self, states: Tensor, x: Tensor, u: Tensor | None) -> tuple[Tensor, Tensor]:
        """Mean squares (S,) of F_a and of its share of the expert, at forecasts (T1, S, B, *state) of parameters x."""
        states = self.model.state_of(states)
        z_e, z_a, _ = self.fit.parts(x, states[0])
        return squares_beside_expert(self.model, states, z_e, z_a, self.fit.t, self.rates, u)

    @torch.no_grad()
    def score(self) -> Tensor:
        """Validation score (S,): log mean squared error of the forecasts after the observed window."""
        observed = self.task.observed
        self.found = self.validation_fit(self.validation[:observed], self.found)
        system, estimates = self.fit.system, self._given(self.found)
        u = inputs_of(system, self.validation)
        states = forecast_or_fallback(self.model, *estimates, self.task.t, self.task.solver, u)  # type: ignore[arg-type]
        late = clamp_to_bound(states, self.task.bound)[observed:]
        error = mean_squared_error(system, late, states_of(system, self.validation[observed:]))
        return error.log().nan_to_num(math.inf, math.inf).float()

    @staticmethod
    def _given(estimates: Estimates) -> tuple[Tensor, Tensor, Tensor]:
        assert estimates.z_e is not None and estimates.z_a is not None
        return estimates.y0, estimates.z_e, estimates.z_a

    @torch.no_grad()
    def restart(self) -> None:
        """Try new starts for the windows that are explained worst."""
        count = max(1, int(WORST * self.count))
        index = self.misfit.nan_to_num(math.inf, math.inf).topk(count, dim=1).indices
        windows, x = self._windows(index), self._of(self.x, index)
        z_e, z_a, y0 = self.fit.parts(x, self.fit.first(windows))
        estimates = self.fit(windows, Estimates(y0, z_e, z_a))
        rows = torch.arange(len(self.seeds)).unsqueeze(1)
        self.x[rows, index] = self.fit.coordinates(estimates, self.fit.first(windows))
        self.damping[rows, index] = DAMPING

    def run(self, progress: Progress) -> None:
        """Train to the end; the best state is then in ``best``."""
        settings, reported = self.settings, 0.0
        saved = time.monotonic()
        if self.step_ == 0:
            begun = time.monotonic()
            self.begin()
            if settings.teacher_forcing is not None:
                self.learn_next_points()
            self.seconds += time.monotonic() - begun
        while self.step_ < settings.steps:
            begun = time.monotonic()
            parts = self.step()
            record = {k: v.tolist() for k, v in parts.items()}
            validated = self.step_ % settings.validate_every == 0 or self.step_ == settings.steps
            if validated:
                self.refit()
                record["validation_score"] = self._select().tolist()
                if self.step_ < settings.steps:
                    self.restart()
            self.seconds += time.monotonic() - begun
            if validated:
                progress.metrics(self.step_, record)
                progress.flush()
            if time.monotonic() - reported > PROGRESS_S:
                reported = time.monotonic()
                self._progress(parts)
            if time.monotonic() - saved > settings.checkpoint_s and self.step_ < settings.steps:
                progress.save(self.state())
                saved = time.monotonic()
        bad = [s for s, score in zip(self.seeds, self.best_score.tolist(), strict=True) if not math.isfinite(score)]
        self.failed = dict.fromkeys(bad, "no validation forecast had a finite error; lower alternation.learning_rate")
        if len(bad) == len(self.seeds):
            raise SolveError(f"{self.name}: {self.failed[bad[0]]}")

    def _select(self) -> Tensor:
        score = self.score()
        better = score < self.best_score
        self.best_score = torch.where(better, score, self.best_score)
        self.best_step = torch.where(better, self.step_, self.best_step)
        for key, value in self.model.state_dict().items():
            self.best[key] = _choose(better, value, self.best[key], 0)
        p, q, _ = self.fit.sizes
        z_a = self.x[..., p : p + q]
        latent = torch.stack(moments(z_a))
        self.best_latent = _choose(better, latent, self.best_latent, 1)
        if self.held is not None:
            self.constants = _choose(better, self.held.values, self.constants, 0)
        return score

    def _progress(self, parts: Mapping[str, Tensor]) -> None:
        left = self.seconds / self.step_ * (self.settings.steps - self.step_)
        scores = self.best_score[torch.isfinite(self.best_score)]
        best = f"{scores.mean():.2f}" if len(scores) else "–"
        logger.info(
            "%s: step %d/%d, loss %.4g, best selection score %s, %d s gone, %d s left",
            self.name, self.step_, self.settings.steps, parts["loss"].mean(), best, self.seconds, left,
        )  # fmt: skip

    def _batch(self, step: int) -> Tensor:
        """Windows (S, B) of a step, in an order that depends on the seed and the pass alone."""
        passes, k = divmod(step, max(self.count // self.batch, 1))
        order = [np.random.default_rng([seed, passes]).permutation(self.count) for seed in self.seeds]
        return torch.from_numpy(np.stack(order))[:, k * self.batch : (k + 1) * self.batch]

    def _windows(self, index: Tensor) -> Tensor:
        """Training windows (T1, S, B, *observed) by their numbers (S, B)."""
        return self.train[:, 0][:, index]

    @staticmethod
    def _of(value: Tensor, index: Tensor) -> Tensor:
        return value[torch.arange(len(index)).unsqueeze(1), index]

    def state(self) -> State:
        """Everything that a resumed run needs to reach the same bits; data orders follow from seed and step."""
        names = ("x", "damping", "misfit", "rates", *_RECORD)
        estimates = None if self.found is None else self._given(self.found)
        return {name: getattr(self, name) for name in names} | {
            "model": self.model.state_dict(),
            "optimiser": self.optimiser.state_dict(),
            "found": estimates,
            "held": None if self.held is None else self.held.values,
        }

    def restore(self, state: State) -> None:
        """Take up what :meth:`state` gave."""
        self.model.load_state_dict(state["model"])
        self.optimiser.load_state_dict(state["optimiser"])
        for name in ("x", "damping", "misfit", "rates", *_RECORD):
            setattr(self, name, state[name])
        self.found = None if state["found"] is None else Estimates(*state["found"])
        if self.held is not None:
            self.held.values = state["held"]
            self._hold()


def _residuals(fit: WindowFit, windows: Tensor, candidates: Tensor, columns: Tensor) -> Tensor:
    return fit.residuals(candidates, of_columns(windows, columns))


def _choose(which: Tensor, first: Tensor, second: Tensor, axis: int) -> Tensor:
    """For each seed ``which`` (S,) its part of the first tensor, for the others of the second; seeds along an axis."""
    shape = [1] * first.dim()
    shape[axis] = len(which)
    return torch.where(which.view(shape), first, second)


def run_stage(
    data: Path,
    output: Path,
    work: Path,
    settings: AlternateJob,
    tracking: Tracking | None,
    calibration: Path | None = None,
) -> None:
    """Stage: train a method of kind alternating on ``data/train.npz`` and select on ``data/validation.npz``.

    Arguments and errors are those of :func:`expertaug.learning.train.run_stage`.
    """
    inputs = set_files(data)
    described = describe_recipe(settings, None if calibration is None else Calibration.load(calibration))
    train, validation = map(Trajectories.load, inputs)
    with Job(output, work, inputs, settings, tracking, __name__) as job:
        job.write(alternate(systems.load(described.system), train, validation, settings, described, progress=job))


def alternate(
    system: System,
    train: Trajectories,
    validation: Trajectories,
    options: AlternateOptions,
    described: RecipeRecord,
    classes: Mapping[str, Callable] | None = None,
    progress: Progress | None = None,
) -> store.StoredModel:
    """Learn an interaction model from least-squares fits of each training window, without an encoder.

    Arguments:
        progress: is told of the training while it runs.
        others: as of :func:`prepare`.

    Raises:
        InputError: as of :func:`prepare`.
        SolveError: no seed can be trained.
    """
    return prepare(system, train, validation, options, described, classes).run(progress)


@dataclass(frozen=True)
class AlternatingTraining:
    """A training that is ready to run, and what will be known about the model that it gives.

    Attributes:
        trainer: with decoder, windows and settings.
        card: of the model, apart from the record of its training.
        refinement: how windows are fitted.
        seen: observed windows, y (T1, 1, N, *state), of the training set: the range of their estimates is kept.
        checked: of the validation set: their misfits are kept, for alarms.
        train: training windows, which tell what they share, and how far fits are to be trusted.
        classes: see :class:`StoredModel`.
    """

    trainer: Alternation
    card: ModelCard
    refinement: Refinement
    seen: Windows
    checked: Windows
    train: Trajectories
    classes: Mapping[str, Callable] = field(default_factory=dict)

    def run(self, progress: Progress | None = None) -> store.StoredModel:
        """Train to the end, from the state at which a killed run stopped where ``progress`` has one; the best state of
        each seed, by validation.

        Raises:
            SolveError: no seed can be trained.
        """
        trainer, progress = self.trainer, progress or Progress()
        state = progress.begin(self.card)
        if state is not None:
            trainer.restore(state)
        trainer.run(progress)
        trainer.model.load_state_dict(trainer.best)
        mean, std = trainer.best_latent.tolist()
        record = {
            "wall_s": trainer.seconds,
            "best_score": [s if math.isfinite(s) else None for s in trainer.best_score.tolist()],
            "best_step": trainer.best_step.tolist(),
            "failed": sorted(trainer.failed),
            "latent": {"mean": mean, "std": std},
        }
        model = copy.deepcopy(trainer.model).float().requires_grad_(False).eval()
        model.sensors = None  # the model file's constants say how they are seen
        stored = store.StoredModel(model, self.card.but(**record), self.classes)
        refinement = self._with_constants(stored)
        record["refinement"] = refinement
        stored = replace(stored, card=self.card.but(**record))
        estimator = refine_by(stored, refinement)
        used = replace(stored, model=estimator)
        record["misfit"] = record_misfits(used, self.checked)
        # As windows will be fitted, with F_a as it is now: what training had at hand lags behind it.
        estimates = estimator.estimate(self.seen.expand(len(trainer.seeds)))
        record["support"] = support_of(estimates.z_e, estimates.z_a)
        return replace(stored, card=self.card.but(**record))

    def _with_constants(self, stored: store.StoredModel) -> Refinement:
        """The refinement with what all windows share, fitted to whole training windows with each seed's F_a."""
        if not self.refinement.settings.shares:
            return with_overdispersion(stored, self.refinement, self.train)
        return fit_shared_of_seeds(stored, self.refinement, self.train, self.trainer.constants)


def prepare(
    system: System,
    train: Trajectories,
    validation: Trajectories,
    options: AlternateOptions,
    described: RecipeRecord,
    classes: Mapping[str, Callable] | None = None,
) -> AlternatingTraining:
    """Make the training in memory.

    Arguments:
        train, validation: sets of the same times.
        options: how to train, and how windows are fitted.
        described: what a file says of system and model (:func:`expertaug.learning.train.describe_recipe`).
        classes: see :class:`StoredModel`.

    Raises:
        InputError: the sets differ in their times, there is no interaction model, or an option is unknown.
    """
    if not (len(train.t) == len(validation.t) and (train.t == validation.t).all()):
        raise InputError("validation set", "has other times than the training set", "give both the same times")
    if described.model.interaction is None:
        raise InputError("model.interaction", "missing", "the training is of an interaction model")
    check_trainable(system)
    training, seeds = options.training, options.seeds
    shares = options.refinement.settings.shares
    card = ModelCard.of(
        kind=(SharedAlternating if shares else Alternating).name,
        **card_fields(train, system, options),
        system=described.system,
        model={"interaction": described.model.interaction},
        expert=True,
        interaction=True,
        stage="train",
        latent_size=training.latent,
        refinement=options.refinement,
        forecast_solver=store.forecast_solver(training.solver, system),
    )
    decoder = describe.decoder_of(system, card, classes)
    device, ranges = torch.device("cpu"), card.start
    task = task_of(training, card, device)
    train_set = StackedSet.of(train, device).subset(training.train_samples)
    validation_set = StackedSet.of(validation, device).subset(training.validation_samples)
    for name, part in (("training set", train_set), ("validation set", validation_set)):
        check_given(system, part.u, name)
    seen_y = train_set.y[: card.observed, 0]
    if ranges is not None:
        seen_y = fill(seen_y, torch.tensor(card.t[: len(seen_y)]), ends_of(ranges)[0].to(seen_y))
    decoder.fit(seen_y)
    overrides = {"steps": STEPS, "latent_width": WIDTH}
    refinement, prior = options.refinement.settings, given_ranges(options.refinement.prior)
    shared = [p for p in system.expert_parameters if p.name in refinement.shared]
    held_at = {p.name: Constant(value=p.scale, std=0.0) for p in shared}  # until they are fitted
    noise = noise_of(options.refinement.noise, system, card)
    whole = RefinementSettings.from_mapping({"starts": refinement.starts, "tries": refinement.tries, **overrides})
    free = refinement.free_start if "free_start" in refinement.model_fields_set else is_some(noise)
    t = torch.tensor(card.t, dtype=torch.float64)
    assumed = assumed_noise(refinement, noise, card.bound)

    def fit(
        decoder: Decoder, times: Tensor, settings: RefinementSettings, size: int, held: Mapping[str, Constant]
    ) -> WindowFit:
        mean, std = (f(size, 1, training.latent, dtype=torch.float64) for f in (torch.zeros, torch.ones))
        latent = LatentCoordinates(mean, std)
        return WindowFit(decoder, times, settings, assumed, bool(free), prior, latent, task.solver, ranges, held)

    used, seen = t[: task.horizon], t[: card.observed]
    fits = (
        fit(decoder, used, whole, len(seeds), held_at),
        fit(Decoder(system), used, whole, 1, held_at),
        fit(decoder, seen, refinement.model_copy(update=overrides), len(seeds), held_at),
    )
    name = f"{card.experiment}/{card.label} seeds {','.join(map(str, seeds))}"
    sets = train_set.windows(task.horizon).joined, validation_set.windows(len(t)).joined
    if training.teacher_forcing is not None:
        check_measured(system, sets[0])
    held, sharing = None, train.spread(training.train_samples)
    if refinement.holds:
        alone = store.StoredModel(*LeastSquares.fit(system, sharing, card.but(kind=LeastSquares.name)))
        only = refinement.model_copy(update={"units": dict.fromkeys(refinement.shared, "shared"), "population": {}})
        first = fit_shared(alone, options.refinement.model_copy(update={"settings": only}), sharing)

        def problem(decoder: Decoder) -> WindowFit:
            return fit(decoder, used, whole, 1, {})

        held = HeldConstants.of(system, problem, first, train_set.y[: task.horizon, :1], len(seeds))
    trainer = Alternation(*fits, *sets, task, seeds, training, name, held)
    observed_windows = train_set.subset(SUPPORTING).windows(len(seen)), validation_set.windows(len(seen))
    return AlternatingTraining(trainer, card, options.refinement, *observed_windows, sharing, classes or {})

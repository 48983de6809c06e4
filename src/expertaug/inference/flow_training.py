"""Training of a flow on draws of a trained model, and the stage flow."""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import torch
from torch import Tensor

from expertaug.errors import InputError
from expertaug.inference import flow as flows
from expertaug.inference.flow import Flow, FlowEstimator
from expertaug.inference.settings import FlowJob, FlowSettings, FlowTrainingOptions
from expertaug.inference.simulations import HELD_OUT, Draws, Pool, Simulator, latents_of
from expertaug.learning.augment import prior_ends
from expertaug.learning.divergence import BoundedSolver
from expertaug.learning.job import Job
from expertaug.learning.objectives import Objective
from expertaug.learning.trainer import Progress, Trainer, Training
from expertaug.learning.training_data import StackedSet, Task, set_files, task_of
from expertaug.models.card import ModelCard
from expertaug.models.hybrid import HybridNet
from expertaug.models.observation_noise import noise_of
from expertaug.models.store import StoredModel, device_of, forecast_solver
from expertaug.presets import Choices
from expertaug.settings import Range, given_ranges
from expertaug.systems import System
from expertaug.systems.solvers.solver import Solver
from expertaug.tracking.settings import Tracking
from expertaug.trajectories import Trajectories

# Of the settings, what a model file says.
KEPT = ("experiment", "method", "label", "preset", "choices", "flow")
LEAST, SMALLEST = 1e-6, 1e-30  # half of a range, of its middle and at all


def run_stage(model: Path, data: Path, output: Path, work: Path, settings: FlowJob, tracking: Tracking | None) -> None:
    """Stage: learn the posterior of a trained model from its own draws.

    Arguments:
        model: file of the trained model.
        data: folder of the sets; the observed windows of ``train.npz`` and ``validation.npz`` are used.
        output: model file.
        work: folder for checkpoints.
        settings: of the job.
        tracking: see :class:`expertaug.tracking.run_log.RunLog`.
    """
    stored = flows.load(model, device_of(settings.device), settings.classes or ())
    sets = set_files(data)
    train, validation = map(Trajectories.load, sets)
    options = settings.model_copy(update={"seeds": stored.seeds})
    with Job(output, work, [Path(model), *sets], options, tracking, __name__) as job:
        job.write(fit_flow(stored, train, options, model, validation, job))


def fit_flow(
    stored: StoredModel,
    train: Trajectories,
    options: FlowTrainingOptions,
    where: object = "flow",
    validation: Trajectories | None = None,
    progress: Progress | None = None,
) -> StoredModel:
    """Learn the posterior of a trained model from its own draws; the model stays as it is.

    What all windows share is known but for its error (:func:`given_what_is_shared`).

    Arguments:
        stored: a trained hybrid model, or one of kind alternating, whose fits the flow then amortises.
        train: the set that it was trained on.
        options: how to train, and what to call it.
        where: for messages.
        validation: whose misfits are kept for alarms; None: none are.
        progress: is told of the training while it runs.

    Raises:
        InputError: the model is no hybrid one, or knows constants of sensors, the prior does not name its expert
            parameters, or draws are to begin anywhere and the system does not say where that is.
        SolveError: no seed can be trained.
    """
    return prepare(stored, train, options, where, validation).run(progress)


def prepare(
    stored: StoredModel,
    train: Trajectories,
    settings: FlowTrainingOptions,
    where: object = "flow",
    validation: Trajectories | None = None,
) -> Training:
    """Make the training of a flow; arguments and errors are those of :func:`fit_flow`."""
    base, device, prior = stored.card, stored.device, given_ranges(settings.prior)
    if not stored.kind.trains():
        raise InputError(where, f"a {base.kind} model", "a flow learns from a trained hybrid model")
    if base.refinement is not None and base.refinement.sensors:
        problem = f"a {base.kind} model with constants of sensors"
        raise InputError(where, problem, "a flow draws what the state shows: give a model without them")
    prior = given_what_is_shared(stored, prior)
    options, choices, seeds = settings.flow, settings.choices, stored.seeds
    kind = type(stored.model.system)
    if options.resample_x and kind.resample_known is System.resample_known:
        problem = f"{kind.__name__} does not say where first points may lie"
        raise InputError("flow.resample_x", problem, "leave it out, or give the system a resample_known of its own")
    windows, system = StackedSet.of(train, device, base.observed).trajectories, stored.model.system
    noise = noise_of(settings.noise, system, base) if choices.augmentation_noise == "as_data" else 0.0
    card = base.but(
        misfit=None,  # of the base's own estimates
        refinement=None,
        **settings.model_dump(include=set(KEPT)),
        kind=Flow.name,
        stage="flow",
        prior=prior,
        noise=noise,
        base=base,
        base_wall_s=base.wall_s,
    )
    latents = latents_of(stored.model, base, windows, choices.augmented_z_a)
    estimator = flows.build(stored.model, card, latents).to(device)
    estimator.head.context.fit(windows.seed(0).joined)
    low, high = prior_ends(stored.model.system, prior)
    unknowns = estimator.head.unknowns
    simulator = Simulator(
        decoder=estimator.decoder,
        unknowns=unknowns,
        context=estimator.head.context,
        scores=unknowns.transform.latent.coordinates(latents),
        starts=windows.y[0, 0],
        inputs=None if windows.u is None else windows.u[:, 0],
        gaps=torch.isnan(windows.y[:, 0]) if base.has_gaps else None,
        ranges=base.start,
        low=low.to(device),
        high=high.to(device),
        noise=noise,
        jitter=options.jitter,
        resample_x=choices.augmented_x == "resampled" if options.resample_x is None else options.resample_x,
        task=_task(base, options, device, system),
        seeds=seeds,
    )
    held = simulator.draw(options.held_out, HELD_OUT)
    scale = estimator.head.density.scale
    scale.mean.copy_(held.x.mean(1, keepdim=True))
    std = held.x.std(1, keepdim=True)
    scale.std.copy_(torch.where(std > 1e-6, std, torch.ones_like(std)))
    name = f"{card.experiment}/{card.label} seeds {','.join(map(str, seeds))}"
    trainer = FlowTrainer(estimator, simulator, held, options, name, base.failed or ())
    checked = None if validation is None else StackedSet.of(validation, device, base.observed).trajectories
    return Training(trainer, card, stored.classes, checked=checked)


def given_what_is_shared(stored: StoredModel, prior: Mapping[str, Range]) -> dict[str, Range]:
    """p⁺ with the ranges of what all windows share as wide as its error says: of the same standard deviation, with the
    spread of the seeds, each of whom has an F_a of its own; of a point estimate of a training the spread alone.

    Arguments:
        prior: ranges by expert parameter.
    """
    fitted = stored.card.refinement
    values: dict[str, tuple[float, float]] = {}
    for name, constant in ((fitted.shared if fitted is not None else None) or {}).items():
        spread = statistics.stdev(constant.seeds) if constant.seeds and len(constant.seeds) > 1 else 0.0
        values[name] = constant.value, math.hypot(constant.std, spread)
    model = stored.model
    if isinstance(model, HybridNet) and model.constants is not None:
        with torch.no_grad():
            trained = [seed not in stored.failed for seed in stored.seeds]
            of_seeds, errors = (part.double()[trained, 0] for part in model.constants.stated)
        errors = errors.mean(0) if stored.card.likelihood else torch.zeros_like(of_seeds[0])
        between = of_seeds.std(0) if len(of_seeds) > 1 else torch.zeros_like(of_seeds[0])
        widths = torch.hypot(errors, between).tolist()
        values |= zip(stored.card.shared, zip(of_seeds.mean(0).tolist(), widths, strict=True), strict=True)
    ranges, positive = dict(prior), {p.name for p in model.system.expert_parameters if p.positive}
    for name, (value, error) in values.items():
        half = max(math.sqrt(3.0) * error, LEAST * abs(value), SMALLEST)
        low = value - half
        ranges[name] = (max(low, LEAST * value) if name in positive else low, value + half)
    return ranges


def _task(base: ModelCard, options: FlowSettings, device: torch.device, system: System) -> Task:
    """Of the draws: the observed window, by an accurate solver that follows no trajectory beyond the bound."""
    task = task_of(base.training, base, device).shortened(base.observed)
    solver_settings = options.solver or base.forecast_solver
    solver = (
        forecast_solver(base.training.solver, system) if solver_settings is None else Solver(**dict(solver_settings))
    )
    return replace(task, solver=solver if task.bound is None else BoundedSolver(solver, task.bound))  # type: ignore


class Likelihood(Objective):
    """−log q(θ | window), averaged over the draws (neural posterior estimation)."""

    def loss(self, model: FlowEstimator, batch: Draws, task: Task) -> tuple[Tensor, dict[str, Tensor]]:  # type: ignore
        """Loss (S,) and its parts, each (S,), without gradient."""
        loss = -model.head.density.log_prob(batch.x, batch.theta).mean(1)
        return loss, {"loss": loss.detach()}


class FlowTrainer(Trainer):
    """The trainer of a flow: a pass is one over the pool of draws, and draws held out select the best state.

    Arguments:
        estimator: stacked.
        simulator: gives the draws.
        held: draws held out.
        settings: how to train.
        name: for messages.
        failed: seeds of the base model that could not be trained.
    """

    SCORE = "loss on draws held out"

    def __init__(
        self,
        estimator: FlowEstimator,
        simulator: Simulator,
        held: Draws,
        settings: FlowSettings,
        name: str,
        failed: Sequence[int],
    ) -> None:
        seeds = list(simulator.seeds)
        reasons = dict.fromkeys(failed, "it failed in the training before")
        pool = Pool(simulator, settings.renewed, settings.uses)
        objective = Likelihood(seeds, Choices())
        super().__init__(
            estimator,  # type: ignore[arg-type]
            objective,
            simulator.task,
            pool,  # type: ignore[arg-type]
            [],
            seeds,
            settings.training,
            name,
            failed=reasons,
        )
        self.pool, self.held = pool, held

    @torch.no_grad()
    def score(self) -> Tensor:
        """Loss (S,) on the draws held out; infinite where not finite."""
        loss = -self.model.head.density.log_prob(self.held.x, self.held.theta).mean(1)
        return loss.nan_to_num(float("inf"), float("inf")).cpu()

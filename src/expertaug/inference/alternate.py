"""The stage alternate: a training of F_a without an encoder, in memory and as a job of the workflow."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from expertaug.errors import InputError
from expertaug.inference.alternation import Alternation
from expertaug.inference.latent import Latent
from expertaug.inference.least_squares import refined_by
from expertaug.inference.settings import AlternateJob, AlternateOptions
from expertaug.inference.window_fit import WindowFit
from expertaug.inference.window_problem import assumed_noise
from expertaug.learning import job
from expertaug.learning.fitting import Record
from expertaug.learning.residuals import recorded
from expertaug.learning.train import inputs_of, of_data, taken_in
from expertaug.learning.training_data import StackedSet, task_of
from expertaug.models import describe, store
from expertaug.models.card import ModelCard, RecipeRecord
from expertaug.models.decoder import Decoder
from expertaug.models.gaps import ends_of, fill
from expertaug.models.observation_noise import is_some, noise_of
from expertaug.models.settings import Refinement, RefinementSettings
from expertaug.settings import given_ranges
from expertaug.systems import System
from expertaug.systems.inputs import check_given, check_trainable
from expertaug.tracking.settings import Tracking
from expertaug.trajectories import Trajectories

WIDTH = 1.0  # standard deviation of z_a's prior in training
STEPS = 10  # of Levenberg and Marquardt, at most, where windows are started anew and in a validation


def alternate(
    data: Path,
    output: Path,
    work: Path,
    settings: AlternateJob,
    tracking: Tracking | None,
    calibration: Path | None = None,
) -> None:
    """Stage: train a method of kind alternating on ``data/train.npz`` and select on ``data/validation.npz``.

    Arguments and errors are those of :func:`expertaug.learning.train.train`.
    """
    inputs = inputs_of(data)
    system, described, *sets = taken_in(inputs, settings, calibration)
    training = prepare(system, *sets, settings, described)
    job.run(training, output, work, inputs, settings, tracking, "expertaug.inference.alternate")


@dataclass(frozen=True)
class AlternatingTraining:
    """A training that is ready to run, and what will be known about the model that it gives.

    Attributes:
        trainer: with decoder, windows and settings.
        card: of the model, apart from the record of its training.
        refinement: how windows are fitted.
        checked: observed windows (T1, 1, N, *state) of the validation set: their misfits are kept, for alarms.
        classes: see :class:`StoredModel`.
    """

    trainer: Alternation
    card: ModelCard
    refinement: Refinement
    checked: Tensor
    classes: Mapping[str, Callable] = field(default_factory=dict)

    def run(self, log: Any = None, checkpoint: Any = None) -> store.StoredModel:
        """Train to the end; the best state of each seed, by validation.

        Arguments:
            log: a RunLog, or None: nothing is written.
            checkpoint: a Checkpoint, or None: nothing is written.

        Raises:
            SolveError: no seed can be trained.
        """
        trainer, memory = self.trainer, Record()
        trainer.run(log or memory, checkpoint or memory)
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
        stored = store.StoredModel(model, self.card.but(**record), self.classes)
        estimator = refined_by(stored, self.refinement)
        record["misfit"] = recorded(replace(stored, model=estimator), self.checked)
        return replace(stored, card=self.card.but(**record))


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
        described: what a file says of system and model (:func:`expertaug.learning.train.described_by`).
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
    card = ModelCard.of(
        kind="alternating",
        **of_data(train, system, options),
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
    given = {"steps": STEPS, "latent_width": WIDTH}
    refinement, prior = options.refinement.settings, given_ranges(options.refinement.prior)
    noise = noise_of(options.refinement.noise, system, card)
    whole = RefinementSettings.from_mapping({"starts": refinement.starts, "tries": refinement.tries, **given})
    free = refinement.free_start if "free_start" in refinement.model_fields_set else is_some(noise)
    t = torch.tensor(card.t, dtype=torch.float64)
    assumed = assumed_noise(refinement, noise, card.bound)

    def fit(decoder: Decoder, times: Tensor, settings: RefinementSettings, size: int) -> WindowFit:
        mean, std = (f(size, training.latent, dtype=torch.float64) for f in (torch.zeros, torch.ones))
        return WindowFit(decoder, times, settings, assumed, bool(free), prior, Latent(mean, std), task.solver, ranges)

    used, seen = t[: task.horizon], t[: card.observed]
    fits = (
        fit(decoder, used, whole, len(seeds)),
        fit(Decoder(system), used, whole, 1),
        fit(decoder, seen, refinement.model_copy(update=given), len(seeds)),
    )
    name = f"{card.experiment}/{card.label} seeds {','.join(map(str, seeds))}"
    sets = train_set.windows(task.horizon), validation_set.windows(len(t))
    trainer = Alternation(*fits, *sets, task, seeds, training, name)
    return AlternatingTraining(trainer, card, options.refinement, validation_set.windows(len(seen)), classes or {})

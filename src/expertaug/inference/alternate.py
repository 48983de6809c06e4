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
from expertaug.inference.least_squares import estimator_of
from expertaug.inference.settings import AlternatingSettings, RefinementSettings
from expertaug.inference.window_fit import WindowFit
from expertaug.inference.window_problem import assumed_noise
from expertaug.learning import job
from expertaug.learning.fitting import Record
from expertaug.learning.misfit import recorded
from expertaug.learning.sets import StackedSet
from expertaug.learning.task import task_of
from expertaug.learning.train import inputs_of, of_data, taken_in
from expertaug.models import describe, store
from expertaug.models.decoder import Decoder
from expertaug.models.gaps import ends_of, fill
from expertaug.models.measurement_noise import is_some, noise_of
from expertaug.systems import System
from expertaug.systems.inputs import check_given, check_trainable
from expertaug.tracking.settings import Tracking
from expertaug.trajectories import Trajectories

WIDTH = 1.0  # standard deviation of z_a's prior in training
STEPS = 10  # of Levenberg and Marquardt, at most, where windows are started anew and in a validation


def alternate(
    data: Path, output: Path, work: Path, settings: Mapping, tracking: Tracking | None, calibration: Path | None = None
) -> None:
    """Stage: train a method of kind alternating on ``data/train.npz`` and select on ``data/validation.npz``.

    Arguments and errors are those of :func:`expertaug.learning.train.train`, ``settings`` {system, build, model} and
    those of :func:`prepare`.
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
        description: of the model, apart from the record of its training.
        checked: observed windows (T1, 1, N, *state) of the validation set: their misfits are kept, for alarms.
        classes: see :class:`StoredModel`.
    """

    trainer: Alternation
    description: Mapping
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
        stored = store.StoredModel(model, {**self.description, **record}, self.classes)
        estimator = estimator_of(stored, **self.description["refinement"])
        record["misfit"] = recorded(replace(stored, model=estimator), self.checked)
        return replace(stored, description={**self.description, **record})


def prepare(
    system: System,
    train: Trajectories,
    validation: Trajectories,
    settings: Mapping,
    described: Mapping,
    classes: Mapping[str, Callable] | None = None,
) -> AlternatingTraining:
    """Make the training in memory.

    Arguments:
        train, validation: sets of the same times.
        settings: {experiment, method, label, preset, training, refinement, t1_s, choices, seeds}; ``training`` is an
            :class:`AlternatingSettings`, ``refinement`` {settings, noise, prior} says how windows are fitted.
        described: what a file says of system and model (:func:`expertaug.learning.train.described_by`).
        classes: see :class:`StoredModel`.

    Raises:
        InputError: the sets differ in their times, there is no interaction model, or an option is unknown.
    """
    if not (len(train.t) == len(validation.t) and (train.t == validation.t).all()):
        raise InputError("validation set", "has other times than the training set", "give both the same times")
    if "interaction" not in described["model"]:
        raise InputError("model.interaction", "missing", "the training is of an interaction model")
    check_trainable(system)
    options, seeds = AlternatingSettings.from_mapping(settings["training"]), list(settings["seeds"])
    model = {"interaction": described["model"]["interaction"]}
    description = {
        "kind": "alternating",
        **of_data(train, system, settings),
        **described,
        "model": model,
        "stage": "train",
    }
    description |= {"expert": True, "interaction": True, "latent_size": options.latent}
    description |= {"refinement": settings["refinement"]}
    description["forecast_solver"] = settings.get("forecast_solver") or store.forecast_solver(
        settings["training"], system
    )
    decoder = describe.decoder_of(system, description, classes)
    device, ranges = torch.device("cpu"), description.get("start")
    task = task_of(settings["training"], description, device)
    train_set = StackedSet.of(train, device).subset(options.train_samples)
    validation_set = StackedSet.of(validation, device).subset(options.validation_samples)
    for name, part in (("training set", train_set), ("validation set", validation_set)):
        check_given(system, part.u, name)
    seen_y = train_set.y[: description["observed"], 0]
    if ranges is not None:
        seen_y = fill(seen_y, torch.tensor(description["t"][: len(seen_y)]), ends_of(ranges)[0].to(seen_y))
    decoder.fit(seen_y)
    given = {"steps": STEPS, "latent_width": WIDTH}
    how = settings["refinement"]
    refinement = RefinementSettings.from_mapping(how["settings"])
    noise = noise_of(how["noise"], system, description)
    whole = RefinementSettings.from_mapping({"starts": refinement.starts, "tries": refinement.tries, **given})
    free = refinement.free_start if "free_start" in refinement.model_fields_set else is_some(noise)
    t = torch.tensor(description["t"], dtype=torch.float64)
    assumed = assumed_noise(refinement, noise, description["bound"])

    def fit(decoder: Decoder, times: Tensor, settings: RefinementSettings, size: int) -> WindowFit:
        mean, std = (f(size, options.latent, dtype=torch.float64) for f in (torch.zeros, torch.ones))
        return WindowFit(
            decoder, times, settings, assumed, bool(free), how["prior"], Latent(mean, std), task.solver, ranges
        )

    used, seen = t[: task.horizon], t[: description["observed"]]
    fits = (
        fit(decoder, used, whole, len(seeds)),
        fit(Decoder(system), used, whole, 1),
        fit(decoder, seen, refinement.model_copy(update=given), len(seeds)),
    )
    name = f"{description['experiment']}/{description['label']} seeds {','.join(map(str, seeds))}"
    sets = train_set.windows(task.horizon), validation_set.windows(len(t))
    trainer = Alternation(*fits, *sets, task, seeds, options, name)
    return AlternatingTraining(trainer, description, validation_set.windows(len(seen)), classes or {})

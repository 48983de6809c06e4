"""Fine-tuning of the encoder on D ∪ D⁺, and the stage finetune."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TypeVar

import torch

from expertaug.errors import InputError
from expertaug.learning import augment
from expertaug.learning.augment import Augmented
from expertaug.learning.job import Job
from expertaug.learning.settings import FinetuneJob, FinetuneOptions, TrainSettings
from expertaug.learning.trainer import Progress, Training, encode_all, latent_of, prepare_training
from expertaug.learning.training_data import StackedSet, Task, set_files, task_of
from expertaug.models import store
from expertaug.models.card import ModelCard
from expertaug.models.decoder import LatentBound
from expertaug.models.hybrid import HybridNet
from expertaug.models.store import device_of
from expertaug.presets import Choices
from expertaug.settings import given_ranges
from expertaug.tracking.settings import Tracking
from expertaug.trajectories import Trajectories
from expertaug.wording import check_keys

# Of the options, what a model file says.
KEPT = ("experiment", "method", "label", "preset", "choices", "training")
Options = TypeVar("Options", bound=FinetuneOptions)
SMALLEST_SPREAD = 1e-3  # of z_a over the training windows: a component that none of them uses is not held to a point


def run_stage(
    model: Path,
    augmented: Path | None,
    data: Path,
    output: Path,
    work: Path,
    settings: FinetuneJob,
    tracking: Tracking | None,
) -> None:
    """Stage: fine-tune the encoder of a trained model.

    Arguments:
        model: file of the trained model.
        augmented: file of its D⁺; None: the control, trained on real data alone for as many steps.
        data: folder of the sets.
        output: model file.
        work: folder for checkpoints.
        settings: of the job.
        tracking: see :class:`expertaug.tracking.run_log.RunLog`.

    Raises:
        InputError: neither augmented samples nor the control's prior.
    """
    if augmented is None and settings.prior is None:
        raise InputError("--augmented", "missing", "give the augmented samples, or prior in the settings for a control")
    device = device_of(settings.device)
    stored = store.load(model, device, settings.classes or ())
    plus = None if augmented is None else augment.load(augmented, device, torch.tensor(stored.card.t))
    sets = set_files(data)
    train, validation = map(Trajectories.load, sets)
    inputs = [Path(model), *([] if augmented is None else [Path(augmented)]), *sets]
    options = inherit_options(stored, plus, settings)
    with Job(output, work, inputs, options, tracking, __name__) as job:
        job.write(finetune(stored, plus, train, validation, options, job))


def finetune(
    stored: store.StoredModel,
    plus: Augmented | None,
    train: Trajectories,
    validation: Trajectories,
    options: FinetuneOptions,
    progress: Progress | None = None,
) -> store.StoredModel:
    """Fine-tune the encoder on D ∪ D⁺ with θ frozen (paper, Algorithm 1); θ is asserted unchanged.

    Arguments:
        stored: a trained hybrid model; it stays as it is.
        plus: its D⁺; None for the control: every real sample stands twice in a pass, so that steps, batches and
            schedule are those of D ∪ D⁺.
        train, validation: the sets of its training.
        options: how to fine-tune; method and label name the augmented method; ``prior``, p⁺, for the control.
        progress: is told of the training while it runs.

    Raises:
        SolveError: no seed can be trained.
    """
    return prepare(stored, plus, train, validation, options).run(progress)


def prepare(
    stored: store.StoredModel,
    plus: Augmented | None,
    train: Trajectories,
    validation: Trajectories,
    options: FinetuneOptions,
) -> Training:
    """Make the fine-tuning of a trained model; arguments are those of :func:`finetune`."""
    options = inherit_options(stored, plus, options)
    device, choices, base = stored.device, options.choices, stored.card
    hybrid, before = _frozen(stored.model, choices)
    if options.training.bound_z_a:
        hybrid.decoder.latent_bound = _bound(base, device)
    scale = augment.prior_scale(hybrid, given_ranges(options.prior)).to(device)
    task = task_of(options.training, base, device, scale)
    needed = max(base.observed, task.points(choices))
    real, check = StackedSet.of(train, device, needed), StackedSet.of(validation, device)
    if options.training.z_a_supervision_weight and plus is not None:
        if plus.train.z_a is None:
            problem, remedy = "do not say with which z_a they were made", "draw them again (augment)"
            raise InputError("augmented samples", problem, remedy)
        std = latent_of(encode_all(hybrid, real.windows(base.observed), len(stored.seeds))[1]).std
        spread = torch.tensor(std, dtype=torch.float32, device=device).clamp_min(SMALLEST_SPREAD).unsqueeze(1)
        task = replace(task, z_a_scale=spread)
    card = base.but(
        **options.model_dump(include=set(KEPT)),
        stage="finetune",
        augmented_prior=options.prior,
        base_wall_s=base.wall_s,
    )
    return prepare_training(
        hybrid,
        partial(_sets, stored, plus, real, check, task, choices),
        task,
        card,
        options,
        stored.classes,
        before,
        real.windows(base.observed),
        check.windows(base.observed),
    )


def _bound(base: ModelCard, device: torch.device) -> LatentBound:
    """To the range of the training windows' z_a.

    Raises:
        InputError: the model's file does not say it, or it has no z_a.
    """
    support = base.support
    if support is None or support.least_z_a is None or support.most_z_a is None:
        remedy = "leave finetuning.bound_z_a out, or train the model again"
        raise InputError("model", "does not say where its z_a lie", remedy)
    ends = (torch.tensor(end, dtype=torch.float32, device=device) for end in (support.least_z_a, support.most_z_a))
    return LatentBound(*(end.unsqueeze(1) for end in ends))


def inherit_options(stored: store.StoredModel, plus: Augmented | None, options: Options) -> Options:
    """Options with what they inherit: of the training its solver, horizon and objective, of D⁺ its prior.

    Raises:
        InputError: a range of p⁺ is of no expert parameter.
    """
    base = stored.card
    if isinstance(options.prior, Mapping):
        check_keys(options.prior, [p.name for p in stored.model.system.expert_parameters], "prior", "expert parameter")
    inherited = {k: getattr(base.training, k) for k in ("solver", "horizon_s")}
    inherited = {k: value for k, value in inherited.items() if value is not None}
    objective = {**(base.training.objective or {}), **(base.carried or {}), **(options.training.objective or {})}
    training = TrainSettings.of(**inherited | options.training.to_json() | {"objective": objective})
    if options.choices.z_a_supervision == "off":
        training = training.model_copy(update={"z_a_supervision_weight": 0.0})
    prior = options.prior if plus is None else {name: tuple(ends) for name, ends in plus.drawing.prior.items()}
    return options.model_copy(update={"training": training, "prior": prior, "seeds": stored.seeds})


def _frozen(model: HybridNet, choices: Choices) -> tuple[HybridNet, dict[str, torch.Tensor]]:
    """A copy of the model that learns in its encoder alone, and the values of what it does not learn."""
    hybrid = copy.deepcopy(model)
    prefixes: list[str] = list(hybrid.decoder_prefixes)
    if choices.frozen == "interaction_and_z_e_head":
        prefixes.append(f"encoder.{hybrid.encoder.head_prefix}")
    before = {}
    for name, parameter in hybrid.named_parameters():
        frozen = name.startswith(tuple(prefixes))
        parameter.requires_grad_(not frozen)
        if frozen:
            before[name] = parameter.detach().clone()
    return hybrid, before


def _sets(
    stored: store.StoredModel,
    plus: Augmented | None,
    train: StackedSet,
    validation: StackedSet,
    task: Task,
    choices: Choices,
    points: int,
) -> tuple[StackedSet | Callable[[int], StackedSet], list]:
    """D ∪ D⁺ over the first ``points`` points, D⁺ drawn once or for every pass; and the validation sets."""
    real = train.window(points)
    checks = [(validation, task.selection(choices))]
    if plus is None:
        return real | real, checks
    first = task.observed if choices.augmented_selection == "forecast" else 1
    checks.append((plus.validation, range(first, len(plus.validation.y))))
    if choices.resample == "once":
        return real | plus.train, checks
    drawing, short = plus.drawing, task.shortened(points)

    def of_pass(epoch: int) -> StackedSet:
        return real | augment.generate(stored.model, train, short, drawing, 2 + epoch)

    return of_pass, checks

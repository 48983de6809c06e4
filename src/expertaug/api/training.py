"""Training, augmentation and fine-tuning in memory."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import Literal, TypeAlias, TypedDict, Unpack

import numpy as np
import pandas as pd

from expertaug.api import arguments
from expertaug.api.arguments import Noise, Ranges, check_sets, seeds_of
from expertaug.api.inference import check_or_grow_ranges
from expertaug.api.trained import TrainedModel
from expertaug.errors import InputError
from expertaug.learning import augment as augmenting
from expertaug.learning import finetune as finetuning
from expertaug.learning.augment import Augmented
from expertaug.learning.objectives import Aphynity, Objective
from expertaug.learning.settings import OBJECTIVE, FinetuneOptions, TrainOptions, TrainSettings
from expertaug.learning.train import train as train_model
from expertaug.learning.trainer import History
from expertaug.learning.training_data import StackedSet
from expertaug.models import describe
from expertaug.models.hybrid import HybridModel
from expertaug.presets import Choices, resolve
from expertaug.registry import check as check_class
from expertaug.systems.solvers.solver import Solver
from expertaug.trajectories import Trajectories

Preset: TypeAlias = Literal["corrected", "paper", "code"]
# A class, or functools.partial of one with its options.
ObjectiveLike: TypeAlias = type[Objective] | Callable[..., Objective]


class TrainingOptions(TypedDict, total=False):
    """How to train; see :class:`expertaug.learning.trainer.TrainSettings` for meaning and defaults."""

    epochs: int
    batch_size: int
    learning_rate: float
    schedule: Literal["one_cycle", "constant"]
    warmup: float
    clip_norm: float | None
    validate_every: int
    validation_samples: int | None
    supervision_weight: float
    z_a_supervision_weight: float
    bound_z_a: bool
    horizon_warmup: float
    expert_first: float
    restarts: int
    restart_gap: float


@dataclass(frozen=True)
class AugmentedSets:
    """D⁺ of a trained model: an augmented training and validation set of each seed.

    Attributes:
        t: times in s, (T,): those of the training set, of which each augmented set has the first.
        drawn: y (T, S, N, *state) and z_e (S, N, P) of both sets, and how they were drawn.
    """

    t: np.ndarray
    drawn: Augmented

    @property
    def seeds(self) -> list[int]:
        """The seeds, in the group's order."""
        return list(self.drawn.drawing.seeds)

    @property
    def train(self) -> list[Trajectories]:
        """The augmented training set of each seed."""
        return self._of(self.drawn.train)

    @property
    def validation(self) -> list[Trajectories]:
        """The augmented validation set of each seed."""
        return self._of(self.drawn.validation)

    def _of(self, part: StackedSet) -> list[Trajectories]:
        y, z_e = part.y.movedim(0, 2).cpu().numpy(), part.z_e.cpu().numpy()
        u = None if part.u is None else part.u.movedim(0, 2).cpu().numpy()
        mask = None if not np.isnan(y).any() else ~np.isnan(y)
        y = y if mask is None else np.nan_to_num(y)
        optional_arrays = [
            {name: value[k] for name, value in (("u", u), ("mask", mask)) if value is not None}
            for k in range(len(self.seeds))
        ]
        return [Trajectories(self.t[: y.shape[2]], y[k], z_e[k], **each) for k, each in enumerate(optional_arrays)]


def fit(
    model: HybridModel,
    train: Trajectories,
    validation: Trajectories,
    *,
    observed_s: float,
    objective: ObjectiveLike = Aphynity,
    seeds: Iterable[int] = (0,),
    prior: Ranges | None = None,
    start: Ranges | None = None,
    solver: Solver | None = None,
    forecast_solver: Solver | None = None,
    horizon_s: float | None = None,
    preset: Preset = "corrected",
    choices: Mapping[str, str] | None = None,
    label: str | None = None,
    device: str = "cpu",
    **options: Unpack[TrainingOptions],
) -> TrainedModel:
    """Train a hybrid model for a group of seeds (paper, section 2).

    Arguments:
        model: the recipe: system, encoder, interaction model.
        train, validation: sets of the same times; the second selects each seed's best state.
        observed_s: end of the observed window t1 in s, which is included.
        objective: :class:`Aphynity`, :class:`HybridVAE` or a class of your own, or functools.partial of one.
        seeds: of initialisation and data order; they are trained as one batched computation.
        prior: ranges [low, high] of p⁺ by expert parameter, for the objectives that need one (HybridVAE).
        start: ranges [low, high] of first values of components that nobody measured, in their units.
        solver: of the forecasts in training; default: one fourth-order Runge-Kutta step from time to time.
        forecast_solver: of later forecasts; default: adaptive (dopri5 to 1e-6; rk4 with 10 substeps
            where the system has events) where the training's is a coarse one.
        horizon_s: end of the loss window in s; default: that of the observed window.
        preset, choices: which of the paper's ambiguities are read how, and single rows of that table
            (:mod:`expertaug.presets`).
        label: name of the method in tables and figures; default: the objective's.
        device: auto, cpu or cuda.
        options: see :class:`TrainingOptions`.

    Returns:
        the best state of every seed.

    Raises:
        InputError: an argument that cannot be used.
        SolveError: a seed cannot be trained.
    """
    if not isinstance(model, HybridModel):
        raise InputError("model", f"is {type(model).__name__}", "give expertaug.HybridModel(system, encoder, …)")
    check_sets(model.system, train, validation)
    chosen = resolve(preset, choices)
    arguments.check_observed(observed_s, train.t)
    names = [p.name for p in model.system.expert_parameters]
    loss = describe.settings_of(OBJECTIVE, objective)
    check_class(OBJECTIVE, getattr(objective, "func", objective), "objective")
    described = describe.describe(model)
    further: dict[str, object] = {"objective": {k: v for k, v in loss.items() if k != "kind"}}
    further |= {} if arguments.solver(solver, "solver") is None else {"solver": solver}
    arguments.solver(forecast_solver, "forecast_solver")
    further |= (
        {} if horizon_s is None else {"horizon_s": float(horizon_s) if isinstance(horizon_s, Real) else horizon_s}
    )
    label = label or getattr(getattr(objective, "func", objective), "__name__", str(loss["kind"]))
    how = TrainOptions.of(
        experiment=described.system_name,
        method=label,
        label=label,
        preset=preset,
        training=TrainSettings.from_mapping({**options, **further}),
        t1_s=float(observed_s),
        start={} if start is None else arguments.start(start, model.system),
        choices=chosen,
        seeds=seeds_of(seeds),
        device=device,
        **({} if prior is None else {"prior": arguments.ranges(prior, names, "prior")}),
    )
    classes = describe.own_classes(model) | describe.class_of(OBJECTIVE, objective)
    history, kind = History(), loss["kind"]
    with arguments.one_thread():
        stored = train_model(model, train, validation, how, described, kind, classes, forecast_solver, history)
    return TrainedModel(stored, course(history, stored.seeds))


def augment(
    model: TrainedModel,
    train: Trajectories,
    validation: Trajectories,
    *,
    prior: Ranges | None = None,
    noise: Noise = 0.0,
    worst: float = 0.0,
    preset: Preset | None = None,
    choices: Mapping[str, str] | None = None,
) -> AugmentedSets:
    """Draw expert-augmented samples D⁺ from a trained model (paper, Algorithm 1, GenerateAugmentedSet).

    Arguments:
        model: trained; it stays as it is.
        train, validation: the sets of its training, whose x and observed windows are used.
        prior: ranges [low, high] of the augmentation prior p⁺(z_e), uniform, by parameter in its unit; None: those that
            :func:`expertaug.own_prior` finds without further windows.
        noise: standard deviation of the data's noise, which augmented samples get too.
        worst: share of the samples that are drawn where the model's own estimates are bad; 0: all uniformly.
        preset, choices: as of :func:`fit`; default: those of the training.

    Raises:
        InputError: the prior does not name the expert parameters, or the sets are not of the model's system and times.
        SolveError: samples are not finite for any z_e drawn.
    """
    check_trained(model, train, validation)
    ranges = check_or_grow_ranges(model, train, prior, arguments.noise(noise))
    rows = _choices(model, preset, choices)[1]
    with arguments.one_thread():
        drawn = augmenting.augment(
            model.stored, train, validation, ranges, arguments.noise(noise), rows, arguments.share(worst, "worst")
        )
    return AugmentedSets(model.t, drawn)


def finetune(
    model: TrainedModel,
    train: Trajectories,
    validation: Trajectories,
    *,
    prior: Ranges | None = None,
    noise: Noise = 0.0,
    augmented: AugmentedSets | None = None,
    control: bool = False,
    preset: Preset | None = None,
    choices: Mapping[str, str] | None = None,
    label: str | None = None,
    **options: Unpack[TrainingOptions],
) -> TrainedModel:
    """Fine-tune the encoder on D ∪ D⁺ with the interaction model frozen (paper, Algorithm 1): APHYNITY+, HVAE+.

    Arguments:
        model: trained; it stays as it is.
        train, validation: the sets of its training.
        prior, noise: D⁺ is drawn with them, as by :func:`augment`.
        augmented: D⁺ itself, instead.
        control: train the control of equal compute instead: no D⁺, every real sample twice in a pass, so as many steps
            of the same size.  The prior is still that of the augmented version: a hybrid-VAE's loss has it.
        preset, choices: as of :func:`fit`; default: those of the training.
        label: default: the model's own with a +, or with (control).
        options: see :class:`TrainingOptions`; a schedule of its own, not that of the training.

    Raises:
        InputError: an argument that cannot be used.
        SolveError: a seed cannot be trained.
    """
    if prior is not None and augmented is not None:
        raise InputError("finetune", "given both prior and augmented", "give one of them")
    if control and augmented is not None:
        raise InputError("finetune", "given both control and augmented", "a control sees no augmented samples")
    if augmented is None and not control:
        augmented = augment(model, train, validation, prior=prior, noise=noise, preset=preset, choices=choices)
    check_trained(model, train, validation)
    if augmented is not None and augmented.seeds != model.seeds:
        raise InputError("augmented", f"holds seeds {augmented.seeds}", f"the model's are {model.seeds}: augment it")
    name, chosen = _choices(model, preset, choices)
    label = label or (f"{model.label} (control)" if control else f"{model.label}+")
    how = FinetuneOptions.of(
        experiment=model.stored.card.experiment,
        method=label,
        label=label,
        preset=name,
        training=TrainSettings.from_mapping(options),
        choices=chosen,
        seeds=model.seeds,
        **({"prior": check_or_grow_ranges(model, train, prior, arguments.noise(noise))} if control else {}),
    )
    drawn = None if augmented is None else augmented.drawn
    history = History()
    with arguments.one_thread():
        tuned = finetuning.finetune(model.stored, drawn, train, validation, how, history)
    return TrainedModel(tuned, course(history, tuned.seeds), model.single)


def course(history: History, seeds: Sequence[int]) -> pd.DataFrame:
    """The course of a training of some seeds: columns step, seed, metric, value."""
    rows = [
        (step, seed, metric, value)
        for step, line in history.lines
        for metric, values in line.items()
        for seed, value in zip(seeds, values, strict=True)
    ]
    return pd.DataFrame(rows, columns=["step", "seed", "metric", "value"])


def _choices(model: TrainedModel, preset: str | None, choices: Mapping[str, str] | None) -> tuple[str, Choices]:
    """Preset and all its rows, by default those of the model's training."""
    card = model.stored.card
    own = {} if preset else card.choices.to_json()
    name = preset or card.preset
    return name, resolve(name, {**own, **(choices or {})})


def check_trained(model: TrainedModel, train: Trajectories, validation: Trajectories) -> None:
    if not isinstance(model, TrainedModel):
        raise InputError("model", f"is {type(model).__name__}", "give what expertaug.fit returns")
    if not model.stored.kind.has_objective:
        raise InputError("model", f"a {model.stored.card.kind} model", "only hybrid models can be augmented")
    check_sets(model.system, train, validation)
    arguments.same_times(train.t, model.t, "train", "give the sets of its training")

"""Settings of trainings and of the jobs of learning, options and kinds of the objectives; torch is not loaded here."""

import math
from collections.abc import Callable, Mapping
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, model_validator

from expertaug.models import estimators
from expertaug.models.estimators import EstimatorKind
from expertaug.models.fit_settings import Refinement
from expertaug.models.settings import PARTS as MODEL_PARTS
from expertaug.models.settings import PartsSettings, SystemKeys
from expertaug.presets import ROWS, Choices, Preset
from expertaug.registry import Part, find, full_name
from expertaug.settings import (
    LEFT_OUT,
    LIST,
    ONE,
    ByName,
    Count,
    Device,
    Noise,
    NotNegative,
    Positive,
    Prior,
    Range,
    Raw,
    Seeds,
    Settings,
    Share,
    by_shape,
    check,
    disagree,
    key,
    read,
)
from expertaug.systems.settings import SYSTEMS, SolverSettings

DEFAULT_OBJECTIVE = "aphynity"
# Rows of the preset's table that every training obeys.
OBEYED_IN_TRAINING = (
    "loss_window",
    "multiplier",
    "penalty",
    "loss_normalisation",
    "supervision",
    "selection",
    "hvae_z_e",
)


class ObjectiveSettings(Settings):
    """Options of an objective.

    Attributes:
        CLASS: ``module:Class`` in this folder.
        NEEDS: what the package gives it besides seeds and choices.
    """

    CLASS: ClassVar[str]
    WHERE: ClassVar[str] = "objective"
    NEEDS: ClassVar[tuple[str, ...]] = ()


class AphynitySettings(ObjectiveSettings):
    """APHYNITY: the data term with a Lagrange multiplier, and the size of F_a."""

    CLASS = "objectives:Aphynity"

    lambda0: Annotated[
        Annotated[NotNegative, ONE] | Annotated[Annotated[tuple[NotNegative, ...], Field(strict=False)], LIST], by_shape
    ] = key(10.0, "initial multiplier of the data term; one value, or one for each seed")
    tau2: NotNegative = key(5.0, "the multiplier is raised by this times the data term")
    every: Count = key(1, "number of passes from one raise of the multiplier to the next")
    share: NotNegative = key(
        0.0,
        "weight of the part of F_a that another z_e would say as well, where the components of the state are "
        "independent; 0 = it does not count, as in the paper",
    )


class HvaeSettings(ObjectiveSettings):
    """The hybrid-VAE's evidence lower bound and its regularisers."""

    CLASS = "hvae:HybridVAE"
    NEEDS = ("prior",)

    alpha: NotNegative = key(
        0.01,
        "weight of the term R_PPC, which pulls the forecast towards the expert's and the posterior towards the prior",
    )
    beta: NotNegative = key(0.01, "weight of the term R_DA1, which makes the filtered window the expert's own")
    gamma: NotNegative = key(
        1.0, "weight of the term R_DA2, the error of z_e inferred from the expert's forecasts over p⁺"
    )


OBJECTIVES: Mapping[str, type[ObjectiveSettings]] = {"aphynity": AphynitySettings, "hvae": HvaeSettings}
OBJECTIVE = Part(
    "objective",
    {kind: f"expertaug.learning.{settings.CLASS}" for kind, settings in OBJECTIVES.items()},
    base="expertaug.learning.objectives:Objective",
    needed="loss",
    given=("seeds", "choices", "prior"),
)
ALL_PARTS = {**MODEL_PARTS, OBJECTIVE.name: OBJECTIVE}


class TrainSettings(Settings):
    """How a model is trained, or fine-tuned."""

    WHERE: ClassVar[str] = "training"

    epochs: Count = key(50, "number of passes over the training set")
    batch_size: Count = key(100, "samples per seed in each step")
    learning_rate: Positive = key(5.0e-4, "learning rate of Adam; its peak where the schedule has one")
    schedule: Literal["one_cycle", "constant"] = key(
        "one_cycle", "one_cycle = linear warm-up, then a cosine decay to zero; constant = the same rate throughout"
    )
    warmup: Share = key(0.1, "share of all steps over which one_cycle warms up")
    clip_norm: Positive | None = key(1.0, "largest norm of a seed's gradient; null = no clipping")
    validate_every: Count = key(1, "number of passes from one validation to the next")
    validation_samples: Count | None = key(None, "maximum number of validation samples, spread evenly; null = all")
    checkpoint_s: NotNegative = key(30.0, "shortest time between two checkpoints", "s")
    supervision_weight: NotNegative = key(1.0, "weight of the z_e term of augmented samples")
    z_a_supervision_weight: NotNegative = key(
        0.0,
        "weight of the z_a term of augmented samples, whose z_a is known as well, in units of the spread that the "
        "trained model's z_a has over the training windows; 0 = z_a is not supervised, as in the paper",
    )
    bound_z_a: bool = key(
        False,
        "whether F_a sees a z_a beyond the trained model's training windows' softly bounded, at most a tenth of their "
        "range outside it; of fine-tuning, and of what is made of its model",
    )
    horizon_warmup: Share = key(
        0.0,
        "share of all steps over which the loss window grows to its full length; this guards against minima at wrong "
        "frequencies",
    )
    expert_first: Share = key(
        0.0,
        "share of all steps, at the beginning, in which F_a is absent; otherwise F_a takes over part of what the "
        "expert can explain before z_e is found",
    )
    restarts: Annotated[int, Field(ge=0, le=3)] = key(
        0,
        "how often a seed is begun anew, at most, from other first weights, where it is restart_gap behind the best "
        "seed of its job; of trainings, not of fine-tunings",
    )
    restart_gap: Positive = key(1.0, "how far behind the best seed's selection score a seed has failed")
    horizon_s: Positive = key(
        LEFT_OUT,
        "end of the part of a trajectory that the loss compares; left out = data.t1_s, or in fine-tuning that of "
        "training",
        "s",
    )
    objective: dict[str, Any] = key(
        LEFT_OUT, "options of the method's objective (fine-tuning inherits those of training)"
    )
    solver: SolverSettings = key(
        LEFT_OUT,
        "solver for the differential equation in training; left out = its defaults, or in fine-tuning that of training",
    )

    def rate(self, step: int, steps: int) -> float:
        """Learning rate of step ``step`` of ``steps``."""
        if self.schedule == "constant":
            return self.learning_rate
        return self.learning_rate * one_cycle(step, steps, self.warmup)

    def alone(self, step: int, steps: int) -> bool:
        """Whether F_a is absent in step ``step`` of ``steps``."""
        return step < self.expert_first * steps

    def points(self, horizon: int, step: int, steps: int) -> int:
        """Points of the loss window in step ``step`` of ``steps``, ``horizon`` at the end."""
        growing = self.horizon_warmup * steps
        return horizon if step + 1 >= growing else max(2, math.ceil(horizon * (step + 1) / growing))


EstimatorKind.training = TrainSettings


def one_cycle(step: int, steps: int, warmup: float) -> float:
    """Share of the peak's learning rate in step ``step`` of ``steps``: a linear warm-up, then a cosine to zero."""
    warm = max(warmup * steps, 1)
    if step < warm:
        return (step + 1) / warm
    return 0.5 * (1 + math.cos(math.pi * (step - warm) / max(steps - warm, 1)))


class SeedGroupJob(Settings):
    """A job of a method of an experiment, for a group of its seeds.

    Attributes:
        OBEYS: rows of the preset's table that the stage obeys: it needs them, and looks at no others.
    """

    WHERE: ClassVar[str] = "--settings"
    OBEYS: ClassVar[tuple[str, ...]] = ()

    experiment: str = key(..., "name of the experiment")
    method: str = key(..., "name of the method's version")
    choices: Choices = key(..., "rows of the preset's table that the stage obeys")
    seeds: Seeds = key(..., "of the group")
    device: Device = key("cpu", "where to compute")

    @model_validator(mode="after")
    def _knows_what_it_obeys(self) -> Self:
        missing = [row for row in self.OBEYS if row not in self.choices.model_fields_set]
        if missing:
            raise disagree("missing", f"give {missing[0]} ({ROWS[missing[0]].meaning})", f"choices.{missing[0]}")
        return self


class LabelledJob(SeedGroupJob):
    """The same with what logs and tables call it."""

    label: str = key(..., "what tables print")
    preset: Preset = key(..., "name of the preset")


class ModelFileJob(SeedGroupJob):
    """A job that begins with a model file."""

    classes: list[str] = key(LEFT_OUT, "classes from elsewhere that the model file may name")


class MethodKeys(Settings):
    """What a method is, in the words of the configuration."""

    kind: Annotated[str, ByName(estimators.methods)] = key(
        ..., "; ".join(f"{name} = {estimators.ESTIMATORS[name].summary}" for name in estimators.methods())
    )
    expert: bool = key(LEFT_OUT, "false removes the expert model")
    interaction: bool = key(LEFT_OUT, "false removes the interaction model")
    truth: bool = key(
        LEFT_OUT,
        "for kind least_squares: true uses the equation that generated the simulated data, which gives a floor for "
        "methods that learn it",
    )
    objective: Annotated[str, ByName(lambda: OBJECTIVES)] = key(LEFT_OUT, "name of the objective; left out = aphynity")
    known_form: bool = key(
        LEFT_OUT,
        "true = the F_a of this method has the form of the hidden term; tables and figures show it after the others",
    )

    @property
    def estimator(self) -> type[EstimatorKind]:
        """What the kind is, and can do."""
        return estimators.estimator(self.kind, "build.kind")

    @property
    def parts(self) -> tuple[str, ...]:
        """Networks that the method learns, of encoder and interaction."""
        return tuple(part for part in self.estimator.parts if part != "interaction" or self.interaction is not False)

    @property
    def objective_kind(self) -> str:
        """Kind of the objective."""
        return self.objective or DEFAULT_OBJECTIVE

    @property
    def has_expert(self) -> bool:
        return self.expert is not False

    @property
    def has_interaction(self) -> bool:
        return self.interaction is not False


class Build(MethodKeys):
    """How a method is built in an experiment."""

    WHERE: ClassVar[str] = "build"

    system: dict[str, Any] = key(LEFT_OUT, "arguments of the system's class that are otherwise for this method")


class RecipeKeys(Settings):
    """What a model is made of, in the words of the configuration."""

    system: SystemKeys = key(..., "name and arguments of the system")
    build: Build = key(..., "how the method is built")
    model: PartsSettings = key(..., "encoder and interaction")
    shared: list[str] = key(list, "expert parameters that all windows share, of kind hybrid_shared alone")

    @model_validator(mode="after")
    def _system_of_the_method(self) -> Self:
        of_method = self.build.system or {}
        kind = SYSTEMS.get(str((self.system | of_method)["name"]))
        if kind is not None and (errors := check(kind, self.system | of_method, "build.system")):
            raise disagree(errors[0].found, errors[0].remedy, errors[0].where)
        return self


class WindowKeys(Settings):
    """What of a trajectory is observed."""

    t1_s: Positive = key(..., "end of the observed window", "s")
    start: dict[str, Range] = key(
        dict, "range of the first values of components that nobody measured, or not always, in their units"
    )


class DataOptions(LabelledJob, WindowKeys):
    """What of the options of every way to make a model a model file says."""

    WHERE: ClassVar[str] = ""  # of arguments, in memory

    training: Any


class TrainOptions(DataOptions):
    """How a hybrid model is trained, in memory too."""

    OBEYS = (*OBEYED_IN_TRAINING, "observed_points")

    training: TrainSettings = key(..., "how it is trained")
    prior: Prior = key(LEFT_OUT, "p⁺, for the objectives that need it; own = --prior has it")
    device: str = key("cpu", "where to compute: auto, or a device of torch's")  # type: ignore[assignment]
    snapshots: list[Count] = key(list, "passes after which the state is kept")


class TrainJob(TrainOptions, RecipeKeys):
    """A training of a hybrid model."""

    device: Device = key("cpu", "where to compute")

    @model_validator(mode="after")
    def _whole(self) -> Self:
        needed = {"encoder": True, "interaction": self.build.has_interaction}
        for part, wanted in needed.items():
            if wanted and getattr(self.model, part) is None:
                raise disagree("missing", f"a hybrid model has an {part}", f"model.{part}")
        options = OBJECTIVES.get(self.build.objective_kind)
        if options is not None and (errors := check(options, self.training.objective or {}, "training.objective")):
            raise disagree(errors[0].found, errors[0].remedy, errors[0].where)
        return self


class SolverOnly(Settings):
    """What is left of a training for what is not trained."""

    WHERE: ClassVar[str] = "training"

    solver: SolverSettings = key(LEFT_OUT, "solver for the differential equation; left out = its defaults")


class UntrainedOptions(DataOptions):
    """How a method is made that has no training, in memory too."""

    OBEYS = ("observed_points",)

    training: SolverOnly = key(SolverOnly, "its solver")
    refinement: Refinement | None = key(LEFT_OUT, "how windows are fitted, of kind least_squares")


class UntrainedJob(UntrainedOptions, RecipeKeys):
    """The job of a method that no gradient step trains."""


class AugmentJob(ModelFileJob):
    """An augmentation."""

    OBEYS = ("loss_window", "augmentation_noise", "augmented_x", "augmented_z_a", "augmented_selection")

    prior: Prior = key(..., "p⁺; own = --prior has it")
    noise: Noise = key(..., "standard deviation of the noise of the data, which augmented samples get too")
    worst: Share = key(0.0, "share of the samples that are drawn where the model's own estimates are bad")


class FinetuneOptions(LabelledJob):
    """How a model is fine-tuned, in memory too."""

    WHERE: ClassVar[str] = ""

    OBEYS = (*OBEYED_IN_TRAINING, "frozen", "resample", "augmented_selection", "z_a_supervision")

    training: TrainSettings = key(..., "how it is fine-tuned")
    prior: Prior = key(LEFT_OUT, "p⁺, of a control alone; own = --prior has it")

    @model_validator(mode="after")
    def _goes_on(self) -> Self:
        if self.training.restarts:
            raise disagree(
                f"found {self.training.restarts}", "a fine-tuning goes on from one state: 0", "training.restarts"
            )
        return self


class FinetuneJob(FinetuneOptions, ModelFileJob):
    """A fine-tuning."""


def train_job_kind(settings: Raw) -> type[TrainJob] | type[UntrainedJob]:
    """What job of the stage train settings are of, by the kind of their method."""
    build = settings.get("build")
    name = build.get("kind") if isinstance(build, Mapping) else None
    is_known = isinstance(name, str) and (":" in name or name in estimators.methods())
    kind = estimators.estimator(str(name), "build.kind") if is_known else estimators.Hybrid
    return TrainJob if kind.trains() else UntrainedJob


def train_job(settings: Raw) -> TrainJob | UntrainedJob:
    """The job of the stage train.

    Raises:
        InputError: a key is missing or unknown, or a value cannot be used.
    """
    return read(train_job_kind(settings), settings)


def named_modules(system: str, model: Mapping[str, Mapping], objective: str | None) -> list[str]:
    """What a model and its training name: the module of the system, classes as ``package.module:Class``.

    Arguments:
        system: a module of ``expertaug.systems``, or a dotted path.
        model: settings of the encoder and of the interaction, those that there are, with their kind.
        objective: its kind; None where nothing is trained.
    """
    kinds = {name: model[name]["kind"] for name in ALL_PARTS if name in model}
    if objective is not None:
        kinds["objective"] = objective
    named = [full_name(ALL_PARTS[name], kind, name) for name, kind in kinds.items()]
    return [system if "." in system or ":" in system else f"expertaug.systems.{system}", *named]


def objective_of(kind: str, classes: Mapping[str, Callable] | None = None) -> Any:
    """The class of an objective's kind.

    Arguments:
        classes: by name, instead of what importing the name would give.
    """
    return (classes or {}).get(kind) or find(OBJECTIVE, kind, "objective")

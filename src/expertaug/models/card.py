"""What a model file says of its model, in the header: how it is made again, of what data, and how it was trained."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Self

from pydantic import ConfigDict, Field, field_validator, model_validator

from expertaug.models.fit_settings import Refinement
from expertaug.presets import Choices, Preset
from expertaug.settings import LEFT_OUT, Range, Settings, disagree, key, wrong
from expertaug.systems.settings import SolverSettings

MOST_SEEDS = 10_000  # of a group
Names = list[list[str]]


class TrainingRecord(Settings):
    """How a model was trained: what those who use it ask for, and what else its training was told
    (:attr:`~expertaug.models.estimators.EstimatorKind.training`)."""

    model_config = ConfigDict(extra="allow")

    solver: SolverSettings = key(LEFT_OUT, "for the differential equation")
    horizon_s: float = key(LEFT_OUT, "end of the loss window", "s")
    supervision_weight: float = key(LEFT_OUT, "of the z_e term of augmented samples")
    z_a_supervision_weight: float = key(LEFT_OUT, "of their z_a term")
    bound_z_a: bool = key(LEFT_OUT, "whether F_a sees z_a bounded to the range of the training windows'")
    objective: dict[str, Any] = key(LEFT_OUT, "options of the objective")


class PartsRecord(Settings):
    """Kind and arguments of each part of a model."""

    encoder: dict[str, Any] = key(LEFT_OUT, "of kind hybrid")
    interaction: dict[str, Any] = key(LEFT_OUT, "F_a, where there is one")

    @field_validator("encoder", "interaction")
    @classmethod
    def _says_its_kind(cls, value: dict[str, Any]) -> dict[str, Any]:
        if not isinstance(value.get("kind"), str):
            raise wrong("names no kind", "give kind", "kind")
        return value


class LatentRecord(Settings):
    """Where z_a of the training windows lie: S seeds, Q components, C principal axes."""

    mean: list[list[float]] = key(..., "(S, Q)")
    std: list[list[float]] = key(..., "(S, Q)")
    axes: list[list[list[float]]] = key(LEFT_OUT, "(S, C, Q), each as long as its standard deviation")


class SupportRecord(Settings):
    """Range of the estimates of the training windows: S seeds, P expert parameters, Q components of z_a."""

    least_z_e: list[list[float]] = key(LEFT_OUT, "(S, P)")
    most_z_e: list[list[float]] = key(LEFT_OUT, "(S, P)")
    least_z_a: list[list[float]] = key(LEFT_OUT, "(S, Q)")
    most_z_a: list[list[float]] = key(LEFT_OUT, "(S, Q)")


class MisfitRecord(Settings):
    """Misfits of windows on which nothing was fitted, a list a seed, and what is expected of the forecasts' errors."""

    validation: list[list[float]] = key(..., "(S, N)")
    expected: list[list[float]] = key(LEFT_OUT, "by each seed, (S, M)")
    between: list[float] = key(LEFT_OUT, "variance of the forecasts between the seeds, (M,)")

    def of_seeds(self, places: Sequence[int]) -> "MisfitRecord":
        """Of some of the seeds by their places, whose variance is another one than that of all."""
        every = {"validation": self.validation, "expected": self.expected}
        chosen: dict[str, Any] = {name: [of[k] for k in places] for name, of in every.items() if of is not None}
        if self.between is not None and list(places) == list(range(len(self.validation))):
            chosen["between"] = self.between
        return MisfitRecord.of(**chosen)


class RecipeRecord(Settings):
    """What a model is made of, as names and plain values."""

    system: dict[str, Any] = key(..., "name and arguments of the system")
    model: PartsRecord = key(PartsRecord, "encoder and interaction")
    expert: bool = key(True, "whether there is one")
    interaction: bool = key(True, "whether there is a model of it")
    shared: list[str] = key(list, "expert parameters that are constants of the model")

    @model_validator(mode="after")
    def _names_its_system(self) -> Self:
        if not isinstance(self.system.get("name"), str):
            raise disagree("names no system", "give its name", "system")
        return self

    @property
    def system_name(self) -> str:
        """Name of the system."""
        return self.system["name"]


class ModelCard(RecipeRecord):
    """All that is known about a model but its tensors; a model file has it in its header.

    Keys that a kind of model has not are missing in the file and None here.
    """

    WHERE: ClassVar[str] = "card"

    kind: str = key(..., "of the estimator", min_length=1)
    experiment: str = key(LEFT_OUT, "name of the experiment")
    method: str = key(LEFT_OUT, "name of the method's version")
    label: str = key(LEFT_OUT, "what tables print")
    preset: Preset = key(LEFT_OUT, "name of the preset")
    stage: str = key(LEFT_OUT, "that made it")
    choices: Choices = key(LEFT_OUT, "rows of the preset's table")
    seeds: Annotated[list[Annotated[int, Field(ge=0)]], Field(min_length=1, max_length=MOST_SEEDS)] = key(
        ..., "of the group, in its order"
    )
    # The data.
    t: list[float] = key(..., "all times of a trajectory", "s")
    observed: Annotated[int, Field(ge=1)] = key(..., "points of the observed window")
    observed_s: float = key(LEFT_OUT, "its end", "s")
    bound: list[float] = key(LEFT_OUT, "how far each component of a forecast may go")
    start: dict[str, Range] = key(LEFT_OUT, "ranges of first values, where windows have gaps")
    data_noise: list[float] = key(LEFT_OUT, "of each component, as it was estimated from the measurements")
    # The recipe.
    likelihood: bool = key(LEFT_OUT, "whether a likelihood's scale was learned")
    objective: str = key(LEFT_OUT, "kind of the objective")
    truth: bool = key(LEFT_OUT, "whether the expert is the equation that made the data")
    latent_size: Annotated[int, Field(ge=0)] = key(LEFT_OUT, "size of z_a, without an encoder")
    state: Names = key(LEFT_OUT, "name and unit of each component")
    expert_parameters: Names = key(LEFT_OUT, "name and unit of each")
    inputs: Names = key(LEFT_OUT, "name and unit of each known input")
    covariates: Names = key(LEFT_OUT, "name and unit of each")
    # Its training.
    training: TrainingRecord = key(TrainingRecord, "how it was trained")
    refinement: Refinement | None = key(LEFT_OUT, "how windows are fitted, where estimates are found so")
    forecast_solver: SolverSettings = key(LEFT_OUT, "for forecasts")
    augmented_prior: dict[str, Range] = key(LEFT_OUT, "p⁺ of the fine-tuning")
    wall_s: float = key(LEFT_OUT, "of the training", "s")
    base_wall_s: float = key(LEFT_OUT, "of the training before", "s")
    best_score: list[float | None] | None = key(LEFT_OUT, "of each seed on the validation set")
    best_epoch: list[int] = key(LEFT_OUT, "of each seed")
    best_step: list[int] = key(LEFT_OUT, "of each seed")
    restarts: list[int] = key(LEFT_OUT, "how often each seed was begun anew")
    carried: dict[str, Any] = key(LEFT_OUT, "options of the objective that a fine-tuning takes over")
    failed: list[int] = key(LEFT_OUT, "seeds that could not be trained")
    latent: LatentRecord = key(LEFT_OUT, "where z_a of the training windows lie")
    misfit: MisfitRecord = key(LEFT_OUT, "of validation windows")
    support: SupportRecord = key(LEFT_OUT, "range of the estimates of the training windows")
    # A flow.
    flow: dict[str, Any] = key(LEFT_OUT, "how it learned, and is used")
    prior: dict[str, Range] = key(LEFT_OUT, "p⁺ of its draws")
    noise: float | list[float] = key(LEFT_OUT, "standard deviation of the noise of its draws")
    base: "ModelCard" = key(LEFT_OUT, "of the model whose draws it learned from")

    @model_validator(mode="after")
    def _is_consistent(self) -> Self:
        if any(not a < b for a, b in pairwise(self.t)):
            raise disagree("does not increase", "give increasing times", "t")
        if self.observed > len(self.t):
            raise disagree(f"found {self.observed}", f"there are {len(self.t)} times", "observed")
        return self

    @property
    def has_gaps(self) -> bool:
        """Whether windows may have values that were not measured."""
        return self.start is not None

    @property
    def shared_groups(self) -> dict[str, int]:
        """Expert parameters that all windows share, with the number of independent groups of windows that each is
        from; 1 where the model's training learned it."""
        fitted = self.refinement or (self.base.refinement if self.base is not None else None)
        if fitted is None or (self.refinement is None and not fitted.shared):
            return dict.fromkeys(self.shared, 1)
        return {name: constant.groups for name, constant in (fitted.shared or {}).items()}

    def but(self, **changes: Any) -> "ModelCard":
        """The same card with some keys otherwise; None takes one away."""
        kept = {name: getattr(self, name) for name in self.model_fields_set} | changes
        return ModelCard.of(**{name: value for name, value in kept.items() if value is not None})

    def of_seeds(self, places: Sequence[int]) -> "ModelCard":
        """What the card says of the group's seeds at some places, from 0: one value a seed becomes theirs."""
        chosen: dict[str, Any] = {}
        for name in ("seeds", "best_score", "best_epoch", "best_step", "restarts"):
            if (values := getattr(self, name)) is not None:
                chosen[name] = [values[k] for k in places]

        def theirs(block: Mapping[str, Any]) -> dict[str, Any]:
            each = {k: v for k, v in block.items() if isinstance(v, list) and len(v) == len(self.seeds)}
            return {**block, **{name: [values[k] for k in places] for name, values in each.items()}}

        if self.carried is not None:
            chosen["carried"] = theirs(self.carried)
        if self.misfit is not None:
            chosen["misfit"] = self.misfit.of_seeds(places)
        if self.refinement is not None:
            chosen["refinement"] = self.refinement.of_seeds(places)
        for name in ("latent", "support"):
            if (record := getattr(self, name)) is not None:
                chosen[name] = theirs(record.model_dump())
        return self.but(**chosen)

"""Settings of inference; torch is not loaded here."""

from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from expertaug.learning.settings import (
    DataOptions,
    LabelledJob,
    ModelFileJob,
    RecipeKeys,
    SolverOnly,
    TrainSettings,
    UntrainedOptions,
    WindowKeys,
)
from expertaug.models.estimators import Alternating
from expertaug.models.fit_settings import Refinement, RefinementSettings
from expertaug.models.settings import Hidden, Width
from expertaug.settings import (
    LEFT_OUT,
    Count,
    Device,
    Noise,
    NotNegative,
    Positive,
    Prior,
    Settings,
    Share,
    disagree,
    key,
)
from expertaug.systems.settings import SolverSettings

SCORES = 25  # of the draws held out in a training of a flow, at most


class FlowSettings(Settings):
    """How a flow learns the posterior from draws of a trained model, and how it is used."""

    WHERE: ClassVar[str] = "flow"

    steps: Count = key(8000, "number of training steps")
    batch_size: Count = key(256, "draws per seed in each step")
    learning_rate: Positive = key(
        4.0e-3, "learning rate of Adam, at its peak between a linear warm-up and a cosine decay to zero"
    )
    warmup: Share = key(0.1, "share of all steps over which the learning rate warms up")
    clip_norm: Positive | None = key(1.0, "largest norm of a seed's gradient; null = no clipping")
    pool: Count = key(4096, "number of draws per seed that are available at a time")
    uses: Count = key(
        1,
        "number of steps in which each draw is used; 1 = fresh draws in every step; use more where draws are expensive",
    )
    held_out: Count = key(2000, "number of further draws per seed; the loss on them selects the best state")
    layers: Hidden = key((256, 256), "widths of the hidden layers of the network that reads the observed window")
    summary: Width = key(64, "number of values that this network passes to the flow")
    transforms: Annotated[int, Field(ge=1, le=100)] = key(
        2, "number of splines, each autoregressive over the parameters"
    )
    hidden: Hidden = key((64, 64), "widths of the hidden layers of the networks that set the splines")
    bins: Annotated[int, Field(ge=2, le=1000)] = key(8, "number of bins in a spline")
    latent: Count = key(
        8, "maximum number of principal components of z_a that are inferred; the others stay at their mean"
    )
    jitter: NotNegative = key(
        0.1,
        "width of the kernel that smooths z_a and the first points of the training windows, in their standard "
        "deviations",
        le=1,
    )
    resample_x: bool = key(
        LEFT_OUT,
        "whether draws start anywhere, as far as the system defines this (the double pendulum's angles: on the whole "
        "circle), rather than where training windows start; otherwise windows that start elsewhere are misread; left "
        "out = as augmented_x says",
    )
    margin: Positive = key(0.02, "how far the flow's bounds lie beyond p⁺ at both ends, as a share of the width of p⁺")
    samples: Count = key(119, "number of posterior draws in an estimate; 119 give exact 50 % and 90 % intervals")
    forecasts: Count = key(
        32,
        "how many of these draws are forecast; the forecast is their mean. They are spread evenly, and the mean over "
        "32 agrees with the mean over all to within 0.02 of a log-MSE",
    )
    checkpoint_s: NotNegative = key(30.0, "shortest time between two checkpoints", "s")
    solver: SolverSettings = key(LEFT_OUT, "solver for the draws; left out = that of the model's forecasts")

    @property
    def training(self) -> TrainSettings:
        """The same for the trainer, whose pass is one over the pool."""
        epochs = max(round(self.steps * self.batch_size / self.size), 1)
        return TrainSettings(
            epochs=epochs,
            batch_size=self.batch_size,
            learning_rate=self.learning_rate,
            warmup=self.warmup,
            clip_norm=self.clip_norm,
            validate_every=max(epochs // SCORES, 1),
            checkpoint_s=self.checkpoint_s,
        )

    @property
    def renewed(self) -> int:
        """Draws of the pool that are replaced after each pass."""
        return max(self.pool // self.uses, 1)

    @property
    def size(self) -> int:
        """Draws of the pool: a whole number of renewals."""
        return self.renewed * self.uses


class ValiditySettings(Settings):
    """The check of assumption A1: does F_a hold where z_e has moved?"""

    WHERE: ClassVar[str] = "validity"

    samples: Count = key(60, "maximum number of windows of each set that are fitted, spread evenly")
    steps: Count = key(40, "number of gradient steps on F_a, starting from the trained F_a")
    learning_rate: Positive = key(1.0e-3, "learning rate of Adam")


class OwnWindows(Settings):
    """Windows that a model itself makes over p⁺."""

    WHERE: ClassVar[str] = "own"

    prior: Prior = key(..., "p⁺; own = --prior has it")
    resample_x: bool = key(False, "whether they start anywhere, as far as the system defines this")
    z_a_from: Literal["posterior", "prior"] = key("posterior", "what their z_a are drawn from, as augmented_z_a says")


class TeacherForcing(Settings):
    """First steps of F_a, on forecasts from each measured point to the next: for an expert that alone leads far from
    the data. Every component is to be measured."""

    WHERE: ClassVar[str] = "alternation.teacher_forcing"

    steps: Count = key(1000, "number of gradient steps")
    learning_rate: Positive = key(0.01, "learning rate of Adam, at its peak")
    estimates: Literal["gradient", "least_squares"] = key(
        "gradient",
        "what improves windows' own parameters beside F_a: gradient = gradient steps on z_a, with z_e as whole windows "
        "have it; least_squares = a Gauss–Newton step on z_e and z_a for each of F_a's, from what points say of the "
        "expert alone; what windows share stays as it is",
    )
    points: Count | None = key(
        None, "how many of a window's points forecasts begin at in a step, drawn by its number; null = all"
    )


class AlternatingSettings(Settings):
    """A training of F_a without an encoder: each window's own estimates, and gradient steps on F_a, in turns."""

    WHERE: ClassVar[str] = "alternation"

    latent: Annotated[int, Field(ge=0, le=100)] = key(1, "size of z_a")
    steps: Count = key(
        400, "number of gradient steps; before each, the estimates for its windows are improved by one step"
    )
    batch_size: Count = key(100, "windows per seed in each step")
    learning_rate: Positive = key(3.0e-3, "learning rate of Adam, at its peak")
    warmup: Share = key(
        0.2, "share of all steps over which the learning rate rises; then it decays along a cosine to zero"
    )
    clip_norm: Positive | None = key(5.0, "largest norm of a seed's gradient; null = no clipping")
    penalty: NotNegative = key(
        30.0,
        "weight of the mean of (F_a / the expert's root mean square rate)² relative to the mean squared residual in "
        "units of the noise",
    )
    share: NotNegative = key(
        300.0,
        "weight of the same mean for the part of F_a that a different z_e would produce as well and that therefore "
        "belongs to the expert; use 0 where the true F_a resembles that part",
    )
    threshold: Positive = key(
        5.0, "residuals far beyond this many standard deviations of the noise hardly count (Cauchy loss)"
    )
    teacher_forcing: TeacherForcing | None = key(
        None,
        "first steps of F_a, from each measured point to the next, where the expert alone leads far from the data; "
        "null = none",
    )
    train_samples: Count | None = key(None, "maximum number of training windows, spread evenly; null = all")
    validate_every: Count = key(50, "number of steps from one validation to the next")
    validation_samples: Count | None = key(100, "maximum number of validation samples, spread evenly; null = all")
    checkpoint_s: NotNegative = key(30.0, "shortest time between two checkpoints", "s")
    horizon_s: Positive = key(
        LEFT_OUT, "end of the part of a training trajectory that is fitted; left out = data.t1_s", "s"
    )
    solver: SolverSettings = key(LEFT_OUT, "solver for the differential equation in training; left out = its defaults")


Alternating.training = AlternatingSettings


class AlternateOptions(DataOptions):
    """How a model without an encoder is trained, in memory too."""

    OBEYS = ("observed_points",)

    training: AlternatingSettings = key(..., "how it is trained")
    refinement: Refinement = key(..., "how windows are fitted")


class AlternateJob(AlternateOptions, RecipeKeys):
    """A training by alternation."""

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if self.model.interaction is None:
            raise disagree("missing", "the training is of an interaction model", "model.interaction")
        return self


class FlowTrainingOptions(LabelledJob):
    """How a flow is trained, in memory too."""

    OBEYS = ("augmentation_noise", "augmented_x", "augmented_z_a")

    flow: FlowSettings = key(..., "how it is trained and used")
    prior: Prior = key(..., "p⁺; own = --prior has it")
    noise: Noise = key(..., "standard deviation of the data's noise")


class FlowJob(FlowTrainingOptions, ModelFileJob):
    """The training of a flow."""

    worst: Literal[0.0] = key(0.0, "a flow's draws are all uniform")


class OwnPriorJob(Settings):
    """A search for the ranges of p⁺, with a trained model."""

    WHERE: ClassVar[str] = "--settings"

    windows: list[str] = key(..., "sets whose observed windows p⁺ is to cover; none = ranges widen to the budget")
    budget: Annotated[float, Field(gt=1)] = key(..., "without windows: the largest factor by which ranges are widened")
    noise: Noise = key(..., "standard deviation of the data's noise")
    refinement: RefinementSettings = key(..., "how windows are fitted")
    device: Device = key("cpu", "where to compute")
    classes: list[str] = key(LEFT_OUT, "classes from elsewhere that the model file may name")


class FirstPriorJob(OwnPriorJob, LabelledJob, RecipeKeys, WindowKeys):
    """The same before anything is trained, with the expert alone."""

    OBEYS = ("observed_points",)

    training: SolverOnly = key(SolverOnly, "its solver")

    @property
    def expert(self) -> UntrainedOptions:
        """What the expert alone is made with."""
        of_expert = {name: getattr(self, name) for name in UntrainedOptions.model_fields if name != "refinement"}
        return UntrainedOptions.of(**of_expert, refinement=None)

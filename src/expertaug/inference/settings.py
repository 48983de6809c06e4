"""Settings of inference; torch is not loaded here."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import Field

from expertaug.learning.settings import TrainSettings
from expertaug.models.settings import AXES, Hidden, Width
from expertaug.settings import LEFT_OUT, Count, NotNegative, Positive, Range, Settings, Share, key
from expertaug.systems.settings import SolverSettings

SCORES = 25  # of the draws held out in a training of a flow, at most


class RefinementSettings(Settings):
    """Least squares on each observed window: of the expert alone, or from a trained model's estimates."""

    WHERE: ClassVar[str] = "refinement"

    starts: Annotated[int, Field(ge=0, le=100_000)] = key(
        32,
        "number of points of p⁺ at which each window is compared with the model; 0 = only from the trained model's "
        "estimate",
    )
    tries: Count = key(
        3,
        "how many of these points, the best ones, the fit starts from in addition to the trained model's own estimate",
    )
    sufficient: Annotated[float, Field(ge=0, lt=1)] = key(
        0.99,
        "a window is fitted from further starts only where χ² after the first fit, that from the trained model's "
        "estimate or else from the best point, is above this quantile of its distribution; 0 = in any case",
    )
    agreement: Share = key(
        0.01,
        "no further start is tried once one has led to a χ² within this share of the lowest before it: two that arrive "
        "at the same minimum; 0 = all are tried until χ² is sufficient",
    )
    steps: Count = key(30, "maximum number of Levenberg–Marquardt steps")
    noise: Positive = key(
        LEFT_OUT,
        "standard deviation of the observation noise; left out = that of the data, or, where they have none, a "
        "thousandth of the training set's largest value",
    )
    free_start: bool = key(
        LEFT_OUT, "whether the first point is estimated too; left out = only where the data have noise"
    )
    latent_width: Positive = key(
        3.0,
        "how far z_a may move from its mean over the training windows, in its standard deviations over them: a weak "
        "Gaussian prior",
    )
    latent: Annotated[int, Field(ge=1, le=AXES)] = key(
        10,
        "maximum number of components of an encoder's z_a that are fitted; of a longer z_a its first principal "
        "components over the training windows are, and the others stay at their mean",
    )
    windows: dict[str, Range] = key(
        LEFT_OUT, "first and last time at which each component counts, in s; left out = the whole observed window"
    )
    solver: SolverSettings = key(LEFT_OUT, "solver for the fit; left out = that of training")


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
        "32 agrees with the mean over all to within .02 of a log-MSE",
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
    train_samples: Count | None = key(None, "maximum number of training windows, spread evenly; null = all")
    validate_every: Count = key(50, "number of steps from one validation to the next")
    validation_samples: Count | None = key(100, "maximum number of validation samples, spread evenly; null = all")
    checkpoint_s: NotNegative = key(30.0, "shortest time between two checkpoints", "s")
    horizon_s: Positive = key(
        LEFT_OUT, "end of the part of a training trajectory that is fitted; left out = data.t1_s", "s"
    )
    solver: SolverSettings = key(LEFT_OUT, "solver for the differential equation in training; left out = its defaults")

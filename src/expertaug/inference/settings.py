"""Settings of inference; torch is not loaded here."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import Field

from expertaug.learning.settings import TrainSettings
from expertaug.models.settings import Hidden, Width
from expertaug.settings import LEFT_OUT, Count, NotNegative, Positive, Range, Settings, Share, key
from expertaug.systems.settings import SolverSettings

SCORES = 25  # of the draws held out in a training of a flow, at most


class RefinementSettings(Settings):
    """Least squares on each observed window: of the expert alone, or from a trained model's estimates."""

    WHERE: ClassVar[str] = "refinement"

    starts: Annotated[int, Field(ge=0, le=100_000)] = key(
        32, "points of p⁺ at which a window is compared with the model; 0 = only from the trained model's estimate"
    )
    tries: Count = key(3, "the best of them from which the fit starts, beside the trained model's own estimate")
    steps: Count = key(30, "Levenberg–Marquardt steps, at most")
    noise: Positive = key(
        LEFT_OUT,
        "standard deviation of the observation; left out = the data's, and where they have none a thousandth of the "
        "training set's largest value",
    )
    free_start: bool = key(LEFT_OUT, "whether the first point is estimated too; left out = where the data have noise")
    latent_width: Positive = key(
        3.0, "how far z_a may go from the training windows' mean, in their standard deviations: a weak Gaussian prior"
    )
    windows: dict[str, Range] = key(
        LEFT_OUT, "from when to when each component counts, in s; left out = all of the observed window"
    )
    solver: SolverSettings = key(LEFT_OUT, "of the fit; left out = the training's")


class FlowSettings(Settings):
    """How a flow learns the posterior from draws of a trained model, and how it is used."""

    WHERE: ClassVar[str] = "flow"

    steps: Count = key(8000, "of the training")
    batch_size: Count = key(256, "draws of each seed in a step")
    learning_rate: Positive = key(4.0e-3, "of Adam, at the peak of a linear warm-up and a cosine to zero")
    warmup: Share = key(0.1, "share of all steps over which the learning rate warms up")
    clip_norm: Positive | None = key(1.0, "largest norm of a seed's gradient; null = not clipped")
    pool: Count = key(4096, "draws of each seed that are at hand at a time")
    uses: Count = key(1, "steps in which each draw is used; 1 = fresh draws in every step, more where they are dear")
    held_out: Count = key(2000, "further draws of each seed, whose loss selects the best state")
    layers: Hidden = key((256, 256), "widths of the network on the observed window")
    summary: Width = key(64, "numbers that this network gives the flow")
    transforms: Annotated[int, Field(ge=1, le=100)] = key(2, "splines, each autoregressive over the parameters")
    hidden: Hidden = key((64, 64), "widths of the hidden layers that set a spline")
    bins: Annotated[int, Field(ge=2, le=1000)] = key(8, "of a spline")
    latent: Count = key(8, "principal components of z_a that are inferred, at most; the others stay at their mean")
    jitter: NotNegative = key(
        0.1,
        "width of the kernel that smooths the training windows' z_a and first points, in their standard deviations",
        le=1,
    )
    resample_x: bool = key(
        LEFT_OUT,
        "whether draws begin anywhere, as far as the system says where (the double pendulum's angles: on the whole "
        "circle), not where training windows do; else windows that begin elsewhere are read wrongly; left out = as "
        "augmented_x says",
    )
    margin: Positive = key(0.02, "by which p⁺ is widened at both ends where the flow has its bounds, in its widths")
    samples: Count = key(
        119,
        "draws of the posterior in an estimate; 119 make exact 50 % and 90 % intervals",
    )
    forecasts: Count = key(
        32,
        "how many of these are forecast, the mean being the forecast: they are spread evenly, and 32 have the mean of "
        "all to .02 of a log-MSE",
    )
    checkpoint_s: NotNegative = key(30.0, "least time between two checkpoints", "s")
    solver: SolverSettings = key(LEFT_OUT, "of the draws; left out = that of the model's forecasts")

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

    samples: Count = key(60, "windows of each set that are fitted, at most, evenly spread")
    steps: Count = key(40, "gradient steps on F_a, from what it is")
    learning_rate: Positive = key(1.0e-3, "of Adam")


class AlternatingSettings(Settings):
    """A training of F_a without an encoder: each window's own estimates, and gradient steps on F_a, in turns."""

    WHERE: ClassVar[str] = "alternation"

    latent: Annotated[int, Field(ge=0, le=100)] = key(1, "size of z_a")
    steps: Count = key(400, "gradient steps, before each of which its windows' estimates are improved by one step")
    batch_size: Count = key(100, "windows of each seed in a step")
    learning_rate: Positive = key(3.0e-3, "of Adam, at its peak")
    warmup: Share = key(0.2, "share of all steps over which the rate rises; then a cosine to zero")
    clip_norm: Positive | None = key(5.0, "largest norm of a seed's gradient; null = not clipped")
    penalty: NotNegative = key(
        30.0,
        "weight of the mean of (F_a / the expert's root mean square rate)² beside the mean squared residual in units "
        "of the noise",
    )
    share: NotNegative = key(
        300.0,
        "weight of the same for the part of F_a that another z_e would give as well, which belongs to the expert; 0 "
        "where the true F_a resembles it",
    )
    threshold: Positive = key(
        5.0, "residuals far beyond so many standard deviations of the noise hardly count (Cauchy's loss)"
    )
    train_samples: Count | None = key(None, "training windows, at most, evenly spread; null = all")
    validate_every: Count = key(50, "steps from one validation to the next")
    validation_samples: Count | None = key(100, "validation samples, at most, evenly spread; null = all")
    checkpoint_s: NotNegative = key(30.0, "least time between two checkpoints", "s")
    horizon_s: Positive = key(
        LEFT_OUT, "end of the part of a training trajectory that is fitted; left out = data.t1_s", "s"
    )
    solver: SolverSettings = key(LEFT_OUT, "of the differential equation in training; left out = its defaults")

"""Settings of training and options of the package's own objectives; torch is not loaded here."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from expertaug.settings import LEFT_OUT, LIST, ONE, Count, NotNegative, Positive, Settings, Share, by_shape, key
from expertaug.systems.settings import SolverSettings


class ObjectiveSettings(Settings):
    """Options of an objective.

    Attributes:
        NEEDS: what the package gives it besides seeds and choices.
    """

    WHERE: ClassVar[str] = "objective"
    NEEDS: ClassVar[tuple[str, ...]] = ()


class AphynitySettings(ObjectiveSettings):
    """APHYNITY: the data term with a Lagrange multiplier, and the size of F_a."""

    lambda0: Annotated[
        Annotated[NotNegative, ONE] | Annotated[Annotated[tuple[NotNegative, ...], Field(strict=False)], LIST], by_shape
    ] = key(10.0, "initial multiplier of the data term; one value, or one for each seed")
    tau2: NotNegative = key(5.0, "the multiplier is raised by this times the data term")
    every: Count = key(1, "number of passes from one raise of the multiplier to the next")


class HvaeSettings(ObjectiveSettings):
    """The hybrid-VAE's evidence lower bound and its regularisers."""

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


def one_cycle(step: int, steps: int, warmup: float) -> float:
    """Share of the peak's learning rate in step ``step`` of ``steps``: a linear warm-up, then a cosine to zero."""
    warm = max(warmup * steps, 1)
    if step < warm:
        return (step + 1) / warm
    return 0.5 * (1 + math.cos(math.pi * (step - warm) / max(steps - warm, 1)))

"""The studies of an experiment as typed models: further questions to its models."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

from pydantic import Field

from expertaug.settings import LEFT_OUT, Count, Settings, key

SomeNames = Annotated[list[str], Field(min_length=1)]


class OutOfExpertise(Settings):
    """Log-MSE on sets whose interaction parameters are shifted as well."""

    distances: Annotated[list[Annotated[str, Field(min_length=1)]], Field(min_length=1)] = key(
        ..., "names of the distances, in order"
    )
    panels: Annotated[dict[str, SomeNames], Field(min_length=1)] = key(
        ..., "title of each panel, and its sets in the order of the distances"
    )
    overview: str | None = key(None, "set that the figure over all experiments (za_shifted) shows; null = none")


class DuringTraining(Settings):
    """Augmentation and fine-tuning of the model at several stages of its training."""

    method: str = key(..., "method whose training is followed")
    epochs: Annotated[list[Count], Field(min_length=1)] = key(
        ..., "passes of the training after which its state is kept"
    )
    finetune_epochs: Annotated[list[Count], Field(min_length=1)] = key(
        lambda: [1, 10], "lengths of the fine-tunings of each kept state, in passes"
    )
    max_samples: Count | None = key(1000, "samples of each set that are evaluated, at most, evenly spread; null = all")


class Grid(Settings):
    """A sweep: one training for every combination of some keys' values, on the same data."""

    method: str = key(..., "hybrid method that is trained")
    keys: dict[str, Annotated[list[Any], Field(min_length=1)]] = key(
        ..., "values by dotted key of the experiment, below model, training, system or choices", min_length=1
    )


class Studies(Settings):
    """Further questions to the experiment's models, each with a table and a figure of its own."""

    RENAMED: ClassVar = {"along": "it is called during_training now"}

    during_training: DuringTraining | None = key(
        LEFT_OUT,
        "augmentation and fine-tuning of the model at several stages of its training; null takes an inherited one away",
    )
    grid: Grid | None = key(
        LEFT_OUT,
        "one training for every combination of some keys' values, on the same data, compared by the score on the "
        "validation set; null takes an inherited one away",
    )
    out_of_expertise: OutOfExpertise | None = key(
        LEFT_OUT, "log-MSE on sets whose interaction parameters are shifted as well; null takes an inherited one away"
    )

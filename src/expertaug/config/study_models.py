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
        ..., "the panels by title, each with its sets in the order of the distances"
    )
    overview: str | None = key(None, "set shown in the figure over all experiments (za_shifted); null = none")


class DuringTraining(Settings):
    """Augmentation and fine-tuning of the model at several stages of its training."""

    method: str = key(..., "the method that is followed through its training")
    epochs: Annotated[list[Count], Field(min_length=1)] = key(
        ..., "numbers of training passes after which the model's state is kept"
    )
    finetune_epochs: Annotated[list[Count], Field(min_length=1)] = key(
        lambda: [1, 10], "lengths of the fine-tuning runs from each kept state, in passes"
    )
    max_samples: Count | None = key(1000, "maximum number of samples evaluated in each set, spread evenly; null = all")


class Grid(Settings):
    """A sweep: one training for every combination of some keys' values, on the same data."""

    method: str = key(..., "the hybrid method that is trained")
    keys: dict[str, Annotated[list[Any], Field(min_length=1)]] = key(
        ..., "values to try, by dotted key of the experiment, below model, training, system or choices", min_length=1
    )


class Studies(Settings):
    """Further questions to the experiment's models, each with a table and a figure of its own."""

    RENAMED: ClassVar = {"along": "it is called during_training now"}

    during_training: DuringTraining | None = key(
        LEFT_OUT,
        "augmentation and fine-tuning of the model at several stages of its training; null removes an inherited study",
    )
    grid: Grid | None = key(
        LEFT_OUT,
        "one training run for every combination of the values of some keys, on the same data, compared by the score "
        "on the validation set; null removes an inherited study",
    )
    out_of_expertise: OutOfExpertise | None = key(
        LEFT_OUT,
        "log-MSE on sets in which the interaction parameters are shifted as well; null removes an inherited study",
    )

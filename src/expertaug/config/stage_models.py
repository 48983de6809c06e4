"""Typed settings of stages whose packages do not hold them beside the function that takes them."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from expertaug.config.models import Evaluation
from expertaug.evaluation.settings import Reading
from expertaug.inference.settings import ValiditySettings
from expertaug.learning.settings import AugmentJob, FinetuneJob
from expertaug.models.settings import Refinement
from expertaug.settings import LEFT_OUT, Noise, Seeds, Settings, key


class StageSettings(Settings):
    """Of a stage whose function takes a mapping: checked before it is called."""


class OfSeeds(StageSettings):
    """A method of an experiment and a group of its seeds."""

    experiment: str = key(..., "name of the experiment")
    method: str = key(..., "name of the method's version")
    choices: dict[str, str] = key(..., "rows of the preset's table that the stage obeys")
    seeds: Seeds = key(..., "of the group")
    device: Literal["auto", "cpu", "cuda"] = key(..., "where to compute")


class Labelled(OfSeeds):
    """The same with what logs and tables call it."""

    label: str = key(..., "what tables print")
    preset: str = key(..., "name of the preset")


class Evaluate(Labelled):
    """An evaluation."""

    classes: list[str] = key(LEFT_OUT, "classes from elsewhere that the model file may name")
    evaluation: Evaluation = key(..., "what is computed")
    refinement: Refinement = key(LEFT_OUT, "least squares on each window, where the estimates come from it")
    sets: list[str] = key(..., "names of the sets")
    noise: Noise = key(LEFT_OUT, "standard deviation of the data's noise; left out = none")
    own: dict[str, Any] = key(LEFT_OUT, "prior, resample_x and z_a_from of windows of the model's own making")


class Follow(Labelled):
    """A study during training."""

    augment: AugmentJob = key(..., "settings of augment")
    finetune: FinetuneJob = key(..., "settings of finetune")
    finetune_epochs: list[int] = key(..., "lengths of the fine-tunings")
    evaluation: dict[str, Any] = key(..., "what is computed")


class OfModels(StageSettings, Reading):
    """What is asked of trained models."""

    experiment: str = key(..., "name of the experiment")
    versions: list[Annotated[list[Any], Field(min_length=3, max_length=3)]] = key(
        ..., "version, label and fit of each: settings, noise and prior of least squares, or null"
    )
    all_methods: list[str] = key(..., "of the configuration, which fix the colours")
    device: Literal["auto", "cpu", "cuda"] = key(..., "where to compute")
    classes: list[str] = key(LEFT_OUT, "classes from elsewhere that the model files may name")


class Dissipation(OfModels):
    """The comparison of dissipated power and loss of energy."""


class Validity(OfModels):
    """The check whether F_a holds where z_e has moved."""

    validity: ValiditySettings = key(..., "how it is checked")

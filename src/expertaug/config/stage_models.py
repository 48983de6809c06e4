"""What each stage's ``settings`` must hold, for settings that somebody wrote by hand.

The workflow's own come from :mod:`expertaug.config.stage_settings`.  Stages that are not here check theirs themselves.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field

from expertaug.config.models import Evaluation
from expertaug.errors import InputErrors
from expertaug.learning.settings import AugmentJob, FinetuneJob
from expertaug.models.settings import Refinement
from expertaug.settings import LEFT_OUT, Noise, NotNegative, Range, Seeds, Settings, check, key
from expertaug.systems.settings import SimulateJob
from expertaug.tracking.settings import InitTrackingJob

WHERE = "--settings"
Labels = list[Annotated[list[str], Field(min_length=2, max_length=2)]]


class StageSettings(Settings):
    """Of a stage; what else it may be given is its own to know."""

    model_config = ConfigDict(extra="ignore")


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


class Reading(StageSettings):
    """How metrics are to be read."""

    from_s: NotNegative | None = key(..., "first time that the metric sees; null = after the observed window", "s")
    convention: Literal["sum", "dim"] = key(..., "which log-MSE is shown")
    set_titles: dict[str, str] = key(..., "how the sets are called")
    title: str | None = key(..., "how the experiment is called; null = its name")


class Tabulate(Reading):
    """The tables of an experiment."""

    labels: Labels = key(..., "version and label of each method, in order")
    floors: list[str] = key(..., "versions of the true equation")
    known_form: list[str] = key(..., "versions whose F_a is of known form")


class Plot(Reading):
    """The figures of an experiment."""

    labels: Labels = key(..., "version and label of each method, in order")
    all_methods: list[str] = key(..., "of the configuration, which fix the colours")
    traced: list[str] = key(..., "versions that figures of lines and points show")
    floor: str | None = key(..., "version of the true equation, where there is one")
    measured: bool = key(..., "whether the states were measured, not simulated")
    training_range: dict[str, Range] = key(..., "of the expert parameters")
    priors: dict[str, dict[str, Range]] = key(..., "p⁺ of each method")


class Study(Reading):
    """The table and the figure of a study."""

    study: str = key(..., "name of the study")
    labels: Labels = key(..., "version and label of each method, in order")
    all_methods: list[str] = key(..., "of the configuration, which fix the colours")
    sets: dict[str, Any] = key(..., "the simulated sets; of measurements none")
    classical: str | None = key(..., "least squares with the expert, where there is one")
    options: dict[str, Any] = key(LEFT_OUT, "of the study")


class Compare(StageSettings):
    """A comparison with published numbers."""

    published: list[list[str | None]] = key(..., "experiment and system of the published numbers; null = none")


class Overview(StageSettings):
    """The figures over several experiments."""

    experiments: list[dict[str, Any]] = key(..., "what is shown of each")
    all_methods: list[str] = key(..., "of the configuration, which fix the colours")


STAGES: Mapping[str, type[Settings]] = {
    "init-tracking": InitTrackingJob,
    "simulate": SimulateJob,
    "evaluate": Evaluate,
    "during-training": Follow,
    "tabulate": Tabulate,
    "plot": Plot,
    "study": Study,
    "compare": Compare,
    "overview": Overview,
}


def require(stage: str, settings: Mapping[str, object]) -> None:
    """Settings must hold what the stage (``train``, ``during-training``, …) needs.

    Raises:
        InputErrors: everything that is missing or cannot be used.
    """
    kind = STAGES.get(stage)
    errors = check(kind, settings, WHERE) if kind is not None else []
    if errors:
        raise InputErrors(errors)

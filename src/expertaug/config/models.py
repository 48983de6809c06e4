"""The configuration as typed models: every key with its type, default, range, unit and description.

What a class of the package takes (a system, an encoder, an interaction model, an objective) stands beside that class
(``settings.py`` of its package); :mod:`expertaug.config.options` checks it, also for classes from elsewhere.
"""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, Field, field_serializer

from expertaug import presets
from expertaug.config.data_models import Data
from expertaug.config.study_models import SomeNames, Studies
from expertaug.inference.settings import AlternatingSettings, FlowSettings, ValiditySettings
from expertaug.learning.settings import MethodKeys, TrainSettings
from expertaug.models.settings import RefinementSettings
from expertaug.settings import (
    LEFT_OUT,
    Count,
    Name,
    NotNegative,
    Range,
    Seed,
    Settings,
    Share,
    key,
    wrong,
)
from expertaug.systems.settings import SolverSettings
from expertaug.wording import PATTERNS
from expertaug_recordings.settings import RecordingKeys

Ranges = Annotated[dict[str, Range], Field(min_length=1)]
Names = list[str]


def _choices(value: dict[str, str]) -> dict[str, str]:
    found = presets.wrong_choice(value)
    if found is not None:
        raise wrong(found[1], found[2], found[0])
    return value


class TrackingKeys(Settings):
    """The MLflow store that mirrors the logs of the trainings."""

    enabled: bool = key(True, "whether to mirror the logs at all")
    uri: str | None = key(None, "URI of the store; null = sqlite:///<results>/mlflow/mlflow.db")
    experiment: str = key("expertaug", "name of the MLflow experiment")


class Method(MethodKeys):
    """A way of building and training a model."""

    RENAMED: ClassVar = {"system": "say it in the experiment: overrides: {METHOD: {system: …}}"}

    label: str = key(..., "name printed in tables and figures; augmented versions get a +", min_length=1)


class Model(Settings):
    """Of the methods of kind hybrid."""

    encoder: dict[str, Any] = key(..., "kind (a name, or package.module:Class) and the arguments of its class")
    interaction: dict[str, Any] = key(..., "kind (a name, or package.module:Class) and the arguments of its class")


class Augmentation(Settings):
    """How augmented samples are drawn."""

    prior: Ranges | None = key(
        None,
        "p⁺(z_e), uniform over a range for each expert parameter, in its unit; null = p⁺ finds its own ranges, which "
        "grow from those of the training windows' estimates",
    )
    windows: Names = key(
        list,
        "for a p⁺ that finds its own ranges: the sets that it should cover, of which only the observed windows are "
        "used; none = the ranges are widened until the budget is reached",
    )
    budget: Annotated[float, Field(gt=1)] = key(
        2.0, "for a p⁺ that finds its own ranges without windows: the largest factor by which they are widened"
    )
    worst: Share = key(
        0.0, "share of the augmented samples that are drawn where the trained model's own estimates are bad; 0 = none"
    )


class FurtherPrior(Augmentation):
    """A further prior, which makes a version METHOD+NAME of augmented methods from the same trained model."""

    methods: SomeNames = key(LEFT_OUT, "methods that get this version; left out = all under augmented")


class Evaluation(Settings):
    """What is measured and kept of each set."""

    samples: Count = key(3, "number of forecasts of validation, iid and test that are kept for figures")
    published: str | None = key(
        None,
        "system whose published numbers (src/expertaug/evaluation/paper.csv) this experiment is compared with; "
        "null = none",
    )
    overview: bool = key(True, "whether the figures over all experiments of the run show this one")
    from_s: NotNegative | None = key(None, "first time included in the metric; null = after the observed window", "s")
    convention: Literal["sum", "dim"] = key(
        "sum",
        "which log-MSE is shown in tables and figures: sum = squared errors summed over the observed dimensions, "
        "dim = averaged over them",
    )
    title: str | None = key(None, "title of the experiment in figures; null = its name")
    set_titles: dict[str, str] = key(
        dict,
        "names of the sets in tables and figures; default train, validation (set of choices), IID test, test (OOD)",
    )
    max_samples: Count | None = key(None, "maximum number of samples from each set, spread evenly; null = all")
    train_samples: Count | None = key(
        200,
        "maximum number of samples from the training set, spread evenly: no verdict rests on them; null = as for "
        "every set",
    )
    draws: Annotated[int, Field(ge=0, le=1000)] = key(
        19,
        "number of forecasts drawn for each window, for the CRPS, the energy score and the bands of every version "
        "with a distribution; 19 (or 39) give exact 50 % and 90 % bands, 0 = none",
    )
    drawn_samples: Count = key(
        200, "maximum number of windows of each set for which forecasts are drawn, spread evenly"
    )
    expected_draws: Annotated[int, Field(ge=0, le=1000)] = key(
        8,
        "number of forecasts drawn for every window, whose distance from the forecast is the squared error to be "
        "expected, a score of alarms; at most as many as `draws`",
    )
    solver: SolverSettings = key(
        LEFT_OUT,
        "solver for the forecasts; left out = dopri5 with tolerances of 1.0e-6, or rk4 with 10 substeps where there "
        "are events",
    )
    draws_solver: SolverSettings = key(
        LEFT_OUT, "solver for the drawn forecasts, of which there are `draws` times as many; left out = `solver`"
    )


class Override(Settings):
    """What one method of an experiment has otherwise."""

    system: dict[str, Any] = key(LEFT_OUT, "as the experiment's system")
    model: dict[str, Any] = key(LEFT_OUT, "as the experiment's model")
    training: TrainSettings = key(LEFT_OUT, "as the experiment's training")
    augmentation: Augmentation = key(LEFT_OUT, "as the experiment's augmentation")
    finetuning: TrainSettings = key(LEFT_OUT, "as the experiment's finetuning")
    refinement: RefinementSettings = key(LEFT_OUT, "as the experiment's refinement")
    flow: FlowSettings = key(LEFT_OUT, "as the experiment's flow")
    alternation: AlternatingSettings = key(LEFT_OUT, "as the experiment's alternation")


class Experiment(Settings):
    """An experiment: a system, its data, a model, how it is trained, and by which methods."""

    based_on: str = key(LEFT_OUT, "name of an experiment from which keys are inherited")
    seeds: Annotated[list[Seed], Field(min_length=1)] = key(
        LEFT_OUT, "seeds of this experiment's training runs; left out = those of the top level"
    )
    choices: Annotated[dict[str, str], AfterValidator(_choices)] = key(
        dict, "rows of the preset's table (expertaug/presets.py) in which this experiment differs"
    )
    presets: Presets = key(LEFT_OUT, "keys that this experiment overrides under a preset")
    overrides: dict[str, Override] = key(dict, "keys that differ for one method of this experiment")
    system: dict[str, Any] = key(
        ..., "name (a module of expertaug.systems, or a dotted path) and the arguments of its class"
    )
    data: Data = key(..., "where the trajectories come from")
    model: Model = key(..., "model of the methods of kind hybrid; those of kind alternating use its interaction alone")
    training: TrainSettings = key(..., "how a model is trained")
    augmentation: Augmentation = key(Augmentation, "how augmented samples are drawn")
    augmentations: dict[Name, FurtherPrior | None] = key(
        dict,
        "further priors by name, which show how the gain depends on the width of p⁺; each makes a version METHOD+NAME "
        "of every augmented method from the same trained model; null removes an inherited prior",
    )
    studies: Studies = key(
        Studies, "further questions about the experiment's models, each with its own table and figure"
    )
    finetuning: TrainSettings = key(LEFT_OUT, "how a model is fine-tuned")
    evaluation: Evaluation = key(Evaluation, "what is measured and kept for each set")
    methods: SomeNames = key(..., "names of the methods to train")
    augmented: Names = key(list, "which of the methods are also fine-tuned on augmented data")
    controls: Names = key(
        list,
        "which of the methods are also trained further on the real data alone, for as many steps as a fine-tuning has "
        "(METHOD=), as controls for the augmented versions; methods that the experiment does not train are ignored",
    )
    refined: Names = key(
        list,
        "for which versions (METHOD, METHOD=, METHOD+ …) the estimates are refined on each window by least squares "
        "(VERSION~refined); versions that the experiment does not make are ignored",
    )
    refinement: RefinementSettings = key(
        RefinementSettings,
        "least squares on each window, for methods of kind least_squares and alternating and for refined versions",
    )
    flows: Names = key(
        list,
        "for which of the methods a flow learns the posterior under p⁺ (METHOD+~flow); methods that the experiment "
        "does not train are ignored",
    )
    flow: FlowSettings = key(FlowSettings, "how a flow learns the posterior from draws of a trained model")
    alternation: AlternatingSettings = key(AlternatingSettings, "how methods of kind alternating are trained")
    validity: ValiditySettings | None = key(
        ValiditySettings,
        "the check whether F_a still holds where z_e has moved, for every trained interaction model; null = no such "
        "check",
    )

    @field_serializer("overrides")
    def _only_what_is_given(self, overrides: dict[str, Override]) -> dict[str, object]:
        return {name: one.model_dump(mode="json", exclude_unset=True) for name, one in overrides.items()}


class Presets(Settings):
    """What an experiment overrides of itself under each preset; its choices are defaults like the preset's own."""

    paper: Experiment = key(LEFT_OUT, "keys of the experiment")
    code: Experiment = key(LEFT_OUT, "keys of the experiment")
    corrected: Experiment = key(LEFT_OUT, "keys of the experiment")


class Common(Settings):
    """All of a configuration but its experiments."""

    RENAMED: ClassVar = {"choices": "say it in the experiments: experiments: {NAME: {choices: …}}"}

    preset: Literal["paper", "code", "corrected"] = key(
        "corrected",
        "which choices to take where the paper and the authors' code disagree (expertaug/presets.py lists them)",
    )
    results: str = key("results", "folder for everything that is generated", pattern=PATTERNS["folder"])
    overwrite: bool = key(
        False, "whether a run may take over a results folder that holds the tables of other configuration files"
    )
    device: Literal["auto", "cpu", "cuda"] = key("auto", "where to train and evaluate; auto uses a GPU if there is one")
    seeds: Annotated[list[Seed], Field(min_length=1)] = key(
        lambda: [0, 1, 2], "seeds of the training runs, one model each"
    )
    seeds_per_job: Count = key(3, "number of seeds that one job trains together")
    tracking: TrackingKeys = key(TrackingKeys, "the MLflow store that mirrors the training logs")
    recordings: RecordingKeys = key(RecordingKeys, "recordings of a double pendulum, from their source to angles")
    methods: Annotated[dict[Name, Method], Field(min_length=1)] = key(
        ..., "ways of building and training a model, by name"
    )
    run: SomeNames = key(..., "names of the experiments of this run")


class Configuration(Common):
    """Every key with its type, unit, default and limits."""

    experiments: Annotated[dict[Name, Experiment], Field(min_length=1)] = key(
        ..., "experiments by name; based_on inherits the keys of another one, which can then be overridden"
    )


Experiment.model_rebuild()
assert set(presets.NAMES) == set(Presets.model_fields)

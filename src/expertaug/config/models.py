"""The configuration as typed models: every key with its type, default, range, unit and description.

What a class of the package takes (a system, an encoder, an interaction model, an objective) stands beside that class
(``settings.py`` of its package); :mod:`expertaug.config.options` checks it, also for classes from elsewhere.
"""

import itertools
import math
from collections.abc import Iterator
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, Field, field_serializer
from pydantic_core import PydanticCustomError

from expertaug.config.layers import overridden
from expertaug.equation.settings import EquationSettings
from expertaug.evaluation.settings import Scoring
from expertaug.inference.settings import AlternatingSettings, FlowSettings, ValiditySettings
from expertaug.learning.settings import Build, MethodKeys, TrainSettings
from expertaug.measurements.settings import MeasurementSettings
from expertaug.models.fit_settings import RefinementSettings
from expertaug.presets import NAMES, Choices, Preset
from expertaug.settings import (
    LEFT_OUT,
    Count,
    EachOnce,
    Name,
    Noise,
    Positive,
    Range,
    Seed,
    Settings,
    Share,
    agreement,
    disagree,
    key,
)
from expertaug.systems.settings import SimulatedSet
from expertaug.versions import MAIN_SETS
from expertaug.wording import PATTERNS, is_multiple, other_parameters, show
from expertaug_recordings.settings import CalibrationKeys, ChunkKeys, RecordingKeys

Ranges = Annotated[dict[str, Range], Field(min_length=1)]
Names = list[str]
SomeNames = Annotated[list[str], Field(min_length=1)]


class TrackingKeys(Settings):
    """The MLflow store that mirrors the logs of the trainings."""

    enabled: bool = key(True, "whether to mirror the logs at all")
    uri: str | None = key(None, "URI of the store; null = sqlite:///<results>/mlflow/mlflow.db")
    experiment: str = key("expertaug", "what names of MLflow experiments begin with; each experiment has its own")


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


class Evaluation(Scoring):
    """What is measured and kept of each set, and how tables and figures show it."""

    published: str | None = key(
        None,
        "system whose published numbers (src/expertaug/evaluation/paper.csv) this experiment is compared with; "
        "null = none",
    )
    overview: bool = key(True, "whether the figures over all experiments of the run show this one")
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


class Data(Settings):
    """Where the trajectories come from."""

    source: Literal["simulation", "recordings", "files"] = key(
        ...,
        "simulation = the system's own simulation; recordings = chunks of the recordings; files = your own "
        "measurements",
    )
    t1_s: Positive = key(..., "end of the observed window", "s")
    noise: Noise = key(
        0.0,
        "standard deviation of the noise on every value of the state in simulated sets and augmented samples; a "
        "mapping gives one for each component, but simulated sets take one number only; estimated = from the "
        "roughness of the files' columns",
    )
    seed: Annotated[int, Field(ge=0, lt=2**31)] = key(0, "seed of the simulation")
    step_s: Positive = key(LEFT_OUT, "time between consecutive points of simulated sets", "s")
    t2_s: Positive = key(LEFT_OUT, "end of a simulated trajectory", "s")
    sets: dict[Name, SimulatedSet | None] = key(
        LEFT_OUT,
        "the simulated sets: train, validation, test; iid, with the ranges of validation, is an IID test set; null "
        "removes an inherited set",
    )
    split: ChunkKeys = key(LEFT_OUT, "chunks of the recordings and their division into sets")
    files: MeasurementSettings = key(LEFT_OUT, "your own measurements: tables, the chunks cut from them and their sets")
    start: dict[str, Range] = key(
        dict,
        "for components that are always or sometimes missing from the files: the range, in the component's unit, in "
        "which the first point of a chunk is inferred; left out = a range that goes slightly beyond the measured "
        "values",
    )
    calibrate: bool = key(False, "whether the expert's constants are fitted on the training chunks")
    calibration: CalibrationKeys = key(CalibrationKeys, "how the constants of the compound expert are fitted")

    @agreement
    def _of_its_source(self) -> Iterator[PydanticCustomError]:
        if self.source == "simulation":
            yield from self._of_simulations()
        elif self.source == "files":
            yield from self._of_files()
        elif self.split is None:
            remedy = "give split (chunks of the recordings and their division into sets)"
            yield disagree("missing", remedy, "split")

    def _of_simulations(self) -> Iterator[PydanticCustomError]:
        needed = {
            "step_s": "time from point to point in s",
            "t2_s": "end of a trajectory in s",
            "sets": "the simulated sets",
        }
        missing = [key for key in needed if getattr(self, key) is None]
        yield from (disagree("missing", f"give {key} ({needed[key]})", key) for key in missing)
        sets = self.simulated
        lacking = [name for name in MAIN_SETS if name not in sets] if self.sets is not None else []
        yield from (disagree("missing", f"give {name}", f"sets.{name}") for name in lacking)
        if missing or lacking:
            return
        if self.t1_s >= self.t2_s:
            yield disagree(f"found {self.t1_s:g}, t2_s is {self.t2_s:g}", "t1_s must be less than t2_s", "t1_s")
        for name, end in (("t1_s", self.t1_s), ("t2_s", self.t2_s)):
            if not is_multiple(end, self.step_s):
                yield disagree(f"found {end:g}", f"give a multiple of step_s, {self.step_s:g}", name)
        if not isinstance(self.noise, int | float):
            yield disagree(f"found {show(self.noise)}", "give simulated sets one number", "noise")
        first = next(iter(sets))
        for name, simulated_set in sets.items():
            for part in ("z_e", "z_a"):
                complaint = other_parameters(
                    getattr(simulated_set, part), getattr(sets[first], part), f"the set {first}"
                )
                if complaint is not None:
                    yield disagree(*complaint, f"sets.{name}.{part}")
        if "iid" in sets and any(
            getattr(sets["iid"], part) != getattr(sets["validation"], part) for part in ("z_e", "z_a")
        ):
            remedy = "give those of validation: it is drawn alike, and nothing is chosen on it"
            yield disagree("other ranges than validation's", remedy, "sets.iid")

    def _of_files(self) -> Iterator[PydanticCustomError]:
        if self.files is None:
            remedy = "give files (paths, time and columns of your measurements, and their chunks)"
            yield disagree("missing", remedy, "files")
            return
        noisy = self.noise if isinstance(self.noise, dict) else self.files.columns
        for name in [name for name in self.files.columns if name not in noisy]:
            yield disagree("missing", "give it for every component with a column", f"noise.{name}")
        end = (self.files.length - 1) * (self.files.step_s or math.inf)
        if self.t1_s >= end + 1e-9:
            yield disagree(f"found {self.t1_s:g}", f"a chunk ends at {end:g} s", "t1_s")

    @property
    def simulated(self) -> dict[str, SimulatedSet]:
        """The simulated sets by name; none where the trajectories come from elsewhere."""
        return {name: simulated_set for name, simulated_set in (self.sets or {}).items() if simulated_set is not None}

    @property
    def set_names(self) -> list[str]:
        """Names of the sets: simulated, or cut from files or recordings, then those of long chunks."""
        return [*(self.simulated or MAIN_SETS), *self.horizons]

    @property
    def horizons(self) -> dict[str, tuple[str, float]]:
        """Sets of long chunks by name: the split that each is of, and its length in s."""
        cut = {"files": self.files, "recordings": self.split}.get(self.source)
        return cut.horizons if cut is not None else {}


class OutOfExpertise(Settings):
    """Log-MSE on sets whose interaction parameters are shifted as well."""

    distances: Annotated[list[Annotated[str, Field(min_length=1)]], Field(min_length=1)] = key(
        ..., "names of the distances, in order"
    )
    panels: Annotated[dict[str, SomeNames], Field(min_length=1)] = key(
        ..., "the panels by title, each with its sets in the order of the distances"
    )
    overview: str | None = key(None, "set shown in the figure over all experiments (za_shifted); null = none")

    @agreement
    def _one_set_a_distance(self) -> Iterator[PydanticCustomError]:
        for k, name in enumerate(self.distances):
            if name in self.distances[:k]:
                yield disagree(f"'{name}' is there twice", "name each distance once", f"distances[{k}]")
        for title, sets in self.panels.items():
            if len(sets) != len(self.distances):
                problem = f"{len(sets)} sets for {len(self.distances)} distances"
                yield disagree(problem, "give one set for each distance", f"panels.{title}")


class DuringTraining(Settings):
    """Augmentation and fine-tuning of the model at several stages of its training."""

    method: str = key(..., "the method that is followed through its training")
    epochs: Annotated[list[Count], Field(min_length=1), EachOnce] = key(
        ..., "numbers of training passes after which the model's state is kept"
    )
    finetune_epochs: Annotated[list[Count], Field(min_length=1), EachOnce] = key(
        lambda: [1, 10], "lengths of the fine-tuning runs from each kept state, in passes"
    )
    max_samples: Count | None = key(1000, "maximum number of samples evaluated in each set, spread evenly; null = all")


class Grid(Settings):
    """A sweep: one training for every combination of some keys' values, on the same data."""

    method: str = key(..., "the hybrid method that is trained")
    keys: dict[str, Annotated[list[Any], Field(min_length=1)]] = key(
        ..., "values to try, by dotted key of the experiment, below model, training, system or choices", min_length=1
    )

    @property
    def points(self) -> dict[str, dict[str, Any]]:
        """Values by dotted key of each point, by the name of the point's method."""
        combinations = itertools.product(*self.keys.values())
        return {f"{self.method}@{k}": dict(zip(self.keys, v, strict=True)) for k, v in enumerate(combinations, 1)}


class DataCurves(Settings):
    """Errors of experiments against what their data differ in."""

    samples: list[str] = key(list, "experiments that differ in the size of their training set")
    noise: list[str] = key(list, "experiments that differ in their noise")

    @property
    def axes(self) -> dict[str, list[str]]:
        """The experiments by what they differ in."""
        return {name: points for name in type(self).model_fields if (points := getattr(self, name))}

    @agreement
    def _some_points(self) -> Iterator[PydanticCustomError]:
        if not self.axes:
            yield disagree("no experiment", "name some under samples or noise")


class Studies(Settings):
    """Further questions to the experiment's models, each with a table and a figure of its own."""

    RENAMED: ClassVar = {"along": "it is called during_training now"}

    data_curves: DataCurves | None = key(
        LEFT_OUT,
        "errors of several experiments of the run against the size of their training sets, or their noise; null "
        "removes an inherited study",
    )
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

    @property
    def names(self) -> list[str]:
        """Names of the studies that there are."""
        return [name for name in type(self).model_fields if getattr(self, name) is not None]


def _named(system: dict[str, Any]) -> dict[str, Any]:
    name = system.get("name")
    if not isinstance(name, str):
        problem = "missing" if name is None else f"found {show(name)}"
        raise disagree(problem, "give name (a module of expertaug.systems, or a dotted path)", "name")
    return system


class OtherParts(Settings):
    """What one method has otherwise of the experiment's model."""

    encoder: dict[str, Any] = key(LEFT_OUT, "as the experiment's encoder")
    interaction: dict[str, Any] = key(LEFT_OUT, "as the experiment's interaction")


class Override(Settings):
    """What one method of an experiment has otherwise."""

    system: dict[str, Any] = key(LEFT_OUT, "as the experiment's system")
    model: OtherParts = key(LEFT_OUT, "as the experiment's model")
    training: TrainSettings = key(LEFT_OUT, "as the experiment's training")
    augmentation: Augmentation = key(LEFT_OUT, "as the experiment's augmentation")
    finetuning: TrainSettings = key(LEFT_OUT, "as the experiment's finetuning")
    refinement: RefinementSettings = key(LEFT_OUT, "as the experiment's refinement")
    flow: FlowSettings = key(LEFT_OUT, "as the experiment's flow")
    alternation: AlternatingSettings = key(LEFT_OUT, "as the experiment's alternation")


class PointOverride(Override):
    """What the method of a point of a grid has otherwise: the configuration of its experiment says it elsewhere."""

    choices: Choices = key(..., "as the experiment's choices")


class Experiment(Settings):
    """An experiment: a system, its data, a model, how it is trained, and by which methods."""

    based_on: str = key(LEFT_OUT, "name of an experiment from which keys are inherited")
    seeds: Annotated[list[Seed], Field(min_length=1), EachOnce] = key(
        LEFT_OUT, "seeds of this experiment's training runs; left out = those of the top level"
    )
    choices: Choices = key(
        Choices, "rows of the preset's table (expertaug/presets.py) in which this experiment differs"
    )
    presets: "Presets" = key(LEFT_OUT, "keys that this experiment overrides under a preset")
    overrides: dict[str, Override] = key(dict, "keys that differ for one method of this experiment")
    system: Annotated[dict[str, Any], AfterValidator(_named)] = key(
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
    equation: EquationSettings | None = key(
        None,
        "the search for the terms that the expert lacks: from the windows alone, and from every trained interaction "
        "model; null = no such search",
    )

    @property
    def points(self) -> list[str]:
        """Names of the methods that are the points of its grid."""
        return list(self.studies.grid.points) if self.studies.grid is not None else []

    @property
    def further_priors(self) -> dict[str, FurtherPrior]:
        """The further priors by name."""
        return {name: prior for name, prior in self.augmentations.items() if prior is not None}

    def augmentation_of(self, prior: str | None) -> Augmentation:
        """The augmentation of a further prior by its name; without one the experiment's own."""
        return self.further_priors[prior] if prior else self.augmentation

    @field_serializer("overrides")
    def _only_what_is_given(self, overrides: dict[str, Override]) -> dict[str, object]:
        return {name: override.dump() for name, override in overrides.items()}


class Presets(Settings):
    """What an experiment overrides of itself under each preset; its choices are defaults like the preset's own."""

    paper: Experiment = key(LEFT_OUT, "keys of the experiment")
    code: Experiment = key(LEFT_OUT, "keys of the experiment")
    corrected: Experiment = key(LEFT_OUT, "keys of the experiment")


class Common(Settings):
    """All of a configuration but its experiments."""

    RENAMED: ClassVar = {"choices": "say it in the experiments: experiments: {NAME: {choices: …}}"}

    preset: Preset = key(
        "corrected",
        "which choices to take where the paper and the authors' code disagree (expertaug/presets.py lists them)",
    )
    results: str = key("results", "folder for everything that is generated", pattern=PATTERNS["folder"])
    overwrite: bool = key(
        False, "whether a run may take over a results folder that holds the tables of other configuration files"
    )
    device: Literal["auto", "cpu", "cuda"] = key("auto", "where to train and evaluate; auto uses a GPU if there is one")
    seeds: Annotated[list[Seed], Field(min_length=1), EachOnce] = key(
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

    def experiment_of(self, experiment: str, method: str | None) -> Experiment:
        """An experiment with what it overrides for a method."""
        settings = self.experiments[experiment]
        over = settings.overrides.get(method) if method is not None else None
        return settings if over is None else overridden(settings, over)

    def build_of(self, experiment: str, method: str) -> Build:
        """How a method is built, with what the experiment's system is otherwise for it."""
        over = self.experiments[experiment].overrides.get(method)
        system = {} if over is None or over.system is None else {"system": over.system}
        return Build.of(**self.methods[method].dump(exclude=("label",)), **system)

    @property
    def on_recordings(self) -> list[str]:
        """Names of the run's experiments whose data are chunks of the recordings."""
        return [name for name in self.run if self.experiments[name].data.source == "recordings"]


Experiment.model_rebuild()
assert set(NAMES) == set(Presets.model_fields)

"""Typed settings of the stages that score models and that make tables and figures of scores; torch is not loaded
here."""

import re
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

from pydantic import Field

from expertaug.equation.settings import EquationSettings
from expertaug.evaluation.products import STUDIES
from expertaug.inference.settings import OwnWindows, ValiditySettings
from expertaug.learning.settings import AugmentJob, FinetuneJob, LabelledJob, ModelFileJob
from expertaug.models.fit_settings import Refinement
from expertaug.presets import Preset
from expertaug.settings import LEFT_OUT, ByName, Count, Device, Noise, NotNegative, Range, Settings, key
from expertaug.systems.settings import SolverSettings
from expertaug.versions import MAIN_SETS

Pair = Annotated[tuple[str, str], Field(strict=False)]
Hue = Annotated[tuple[str, int], Field(strict=False)]  # of a method
Ranges = dict[str, Range]
CONVENTIONS = {
    "sum": "summed over the observed dimensions",
    "dim": "averaged over the observed dimensions",
}
SET_TITLES = {
    "train": "train",
    "validation": "validation (set of choices)",
    "iid": "IID test",
    "test": "test (OOD)",
}


class ForecastScoring(Settings):
    """Which forecasts are scored, and how they are solved."""

    WHERE: ClassVar[str] = "evaluation"

    from_s: NotNegative | None = key(None, "first time included in the metric; null = after the observed window", "s")
    max_samples: Count | None = key(None, "maximum number of samples from each set, spread evenly; null = all")
    solver: SolverSettings = key(
        LEFT_OUT,
        "solver for the forecasts; left out = dopri5 with tolerances of 1.0e-6, or rk4 with 10 substeps where there "
        "are events",
    )


class Scoring(ForecastScoring):
    """What is measured and kept of each set."""

    samples: Count = key(3, "number of forecasts of validation, iid and test that are kept for figures")
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
    draws_solver: SolverSettings = key(
        LEFT_OUT, "solver for the drawn forecasts, of which there are `draws` times as many; left out = `solver`"
    )

    @classmethod
    def of_forecasts(cls, forecasts: ForecastScoring) -> "Scoring":
        """The same without any draws."""
        return cls(**{name: getattr(forecasts, name) for name in forecasts.model_fields_set}, draws=0)

    @property
    def without_draws(self) -> "Scoring":
        return self.model_copy(update={"draws": 0})


class KnownParameters(Settings):
    """Names of the parameters that sets have."""

    z_e: list[str] = key(..., "of the experiment's expert")
    z_a: list[str] = key(..., "of what it lacks, where the data were simulated")


class EvaluateJob(LabelledJob, ModelFileJob):
    """An evaluation."""

    OBEYS = ("forecast_start",)

    evaluation: Scoring = key(..., "what is computed")
    refinement: Refinement = key(LEFT_OUT, "least squares on each window, where the estimates come from it")
    sets: list[str] = key(lambda: list(MAIN_SETS), "names of the sets")
    noise: Noise = key(0.0, "standard deviation of the data's noise")
    known: KnownParameters = key(LEFT_OUT, "parameters of the sets, where the model's expert has others")
    own: OwnWindows = key(LEFT_OUT, "windows of the model's own making, on which draws are ranked and scored")


class DuringTrainingJob(LabelledJob):
    """A study during training."""

    OBEYS = ("forecast_start",)

    augment: AugmentJob = key(..., "settings of augment")
    finetune: FinetuneJob = key(..., "settings of finetune")
    finetune_epochs: list[int] = key(..., "lengths of the fine-tunings")
    evaluation: ForecastScoring = key(..., "what is computed")


class Titles(Settings):
    """How sets and an experiment are called."""

    WHERE: ClassVar[str] = "--settings"

    set_titles: dict[str, str] = key(dict, "how the sets are called")
    title: str | None = key(None, "how the experiment is called; null = its name")

    def of_set(self, name: str) -> str:
        """A set's name as it is printed."""
        return self.set_titles.get(name, SET_TITLES.get(name, re.sub(r"(?<!\bz)_", " ", name)))  # z_a_small: z_a small

    def of_experiment(self, name: str) -> str:
        """An experiment's name as figures print it."""
        return self.title or name.replace("_", " ")


class Reading(Titles):
    """How the metrics of an experiment are read; it changes none of them."""

    from_s: NotNegative | None = key(LEFT_OUT, "first time that the metric sees; null = after the observed window", "s")
    convention: Literal["sum", "dim"] = key("sum", "which log-MSE is shown")

    @property
    def convention_text(self) -> str:
        return CONVENTIONS[self.convention]


class LabelledReading(Reading):
    """The same of named versions."""

    labels: list[Pair] = key(..., "version and label of each method, in order")

    @property
    def label_of(self) -> dict[str, str]:
        """What is printed for each version, in order."""
        return dict(self.labels)

    def printed(self, version: str) -> str:
        """What is printed for a version; of one without a label its name."""
        return self.label_of.get(version, version)


class TabulateJob(LabelledReading):
    """The tables of an experiment."""

    floors: list[str] = key(list, "versions of the true equation")
    known_form: list[str] = key(list, "versions whose F_a is of known form")
    candidates: list[str] = key(list, "versions of which validation chooses one, from the simplest on")


class FigureColours(Settings):
    """Of figures, whose colours are those of a method in all of them."""

    hues: list[Hue] = key(list, "of each method, in the configuration's order")


class FigureReading(LabelledReading, FigureColours):
    """Of figures of named versions."""


class ParameterReading(FigureReading):
    """Of figures of estimated parameters."""

    training_range: Ranges = key(dict, "of the expert parameters, where it is known")
    priors: dict[str, Ranges] = key(dict, "p⁺ of each method")


class PlotJob(ParameterReading):
    """The figures of an experiment."""

    traced: list[str] = key(list, "versions that figures of lines and points show")
    floor: str | None = key(None, "version of the true equation, where there is one")
    measured: bool = key(False, "whether the states were measured, not simulated")


class SimulatedSet(Settings):
    """A simulated set, as a study prints it."""

    size: int = key(LEFT_OUT, "number of samples")
    z_e: Ranges = key(dict, "range of each expert parameter")
    z_a: Ranges = key(dict, "range of each parameter of the interaction")


class StudyOptions(Settings):
    """The configuration of a study, in the shape that it draws."""

    distances: list[str] = key(list, "what is printed for the sets of a panel")
    panels: list[Annotated[tuple[str, list[str]], Field(strict=False)]] = key(
        list, "title of each panel (of horizons: a split) and its sets"
    )
    method: str = key(LEFT_OUT, "that is followed during training")
    epochs: list[int] = key(LEFT_OUT, "at which the training is looked at")
    finetune_epochs: list[int] = key(LEFT_OUT, "lengths of the fine-tunings")
    max_samples: int | None = key(LEFT_OUT, "maximum number of samples of each set")
    methods: list[str] = key(LEFT_OUT, "that are compared")
    overview: str | None = key(LEFT_OUT, "set that the overview shows")


def _studies() -> list[str]:
    return [product.name for product in STUDIES]


class StudyJob(FigureReading):
    """The table and the figure of a study."""

    study: Annotated[str, ByName(_studies)] = key(..., "name of the study")
    sets: dict[str, SimulatedSet] = key(dict, "the simulated sets; of measurements none")
    units: dict[str, str] = key(dict, "of the parameters of z_e and z_a that have one")
    classical: str | None = key(None, "least squares with the expert, where there is one")
    options: StudyOptions = key(StudyOptions, "of the study")
    priors: dict[str, dict[str, Ranges | None]] = key(
        dict, "of the width of p⁺: ranges by method and name, '' = its own"
    )


class WindowStudyJob(FigureReading):
    """A study of single windows: alarm, coverage, seeds, distance."""

    training_range: Ranges = key(dict, "of the expert parameters, where it is known")
    interaction_range: Ranges = key(dict, "of the interaction's parameters, where it is known")
    floor: str | None = key(None, "version of the true equation, where there is one")
    mean: str | None = key(None, "version that forecasts the mean, where there is one")
    classical: str | None = key(None, "least squares with the expert, where there is one")
    traced: list[str] = key(list, "versions that figures show before others")


class EstimatesJob(FigureReading):
    """The table and the figure of an experiment's estimates."""

    priors: dict[str, Ranges] = key(dict, "p⁺ of each version, where it is given")
    starts: list[str] = key(list, "expert parameters that say how a window begins: they are no constants")


class FittedVersion(NamedTuple):
    """A version of trained models, and how its windows are fitted."""

    version: str
    label: str
    refinement: Refinement | None


class ModelsJob(FigureColours, Reading):
    """What is asked of trained models."""

    experiment: str = key(..., "name of the experiment")
    versions: list[FittedVersion] = key(
        ..., "version, label and fit of each: settings, noise and prior of least squares, or null"
    )
    device: Device = key(..., "where to compute")
    classes: list[str] = key(LEFT_OUT, "classes from elsewhere that the model files may name")


class DissipationJob(ModelsJob):
    """The comparison of dissipated power and loss of energy."""


class ValidityJob(ModelsJob):
    """The check whether F_a holds where z_e has moved."""

    validity: ValiditySettings = key(..., "how it is checked")


class EquationJob(ModelsJob):
    """The search for what the expert lacks."""

    equation: EquationSettings = key(..., "how it is sought")


class GridJob(Settings):
    """The table and the figure of a sweep over hyperparameters."""

    WHERE: ClassVar[str] = "--settings"

    experiment: str = key(..., "name of the experiment")
    label: str = key(..., "of the method")
    keys: list[str] = key(..., "dotted keys that are varied")
    points: list[Annotated[tuple[str, list[Any]], Field(strict=False)]] = key(..., "name and values of each point")


Points = Annotated[list[Annotated[tuple[float, str], Field(strict=False)]], Field(strict=False)]


class DataCurvesJob(FigureReading):
    """The table and the figure of errors against what the data of several experiments differ in."""

    experiment: str = key(..., "name of the experiment that asks")
    axes: list[Annotated[tuple[str, Points], Field(strict=False)]] = key(
        ..., "what experiments differ in (samples, noise), and by its value their names"
    )
    floor: str | None = key(None, "version of the true equation, where there is one")


class OwnPriorsJob(Reading):
    """The table of the ranges that p⁺ has found."""

    experiment: str = key(..., "name of the experiment")
    priors: list[Pair] = key(..., "what is printed for each version and its group of seeds, in the files' order")


class CompareJob(Settings):
    """A comparison with published numbers."""

    WHERE: ClassVar[str] = "--settings"

    published: list[Annotated[tuple[str, str | None], Field(strict=False)]] = key(
        ..., "experiment and system of the published numbers; null = none"
    )


class OverviewExperiment(Reading):
    """What the figures over several experiments show of one."""

    name: str = key(..., "of the experiment")
    shown: bool = key(..., "whether the figures of log-MSE and of parameters' errors show it")
    shifted: str | None = key(..., "set that the figure of shifted z_a shows; null = none")
    opponents: list[str] = key(..., "versions that are never augmented")


class OverviewJob(FigureColours):
    """The figures over several experiments."""

    WHERE: ClassVar[str] = "--settings"

    experiments: list[OverviewExperiment] = key(..., "what is shown of each")


class ShownFile(Settings):
    """A file of the results that the report shows."""

    path: str = key(..., "in the results folder: figures/….png, or ….md of a table, whose numbers are in the CSV")
    caption: str = key(..., "path of its text, a template in the words of Snakemake's reports")
    wildcards: dict[str, str] = key(..., "of the file's name")
    title: str = key(..., "a few words")


class ReportExperiment(TabulateJob):
    """What the report's tables say of an experiment."""

    name: str = key(..., "of the experiment")
    least_squares: list[str] = key(list, "versions of least squares")


class ReportJob(Settings):
    """The report of a run."""

    WHERE: ClassVar[str] = "--settings"

    shown: list[ShownFile] = key(..., "files to show")
    rules: list[Pair] = key(..., "each rule of the workflow with one that reads what it makes")
    experiments: list[ReportExperiment] = key(..., "of the run")
    files: list[str] = key(..., "that configure the run")
    preset: Preset = key(..., "name of the preset")
    seeds: list[int] = key(..., "of the run")
    device: Device = key(..., "where it was computed")

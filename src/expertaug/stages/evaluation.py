"""Stages that score models and make tables and figures of the scores."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from expertaug.stages.options import add_outputs, add_paths, add_prior, add_tracking, tracking_of
from expertaug.stages.stage import HORIZONS, SETS, TRAINED, Stage, StageWithPrior
from expertaug.stages.study import StudyStage

if TYPE_CHECKING:
    from expertaug.evaluation.products import Product
    from expertaug.evaluation.settings import (
        CompareJob,
        DuringTrainingJob,
        EvaluateJob,
        OverviewJob,
        PlotJob,
        ReportJob,
        StudyJob,
        TabulateJob,
    )
    from expertaug.stages.files import Files

METRICS = "metrics.csv of every method and group of seeds"
FORECASTS = "forecasts.npz of the same runs, which have the errors of every sample"
LONG = "long table of the experiment"
OF_ALL = "forecasts.npz of every version and group of seeds of an experiment"
EVALUATED = ("metrics.csv", "forecasts.npz")
TABLE = "files, .csv, .md or .tex"
MODELS = (*TRAINED, "finetune", "flow")  # stages that write model files
STUDY = "files, .csv, .md, .tex, .png or .pdf"


class Evaluate(StageWithPrior):
    """score a model's forecasts on every set"""

    name = "evaluate"
    code = "expertaug.evaluation.evaluate"
    job = "expertaug.evaluation.settings:EvaluateJob"
    slice = "expertaug.config.stage_settings:evaluate"
    reads = (*SETS, *HORIZONS, *MODELS, "own_prior")
    runs_methods = True

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        add_paths(parser, model="model file", data="folder of the sets", output="CSV of the metrics")
        add_paths(parser, forecasts="npz of forecasts")
        add_prior(parser)

    @staticmethod
    def run(a: argparse.Namespace, job: EvaluateJob) -> None:
        from expertaug.evaluation.evaluate import run_stage

        run_stage(a.model, a.data, a.output, a.forecasts, job)


class LogEvaluations(Stage):
    """draw a figure of each evaluation and write the logs to the MLflow store"""

    name = "log-evaluations"
    code = "expertaug.evaluation.log_evaluations"
    reads = ("evaluate", "init_tracking")

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        parser.add_argument("forecasts", type=Path, nargs="+", help=FORECASTS)
        add_paths(parser, output="JSON that says which logs are stored")
        add_tracking(parser)

    @staticmethod
    def run(a: argparse.Namespace, job: None) -> None:
        from expertaug.evaluation.log_evaluations import run_stage

        run_stage(a.forecasts, a.output, tracking_of(a))


class DuringTraining(StageWithPrior):
    """augment and fine-tune a model at several stages of its training"""

    name = "during-training"
    code = "expertaug.evaluation.during_training"
    job = "expertaug.evaluation.settings:DuringTrainingJob"
    slice = "expertaug.config.stage_settings:during_training"
    reads = (*SETS, "train", "own_prior", "init_tracking")
    runs_methods = True

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        add_paths(parser, snapshots="states along the training", data="folder of the sets", output="CSV of the metrics")
        add_paths(parser, work="folder for checkpoints")
        add_prior(parser)
        add_tracking(parser)

    @staticmethod
    def run(a: argparse.Namespace, job: DuringTrainingJob) -> None:
        from expertaug.evaluation.during_training import run_stage

        run_stage(a.snapshots, a.data, a.output, a.work, job, tracking_of(a))


class Tabulate(Stage):
    """make the tables of an experiment"""

    name = "tabulate"
    code = "expertaug.evaluation.tabulate"
    job = "expertaug.evaluation.settings:TabulateJob"
    slice = "expertaug.config.report_parameters:tabulate"
    reads = ("evaluate",)

    @classmethod
    def products(cls) -> tuple[Product, ...]:
        from expertaug.evaluation.products import Product

        return (Product("", table=True),)

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        parser.add_argument("metrics", type=Path, nargs="+", help=METRICS)
        parser.add_argument("--forecasts", type=Path, nargs="+", default=[], help=FORECASTS)
        add_outputs(parser, "tables, .csv, .md or .tex")

    @staticmethod
    def run(a: argparse.Namespace, job: TabulateJob) -> None:
        from expertaug.evaluation.tabulate import run_stage

        run_stage(a.metrics, a.output, job, a.forecasts)


class Plot(Stage):
    """draw the figures of an experiment"""

    name = "plot"
    code = "expertaug.evaluation.plot"
    job = "expertaug.evaluation.settings:PlotJob"
    slice = "expertaug.config.report_parameters:plot"
    reads = ("evaluate", "tabulate", *MODELS)

    @classmethod
    def products(cls) -> tuple[Product, ...]:
        from expertaug.evaluation.products import PLOTTED

        return PLOTTED

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        parser.add_argument("table", type=Path, help=LONG)
        text = "forecasts.npz of one group of seeds per method"
        parser.add_argument("--forecasts", type=Path, nargs="+", required=True, help=text)
        text = "log.jsonl of every trained method and group of seeds"
        parser.add_argument("--logs", type=Path, nargs="*", default=[], help=text)
        add_paths(parser, output="path of the figures, to which _NAME.png and _NAME.pdf are added")

    @staticmethod
    def run(a: argparse.Namespace, job: PlotJob) -> None:
        from expertaug.evaluation.plot import run_stage

        run_stage(a.table, a.forecasts, a.logs, a.output, job)


class Study(StudyStage):
    """make the table and the figure of a study"""

    name = "study"
    code = "expertaug.evaluation.studies"
    job = "expertaug.evaluation.settings:StudyJob"
    slice = "expertaug.config.report_parameters:study"
    reads = ("evaluate", "during_training")

    @classmethod
    def products(cls) -> tuple[Product, ...]:
        from expertaug.evaluation.products import STUDIES

        return STUDIES

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        text = "metrics.csv and forecasts.npz (during_training.csv) of every variant and group of seeds"
        parser.add_argument("files", type=Path, nargs="+", help=text)
        add_outputs(parser, STUDY)

    @classmethod
    def run(cls, a: argparse.Namespace, job: StudyJob) -> None:
        from expertaug.evaluation.studies import run_stage

        forecasts = [path for path in a.files if path.suffix == ".npz"]
        run_stage([path for path in a.files if path not in forecasts], a.output, job, forecasts)

    @classmethod
    def inputs(cls, files: Files, experiment: str, study: str) -> list[str]:
        from expertaug.config import jobs
        from expertaug.evaluation.products import STUDIES

        if study not in jobs.studies(files.config, experiment):
            return []
        if next(kind.along for kind in STUDIES if kind.name == study):  # scores of one method's models
            return files.of_versions(experiment, files.followed(experiment), "during_training.csv")
        return files.of_versions(experiment, jobs.list_studied(files.config, experiment, study), *EVALUATED)

    @classmethod
    def names(cls, experiment: str, study: str) -> tuple[str, ...]:
        return experiment, study


class _WindowStudy(StudyStage):
    """A study of single windows."""

    paths = ("forecasts",)
    job = "expertaug.evaluation.settings:WindowStudyJob"
    slice = "expertaug.config.report_parameters:windows"
    reads = ("evaluate",)

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        parser.add_argument("forecasts", type=Path, nargs="+", help=OF_ALL)
        add_outputs(parser, STUDY)

    @classmethod
    def inputs(cls, files: Files, experiment: str, study: str) -> list[str]:
        from expertaug.config import jobs

        return files.of_versions(experiment, jobs.variants(files.config, experiment), "forecasts.npz")


class Alarm(_WindowStudy):
    """predict from the observed windows which forecasts fail"""

    name = "alarm"
    code = "expertaug.evaluation.alarms"


class Coverage(_WindowStudy):
    """check how often intervals of the expert parameters contain the truth"""

    name = "coverage"
    code = "expertaug.evaluation.coverage"


class Seeds(_WindowStudy):
    """show each seed, and the median of their forecasts"""

    name = "seeds"
    code = "expertaug.evaluation.seeds"


class Distance(_WindowStudy):
    """show errors and alarms by the distance from the training range"""

    name = "distance"
    code = "expertaug.evaluation.distance"

    @classmethod
    def inputs(cls, files: Files, experiment: str, study: str) -> list[str]:
        simulated = files.config.experiments[experiment].data.source == "simulation"  # a range of training
        return super().inputs(files, experiment, study) if simulated else []


class Grid(StudyStage):
    """make the table and the figure of a sweep over hyperparameters"""

    name = "grid"
    code = "expertaug.evaluation.grid"
    paths = ("models",)
    job = "expertaug.evaluation.settings:GridJob"
    slice = "expertaug.config.report_parameters:grid"
    reads = ("train",)
    log = "grid/{experiment}"

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        parser.add_argument("models", type=Path, nargs="+", help="model files of every point and group of seeds")
        add_outputs(parser, STUDY)

    @classmethod
    def inputs(cls, files: Files, experiment: str, study: str) -> list[str]:
        return files.of_versions(experiment, files.config.experiments[experiment].points, "model.safetensors")


class Validity(StudyStage):
    """check whether the interaction model still holds where z_e is shifted"""

    name = "validity"
    code = "expertaug.evaluation.validity"
    paths = ("models", "data")
    job = "expertaug.evaluation.settings:ValidityJob"
    slice = "expertaug.config.stage_settings:validity"
    reads = (*SETS, *TRAINED)
    runs_methods = True
    title = "validity of F_a"
    runs_models = True
    memory_mb = 4000
    log = "validity/{experiment}"

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        text = "model files, one of each version with an interaction model"
        parser.add_argument("models", type=Path, nargs="+", help=text)
        add_paths(parser, data="folder of the sets")
        add_outputs(parser, STUDY)

    @classmethod
    def inputs(cls, files: Files, experiment: str, study: str) -> list[str]:
        from expertaug.config import jobs

        first = files.seed_groups(experiment)[0]
        return [files.model(experiment, version, first) for version in jobs.list_checked(files.config, experiment)]

    @classmethod
    def sets(cls, files: Files, experiment: str) -> list[str]:

        inside = "iid" if "iid" in files.config.experiments[experiment].data.set_names else "validation"
        return files.sets(experiment, ["train", inside, "test"])


class Dissipation(StudyStage):
    """compare the power that models dissipate with the measured loss of energy"""

    name = "dissipation"
    code = "expertaug.evaluation.dissipation"
    paths = ("models", "data")
    job = "expertaug.evaluation.settings:DissipationJob"
    slice = "expertaug.config.stage_settings:dissipation"
    reads = (*SETS, *TRAINED)
    runs_methods = True
    runs_models = True
    memory_mb = 2000
    log = "dissipation/{experiment}"

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        text = "model files of every trained method and group of seeds"
        parser.add_argument("models", type=Path, nargs="+", help=text)
        add_paths(parser, data="folder of the sets")
        add_outputs(parser, STUDY)

    @classmethod
    def inputs(cls, files: Files, experiment: str, study: str) -> list[str]:
        from expertaug.config import jobs
        from expertaug.versions import Version

        trained = dict.fromkeys(str(Version.parse(v).trained) for v in jobs.dissipating(files.config, experiment))
        return files.of_versions(experiment, list(trained), "model.safetensors")

    @classmethod
    def sets(cls, files: Files, experiment: str) -> list[str]:
        from expertaug.versions import MAIN_SETS

        return files.sets(experiment, MAIN_SETS)


class Estimates(StudyStage):
    """make the table and the figure of the parameters that each version estimates"""

    name = "estimates"
    code = "expertaug.evaluation.estimates"
    paths = ("forecasts",)
    job = "expertaug.evaluation.settings:EstimatesJob"
    slice = "expertaug.config.report_parameters:estimates"
    reads = ("evaluate",)

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        parser.add_argument("forecasts", type=Path, nargs="+", help=OF_ALL)
        add_outputs(parser, STUDY)

    @classmethod
    def inputs(cls, files: Files, experiment: str, study: str) -> list[str]:
        from expertaug.config import jobs

        return files.of_versions(experiment, jobs.estimating(files.config, experiment), "forecasts.npz")


class DataCurves(StudyStage):
    """show how errors depend on the number of trajectories and their noise"""

    name = "data-curves"
    code = "expertaug.evaluation.data_curves"
    paths = ("tables",)
    job = "expertaug.evaluation.settings:DataCurvesJob"
    slice = "expertaug.config.report_parameters:data_curves"
    reads = ("tabulate",)
    title = "size and noise of the data"

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        parser.add_argument("tables", type=Path, nargs="+", help="long table of every experiment that is a point")
        add_outputs(parser, STUDY)

    @classmethod
    def inputs(cls, files: Files, experiment: str, study: str) -> list[str]:
        asked = files.config.experiments[experiment].studies.data_curves
        points = dict.fromkeys([*asked.samples, *asked.noise]) if asked is not None else []
        return [files.path(f"tables/{name}_long.csv") for name in points]


class Equation(StudyStage):
    """find the terms that the expert lacks"""

    name = "equation"
    code = "expertaug.evaluation.equations"
    paths = ("models", "data")
    job = "expertaug.evaluation.settings:EquationJob"
    slice = "expertaug.config.stage_settings:equation"
    reads = (*SETS, *TRAINED)
    runs_methods = True
    runs_models = True
    draws = False
    memory_mb = 4000
    log = "equation/{experiment}"

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        text = "model files, one of each version with an expert"
        parser.add_argument("models", type=Path, nargs="+", help=text)
        add_paths(parser, data="folder of the sets")
        add_outputs(parser, TABLE)

    @classmethod
    def inputs(cls, files: Files, experiment: str, study: str) -> list[str]:
        from expertaug.config import jobs

        first = files.seed_groups(experiment)[0]
        return [files.model(experiment, version, first) for version in jobs.list_explained(files.config, experiment)]

    @classmethod
    def sets(cls, files: Files, experiment: str) -> list[str]:
        return files.sets(experiment, ["train", "validation"])


class OwnPriors(StudyStage):
    """make the table of the ranges found for p⁺"""

    name = "tabulate-own-prior"
    former = ("own-priors",)
    code = "expertaug.evaluation.own_priors"
    paths = ("priors",)
    job = "expertaug.evaluation.settings:OwnPriorsJob"
    slice = "expertaug.config.report_parameters:own_priors"
    reads = ("own_prior",)
    product, draws = "own_priors", False
    title = "own p⁺"
    log = "own_priors/{experiment}"

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        text = "what own-prior wrote, of every version and group of seeds"
        parser.add_argument("priors", type=Path, nargs="+", help=text)
        add_outputs(parser, TABLE)

    @classmethod
    def inputs(cls, files: Files, experiment: str, study: str) -> list[str]:
        from expertaug.config import jobs

        versions = jobs.list_found_priors(files.config, experiment)
        before = [files.path(f"{experiment}/data/prior.json")] if "" in versions else []
        return [*before, *files.of_versions(experiment, [v for v in versions if v], "prior.json")]


class Compare(Stage):
    """compare experiments with the published numbers"""

    name = "compare"
    code = "expertaug.evaluation.published"
    job = "expertaug.evaluation.settings:CompareJob"
    slice = "expertaug.config.report_parameters:compare"
    reads = ("evaluate",)

    @classmethod
    def products(cls) -> tuple[Product, ...]:
        from expertaug.evaluation.products import Product

        return Product("published", table=True), Product("published", table=True, of_all=True)

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        parser.add_argument("metrics", type=Path, nargs="+", help=METRICS)
        parser.add_argument("--forecasts", type=Path, nargs="+", required=True, help=FORECASTS)
        add_outputs(parser, "tables, .csv, .md or .tex")

    @staticmethod
    def run(a: argparse.Namespace, job: CompareJob) -> None:
        from expertaug.evaluation.published import run_stage

        run_stage(a.metrics, a.output, job, a.forecasts)


class Overview(Stage):
    """draw the figures that compare experiments"""

    name = "overview"
    code = "expertaug.evaluation.dots"
    job = "expertaug.evaluation.settings:OverviewJob"
    slice = "expertaug.config.report_parameters:overview"
    reads = ("tabulate",)

    @classmethod
    def products(cls) -> tuple[Product, ...]:
        from expertaug.evaluation.products import OVERVIEWS

        return OVERVIEWS

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        parser.add_argument("tables", type=Path, nargs="+", help="long table of every experiment")
        add_paths(parser, output="folder of the figures")

    @staticmethod
    def run(a: argparse.Namespace, job: OverviewJob) -> None:
        from expertaug.evaluation.dots import run_stage

        run_stage(a.tables, a.output, job)


class Report(Stage):
    """put tables, figures, costs and provenance of a run on one page"""

    name = "report"
    code = "expertaug.evaluation.report.page"
    job = "expertaug.evaluation.settings:ReportJob"

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        add_paths(parser, results="results folder", output="HTML file")

    @staticmethod
    def run(a: argparse.Namespace, job: ReportJob) -> None:
        from expertaug.evaluation.report.page import run_stage

        run_stage(a.results, a.output, job)

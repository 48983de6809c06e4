"""Stages that score models and make tables and figures of the scores."""

from __future__ import annotations

import argparse
import importlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

from expertaug.stages.options import add_outputs, add_paths, add_prior, add_tracking, tracking_of, with_prior
from expertaug.stages.stage import Stage

if TYPE_CHECKING:
    from expertaug.evaluation.settings import (
        CompareJob,
        GridJob,
        OverviewJob,
        OwnPriorsJob,
        PlotJob,
        ReportJob,
        StudyJob,
        TabulateJob,
        WindowStudyJob,
    )

METRICS = "metrics.csv of every method and group of seeds"
FORECASTS = "forecasts.npz of the same runs, which have the errors of every sample"
OF_ALL = "forecasts.npz of every version and group of seeds of an experiment"
TABLE = "files, .csv, .md or .tex"
STUDY = "files, .csv, .md, .tex, .png or .pdf"


class _WithPrior(Stage):
    """A stage whose p⁺ may have found its own ranges."""

    @classmethod
    def complete(cls, a: argparse.Namespace, settings: dict[str, Any]) -> dict[str, Any]:
        return with_prior(a, settings)


class Evaluate(_WithPrior):
    """score a model's forecasts on every set"""

    name = "evaluate"
    code = "expertaug.evaluation.evaluate"
    job = "expertaug.config.stage_models:Evaluate"
    slice = "expertaug.config.stage_settings:evaluate"

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        add_paths(parser, model="model file", data="folder of the sets", output="CSV of the metrics")
        add_paths(parser, forecasts="npz of forecasts")
        add_prior(parser)

    @staticmethod
    def run(a: argparse.Namespace, job: dict) -> None:
        from expertaug.evaluation.evaluate import evaluate

        evaluate(a.model, a.data, a.output, a.forecasts, job)


class LogEvaluations(Stage):
    """draw the own figures of an experiment's evaluations and store their logs"""

    name = "log-evaluations"
    code = "expertaug.evaluation.log_evaluations"

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        parser.add_argument("forecasts", type=Path, nargs="+", help=FORECASTS)
        add_paths(parser, output="JSON that says which logs are stored")
        add_tracking(parser)

    @staticmethod
    def run(a: argparse.Namespace, job: None) -> None:
        from expertaug.evaluation.log_evaluations import log_evaluations

        log_evaluations(a.forecasts, a.output, tracking_of(a))


class DuringTraining(_WithPrior):
    """augment and fine-tune a model at several stages of its training"""

    name = "during-training"
    code = "expertaug.evaluation.during_training"
    job = "expertaug.config.stage_models:Follow"
    slice = "expertaug.config.stage_settings:during_training"

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        add_paths(parser, snapshots="states along the training", data="folder of the sets", output="CSV of the metrics")
        add_paths(parser, work="folder for checkpoints")
        add_prior(parser)
        add_tracking(parser)

    @staticmethod
    def run(a: argparse.Namespace, job: dict) -> None:
        from expertaug.evaluation.during_training import during_training

        during_training(a.snapshots, a.data, a.output, a.work, job, tracking_of(a))


class Tabulate(Stage):
    """make the tables of an experiment"""

    name = "tabulate"
    code = "expertaug.evaluation.tabulate"
    job = "expertaug.evaluation.settings:TabulateJob"
    slice = "expertaug.config.shown_settings:tabulate"

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        parser.add_argument("metrics", type=Path, nargs="+", help=METRICS)
        parser.add_argument("--forecasts", type=Path, nargs="+", default=[], help=FORECASTS)
        add_outputs(parser, "tables, .csv, .md or .tex")

    @staticmethod
    def run(a: argparse.Namespace, job: TabulateJob) -> None:
        from expertaug.evaluation.tabulate import tabulate

        tabulate(a.metrics, a.output, job, a.forecasts)


class Plot(Stage):
    """draw the figures of an experiment"""

    name = "plot"
    code = "expertaug.evaluation.plot"
    job = "expertaug.evaluation.settings:PlotJob"
    slice = "expertaug.config.shown_settings:plot"

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        parser.add_argument("metrics", type=Path, nargs="+", help=METRICS)
        text = "forecasts.npz of one group of seeds per method"
        parser.add_argument("--forecasts", type=Path, nargs="+", required=True, help=text)
        text = "log.jsonl of every trained method and group of seeds"
        parser.add_argument("--logs", type=Path, nargs="+", required=True, help=text)
        add_paths(parser, output="path of the figures, to which _NAME.png and _NAME.pdf are added")

    @staticmethod
    def run(a: argparse.Namespace, job: PlotJob) -> None:
        from expertaug.evaluation.plot import plot

        plot(a.metrics, a.forecasts, a.logs, a.output, job)


class Study(Stage):
    """make the table and the figure of a study"""

    name = "study"
    code = "expertaug.evaluation.studies"
    job = "expertaug.evaluation.settings:StudyJob"
    slice = "expertaug.config.shown_settings:study"

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        text = "metrics.csv (during_training.csv) of every variant and group of seeds"
        parser.add_argument("metrics", type=Path, nargs="+", help=text)
        add_outputs(parser, STUDY)

    @staticmethod
    def run(a: argparse.Namespace, job: StudyJob) -> None:
        from expertaug.evaluation.studies import study

        study(a.metrics, a.output, job)


class _WindowStudy(Stage):
    """A study of single windows."""

    job = "expertaug.evaluation.settings:WindowStudyJob"
    slice = "expertaug.config.shown_settings:windows"

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        parser.add_argument("forecasts", type=Path, nargs="+", help=OF_ALL)
        add_outputs(parser, STUDY)

    @classmethod
    def run(cls, a: argparse.Namespace, job: WindowStudyJob) -> None:
        getattr(importlib.import_module(cls.code), cls.name)(a.forecasts, a.output, job)


class Alarm(_WindowStudy):
    """judge by the observed windows which forecasts fail"""

    name = "alarm"
    code = "expertaug.evaluation.alarms"


class Coverage(_WindowStudy):
    """show whether intervals of the expert parameters hold"""

    name = "coverage"
    code = "expertaug.evaluation.coverage"


class Distance(_WindowStudy):
    """show errors and alarms by the distance from the training range"""

    name = "distance"
    code = "expertaug.evaluation.distance"


class Validity(Stage):
    """check whether the interaction model holds where z_e has moved"""

    name = "validity"
    code = "expertaug.evaluation.validity"
    job = "expertaug.config.stage_models:Validity"
    slice = "expertaug.config.stage_settings:validity"

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        text = "model files, one of each version with an interaction model"
        parser.add_argument("models", type=Path, nargs="+", help=text)
        add_paths(parser, data="folder of the sets")
        add_outputs(parser, STUDY)

    @staticmethod
    def run(a: argparse.Namespace, job: dict) -> None:
        from expertaug.evaluation.validity import validity

        validity(a.models, a.data, a.output, job)


class OwnPriors(Stage):
    """make the table of the ranges that p⁺ has found"""

    name = "own-priors"
    code = "expertaug.evaluation.own_priors"
    job = "expertaug.evaluation.settings:OwnPriorsJob"

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        text = "what own-prior wrote, of every version and group of seeds"
        parser.add_argument("priors", type=Path, nargs="+", help=text)
        add_outputs(parser, TABLE)

    @staticmethod
    def run(a: argparse.Namespace, job: OwnPriorsJob) -> None:
        from expertaug.evaluation.own_priors import own_priors

        own_priors(a.priors, a.output, job)


class Grid(Stage):
    """make the table and the figure of a sweep over hyperparameters"""

    name = "grid"
    code = "expertaug.evaluation.grid"
    job = "expertaug.evaluation.settings:GridJob"
    slice = "expertaug.config.shown_settings:grid"

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        parser.add_argument("models", type=Path, nargs="+", help="model files of every point and group of seeds")
        add_outputs(parser, STUDY)

    @staticmethod
    def run(a: argparse.Namespace, job: GridJob) -> None:
        from expertaug.evaluation.grid import grid

        grid(a.models, a.output, job)


class Dissipation(Stage):
    """compare the power that models dissipate with the loss of energy"""

    name = "dissipation"
    code = "expertaug.evaluation.dissipation"
    job = "expertaug.config.stage_models:Dissipation"
    slice = "expertaug.config.stage_settings:dissipation"

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        text = "model files of every trained method and group of seeds"
        parser.add_argument("models", type=Path, nargs="+", help=text)
        add_paths(parser, data="folder of the sets")
        add_outputs(parser, STUDY)

    @staticmethod
    def run(a: argparse.Namespace, job: dict) -> None:
        from expertaug.evaluation.dissipation import dissipation

        dissipation(a.models, a.data, a.output, job)


class Compare(Stage):
    """compare experiments with the published numbers"""

    name = "compare"
    code = "expertaug.evaluation.published"
    job = "expertaug.evaluation.settings:CompareJob"
    slice = "expertaug.config.shown_settings:compare"

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        parser.add_argument("metrics", type=Path, nargs="+", help=METRICS)
        parser.add_argument("--forecasts", type=Path, nargs="+", required=True, help=FORECASTS)
        add_outputs(parser, "tables, .csv, .md or .tex")

    @staticmethod
    def run(a: argparse.Namespace, job: CompareJob) -> None:
        from expertaug.evaluation.published import compare

        compare(a.metrics, a.output, job, a.forecasts)


class Overview(Stage):
    """draw the figures over several experiments"""

    name = "overview"
    code = "expertaug.evaluation.dots"
    job = "expertaug.evaluation.settings:OverviewJob"
    slice = "expertaug.config.shown_settings:overview"

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        text = "metrics.csv of every experiment, method and group of seeds"
        parser.add_argument("metrics", type=Path, nargs="+", help=text)
        add_paths(parser, output="folder of the figures")

    @staticmethod
    def run(a: argparse.Namespace, job: OverviewJob) -> None:
        from expertaug.evaluation.dots import overview

        overview(a.metrics, a.output, job)


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
        from expertaug.evaluation.report.page import report

        report(a.results, a.output, job)

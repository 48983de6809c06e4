"""Subcommands that score models and make tables and figures of the scores."""

from __future__ import annotations

import argparse
from pathlib import Path

from expertaug.commands.options import (
    Commands,
    add_outputs,
    add_paths,
    add_prior,
    add_tracking,
    read_settings,
    settings_of,
    tracking_of,
)

METRICS = "metrics.csv of every method and group of seeds"
FORECASTS = "forecasts.npz of the same runs, which have the errors of every sample"


def add_to(commands: Commands) -> None:
    """Add this module's subcommands."""
    p = commands.add("evaluate", _evaluate, "score a model's forecasts on every set")
    add_paths(p, model="model file", data="folder of the sets", output="CSV of the metrics")
    add_paths(p, forecasts="npz of forecasts")
    add_prior(p)

    text = "draw the own figures of an experiment's evaluations and store their logs"
    p = commands.add("log-evaluations", _log_evaluations, text, settings=False)
    p.add_argument("forecasts", type=Path, nargs="+", help=FORECASTS)
    add_paths(p, output="JSON that says which logs are stored")
    add_tracking(p)

    p = commands.add("forecast", _forecast, "forecast from observed windows with a trained model", settings=False)
    p.add_argument("window", type=Path, help="CSV: t, the state's components; sample, where it holds several windows")
    add_paths(p, model="model file")
    p.add_argument("--output", type=Path, metavar="CSV", help="file of the forecasts (default: standard output)")
    p.add_argument("--seed", type=int, help="one of the model's seeds (default: all)")
    p.add_argument("--t-end", type=float, metavar="S", help="last time in s (default: the training's)")
    text = "refine the estimates by least squares on each window; give the noise's standard deviation, 0 for none"
    p.add_argument("--refine", type=float, metavar="NOISE", help=text)
    text = "npz like the training's (a run's data/validation.npz): whence the threshold of the column trusted is taken"
    p.add_argument("--validation", type=Path, metavar="NPZ", help=f"{text} (default: the model file)")
    text = "package.module:Class of your own that the model may use; may be repeated"
    p.add_argument("--class", dest="classes", action="append", default=[], metavar="NAME", help=text)

    text = "augment and fine-tune a model at several stages of its training"
    p = commands.add("during-training", _during_training, text)
    add_paths(p, snapshots="states along the training", data="folder of the sets", output="CSV of the metrics")
    add_paths(p, work="folder for checkpoints")
    add_prior(p)
    add_tracking(p)

    p = commands.add("tabulate", _tabulate, "make the tables of an experiment")
    p.add_argument("metrics", type=Path, nargs="+", help=METRICS)
    p.add_argument("--forecasts", type=Path, nargs="+", default=[], help=FORECASTS)
    add_outputs(p, "tables, .csv, .md or .tex")

    p = commands.add("plot", _plot, "draw the figures of an experiment")
    p.add_argument("metrics", type=Path, nargs="+", help=METRICS)
    text = "forecasts.npz of one group of seeds per method"
    p.add_argument("--forecasts", type=Path, nargs="+", required=True, help=text)
    text = "log.jsonl of every trained method and group of seeds"
    p.add_argument("--logs", type=Path, nargs="+", required=True, help=text)
    add_paths(p, output="path of the figures, to which _NAME.png and _NAME.pdf are added")

    p = commands.add("study", _study, "make the table and the figure of a study")
    text = "metrics.csv (during_training.csv) of every variant and group of seeds"
    p.add_argument("metrics", type=Path, nargs="+", help=text)
    add_outputs(p, "files, .csv, .md, .tex, .png or .pdf")

    of_all = "forecasts.npz of every version and group of seeds of an experiment"
    p = commands.add("alarm", _alarm, "judge by the observed windows which forecasts fail")
    p.add_argument("forecasts", type=Path, nargs="+", help=of_all)
    add_outputs(p, "files, .csv, .md, .tex, .png or .pdf")

    p = commands.add("coverage", _coverage, "show whether intervals of the expert parameters hold")
    p.add_argument("forecasts", type=Path, nargs="+", help=of_all)
    add_outputs(p, "files, .csv, .md, .tex, .png or .pdf")

    p = commands.add("distance", _distance, "show errors and alarms by the distance from the training range")
    p.add_argument("forecasts", type=Path, nargs="+", help=of_all)
    add_outputs(p, "files, .csv, .md, .tex, .png or .pdf")

    p = commands.add("validity", _validity, "check whether the interaction model holds where z_e has moved")
    p.add_argument("models", type=Path, nargs="+", help="model files, one of each version with an interaction model")
    add_paths(p, data="folder of the sets")
    add_outputs(p, "files, .csv, .md, .tex, .png or .pdf")

    p = commands.add("own-priors", _own_priors, "make the table of the ranges that p⁺ has found")
    p.add_argument("priors", type=Path, nargs="+", help="what own-prior wrote, of every version and group of seeds")
    add_outputs(p, "files, .csv, .md or .tex")

    p = commands.add("grid", _grid, "make the table and the figure of a sweep over hyperparameters")
    p.add_argument("models", type=Path, nargs="+", help="model files of every point and group of seeds")
    add_outputs(p, "files, .csv, .md, .tex, .png or .pdf")

    p = commands.add("dissipation", _dissipation, "compare the power that models dissipate with the loss of energy")
    p.add_argument("models", type=Path, nargs="+", help="model files of every trained method and group of seeds")
    add_paths(p, data="folder of the sets")
    add_outputs(p, "files, .csv, .md, .tex, .png or .pdf")

    p = commands.add("compare", _compare, "compare experiments with the published numbers")
    p.add_argument("metrics", type=Path, nargs="+", help=METRICS)
    p.add_argument("--forecasts", type=Path, nargs="+", required=True, help=FORECASTS)
    add_outputs(p, "tables, .csv, .md or .tex")

    p = commands.add("overview", _overview, "draw the figures over several experiments")
    p.add_argument("metrics", type=Path, nargs="+", help="metrics.csv of every experiment, method and group of seeds")
    add_paths(p, output="folder of the figures")

    p = commands.add("report", _report, "put tables, figures, costs and provenance of a run on one page")
    add_paths(p, results="results folder", output="HTML file")


def _evaluate(a: argparse.Namespace) -> None:
    from expertaug.evaluation.evaluate import evaluate

    evaluate(a.model, a.data, a.output, a.forecasts, settings_of(a))


def _log_evaluations(a: argparse.Namespace) -> None:
    from expertaug.evaluation.log_evaluations import log_evaluations

    log_evaluations(a.forecasts, a.output, tracking_of(a))


def _forecast(a: argparse.Namespace) -> None:
    from expertaug.api.window_file import forecast_file

    forecast_file(a.model, a.window, a.output, a.seed, a.t_end, a.classes, a.refine, a.validation)


def _during_training(a: argparse.Namespace) -> None:
    from expertaug.evaluation.during_training import during_training

    during_training(a.snapshots, a.data, a.output, a.work, settings_of(a), tracking_of(a))


def _tabulate(a: argparse.Namespace) -> None:
    from expertaug.evaluation.settings import TabulateJob

    job = TabulateJob.from_mapping(read_settings(a.settings))
    from expertaug.evaluation.tabulate import tabulate

    tabulate(a.metrics, a.output, job, a.forecasts)


def _plot(a: argparse.Namespace) -> None:
    from expertaug.evaluation.settings import PlotJob

    job = PlotJob.from_mapping(read_settings(a.settings))
    from expertaug.evaluation.plot import plot

    plot(a.metrics, a.forecasts, a.logs, a.output, job)


def _study(a: argparse.Namespace) -> None:
    from expertaug.evaluation.settings import StudyJob

    job = StudyJob.from_mapping(read_settings(a.settings))
    from expertaug.evaluation.studies import study

    study(a.metrics, a.output, job)


def _alarm(a: argparse.Namespace) -> None:
    from expertaug.evaluation.settings import WindowStudyJob

    job = WindowStudyJob.from_mapping(read_settings(a.settings))
    from expertaug.evaluation.alarms import alarm

    alarm(a.forecasts, a.output, job)


def _coverage(a: argparse.Namespace) -> None:
    from expertaug.evaluation.settings import WindowStudyJob

    job = WindowStudyJob.from_mapping(read_settings(a.settings))
    from expertaug.evaluation.coverage import coverage

    coverage(a.forecasts, a.output, job)


def _distance(a: argparse.Namespace) -> None:
    from expertaug.evaluation.settings import WindowStudyJob

    job = WindowStudyJob.from_mapping(read_settings(a.settings))
    from expertaug.evaluation.distance import distance

    distance(a.forecasts, a.output, job)


def _validity(a: argparse.Namespace) -> None:
    from expertaug.evaluation.validity import validity

    validity(a.models, a.data, a.output, read_settings(a.settings))


def _own_priors(a: argparse.Namespace) -> None:
    from expertaug.evaluation.settings import OwnPriorsJob

    job = OwnPriorsJob.from_mapping(read_settings(a.settings))
    from expertaug.evaluation.own_priors import own_priors

    own_priors(a.priors, a.output, job)


def _grid(a: argparse.Namespace) -> None:
    from expertaug.evaluation.settings import GridJob

    job = GridJob.from_mapping(read_settings(a.settings))
    from expertaug.evaluation.grid import grid

    grid(a.models, a.output, job)


def _dissipation(a: argparse.Namespace) -> None:
    from expertaug.evaluation.dissipation import dissipation

    dissipation(a.models, a.data, a.output, read_settings(a.settings))


def _compare(a: argparse.Namespace) -> None:
    from expertaug.evaluation.settings import CompareJob

    job = CompareJob.from_mapping(read_settings(a.settings))
    from expertaug.evaluation.published import compare

    compare(a.metrics, a.output, job, a.forecasts)


def _overview(a: argparse.Namespace) -> None:
    from expertaug.evaluation.settings import OverviewJob

    job = OverviewJob.from_mapping(read_settings(a.settings))
    from expertaug.evaluation.dots import overview

    overview(a.metrics, a.output, job)


def _report(a: argparse.Namespace) -> None:
    from expertaug.evaluation.settings import ReportJob

    job = ReportJob.from_mapping(read_settings(a.settings))
    from expertaug.evaluation.report.page import report

    report(a.results, a.output, job)

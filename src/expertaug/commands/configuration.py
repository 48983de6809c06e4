"""Subcommands about configurations, before anything runs."""

from __future__ import annotations

import argparse
import logging
from collections.abc import Callable
from pathlib import Path

from expertaug.stages import STAGES

logger = logging.getLogger(__name__)


def add_to(add: Callable[..., argparse.ArgumentParser]) -> None:
    """Add this module's subcommands."""
    p = add("validate", _validate, "check configuration files", "inspect", "expertaug validate my.yaml")
    p.add_argument("config", type=Path, nargs="+", help="YAML files over the default configuration, later ones win")

    text = "try the systems and models of a run on a few samples"
    p = add("check-system", _check_system, text, "inspect", "expertaug check-system my.yaml")
    p.add_argument("config", type=Path, nargs="+", help="YAML files over the default configuration, later ones win")

    examples = """
    expertaug config show pendulum aphynity+
    expertaug config show pendulum aphynity+ learning_rate epochs
    expertaug config show swings least_squares --configfile mine.yaml
    """
    p = add("config", _config, "show the settings of each job of a method, and where each is set", "inspect", examples)
    p.add_argument("action", choices=("show",))
    p.add_argument("experiment", help="name of the experiment")
    p.add_argument("method", help="name of its method")
    text = "show only settings whose job or key has one of these in its name"
    p.add_argument("words", nargs="*", metavar="WORD", help=text)
    p.add_argument("--configfile", type=Path, nargs="+", default=[], metavar="YAML", help="files as in the workflow")

    text = "estimate the time and memory of a run, from what published runs took"
    p = add("demand", _demand, text, "inspect", "expertaug demand config/paper.yaml")
    p.add_argument("config", type=Path, nargs="+", help="YAML files over the default configuration, later ones win")
    p.add_argument("--published", type=Path, default=Path("results/published"), help="folder of published runs")


def _validate(a: argparse.Namespace) -> None:
    from expertaug.config import load as config

    files = config.with_defaults(a.config)
    config.complete_configuration(config.load(files), STAGES)
    below = ", ".join(str(file) for file in files if file not in a.config)
    logger.info("%s%s: valid", ", ".join(map(str, a.config)), f" over {below}" if below else "")


def _check_system(a: argparse.Namespace) -> None:
    from expertaug.config import load as config
    from expertaug.runs.own_classes import check_classes

    for line in check_classes(config.complete_configuration(config.load(config.with_defaults(a.config)), STAGES)):
        print(line)


def _config(a: argparse.Namespace) -> None:
    from expertaug.config import load as config
    from expertaug.config.show import show

    for line in show(config.load(config.with_defaults(a.configfile)), a.experiment, a.method, a.words):
        print(line)


def _demand(a: argparse.Namespace) -> None:
    from expertaug.config import load as config
    from expertaug.runs import demand

    asked = demand.of_config(
        config.complete_configuration(config.load(config.with_defaults(a.config)), STAGES), a.published
    )
    for line in demand.table(asked):
        print(line)

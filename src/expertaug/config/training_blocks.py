"""What a method takes of its experiment's block ``training``."""

from __future__ import annotations

from collections.abc import Mapping

from expertaug.config import options
from expertaug.config.methods import objective_of


def solver_of(training: Mapping) -> dict:
    """What is left of it for what is fitted without a training: its solver, where it names one."""
    return {"solver": training["solver"]} if "solver" in training else {}


def with_own_options(training: Mapping, build: Mapping) -> dict:
    """It with those of the objective's options that are the method's own objective's."""
    given, kind = training.get("objective", {}), objective_of(build)
    return {**training, "objective": {k: v for k, v in given.items() if options.takes_option(kind, k)}}

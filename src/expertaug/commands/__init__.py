"""The subcommands of ``expertaug``, a module for each subject.

A new one is two things in its subject's module: a few lines in ``add_to``, which name it and its arguments, and a
function that takes these and calls the stage, which it imports itself: ``expertaug --version`` must not load torch.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from expertaug import __version__
from expertaug.commands import configuration, evaluation, housekeeping, learning, measurements, recordings, workflow
from expertaug.commands.options import Commands

SUBJECTS = (recordings, measurements, learning, evaluation, configuration, housekeeping, workflow)


def parser() -> argparse.ArgumentParser:
    """The parser of the whole command line; what it parses has ``stage``, a name, and ``run``, its function."""
    parser = argparse.ArgumentParser(prog="expertaug", description="Run one stage of the pipeline.")
    parser.add_argument("--version", action="version", version=__version__)
    commands = Commands(parser)
    for subject in SUBJECTS:
        subject.add_to(commands)
    return parser


def parse(argv: Sequence[str] | None = None) -> argparse.Namespace:
    """What a command line says; a subcommand with ``rest`` gets there what this package does not know."""
    found = parser()
    arguments, rest = found.parse_known_args(argv)
    if "rest" in arguments:
        arguments.rest = rest
    elif rest:
        found.error(f"unrecognized arguments: {' '.join(rest)}")
    return arguments

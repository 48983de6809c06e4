"""The subcommands of ``expertaug``: the stages, and a module for each other subject.

One that is no stage is two things in its subject's module: a few lines in ``add_to``, which name it and its arguments,
and a function that takes these and imports what it calls itself: ``expertaug --version`` must not load torch.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path

from expertaug import __version__, stages
from expertaug.commands import configuration, data, housekeeping, workflow

SUBJECTS = (data, configuration, housekeeping, workflow)


def parser() -> argparse.ArgumentParser:
    """The parser of the whole command line; what it parses has ``stage``, a name, and ``run``, its function."""
    parser = argparse.ArgumentParser(prog="expertaug", description="Run one stage of the pipeline.")
    parser.add_argument("--version", action="version", version=__version__)
    subparsers = parser.add_subparsers(dest="stage", required=True, metavar="STAGE")

    def add(name: str, run: Callable[[argparse.Namespace], None], text: str) -> argparse.ArgumentParser:
        made = subparsers.add_parser(name, help=text, description=f"{text[0].upper()}{text[1:]}.")
        made.set_defaults(run=run)
        made.add_argument("--log", type=Path, metavar="FILE", help="also write progress and errors to this file")
        return made

    for stage in stages.STAGES.values():
        made = add(stage.name, stage.execute, stage.text())
        if stage.job:
            made.add_argument("--settings", required=True, metavar="JSON", help="JSON text, or a JSON or YAML file")
        stage.add_arguments(made)
    for subject in SUBJECTS:
        subject.add_to(add)
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

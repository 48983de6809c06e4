"""A module's subcommands, called as the command line calls them, without its log."""

from __future__ import annotations

import argparse
from types import ModuleType


def call(module: ModuleType, *words: object) -> None:
    """Call one of a module's subcommands."""
    parser = argparse.ArgumentParser()
    below = parser.add_subparsers()

    def add(name, run, text, group="stages", examples="", former=()):
        made = below.add_parser(name, aliases=former, description=text)
        made.set_defaults(run=run)
        return made

    module.add_to(add)
    arguments = parser.parse_args([str(word) for word in words])
    arguments.run(arguments)

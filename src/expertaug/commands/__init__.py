"""The subcommands of ``expertaug``: the stages, and a module for each other subject.

One that is no stage is two things in its subject's module: a few lines in ``add_to``, which name it, its group in the
help, its examples and its arguments, and a function that takes these and imports what it calls itself: ``expertaug
--version`` must not load torch.
"""

from __future__ import annotations

import argparse
import difflib
import functools
import sys
import textwrap
from collections.abc import Callable, Sequence
from pathlib import Path

from expertaug import __version__, stages
from expertaug.commands import configuration, data, housekeeping, workflow

SUBJECTS = (workflow, data, configuration, housekeeping)
# How the help titles the groups of subcommands, in its order.
TITLES = {
    "use": "use it",
    "inspect": "look at configurations and runs",
    "stages": "stages of the workflow, which calls them (snakemake -n -p prints how)",
}
LONGEST = 256  # a file's name
WIDTH, COLUMN = 100, 24  # of the list of subcommands, and of their names in it


def parser() -> argparse.ArgumentParser:
    """The parser of the whole command line; what it parses has ``stage``, a name, and ``run``, its function."""
    return _parser()[0]


@functools.cache  # one process may run hundreds of short jobs
def _parser() -> tuple[argparse.ArgumentParser, dict[str, str]]:
    """The parser, and what each name of a subcommand, former ones too, is called now."""
    raw = argparse.RawDescriptionHelpFormatter
    text = "Learn what an equation lacks from data, and forecast. Each command has its own --help."
    parser = argparse.ArgumentParser(prog="expertaug", description=text, formatter_class=raw)
    parser.add_argument("--version", action="version", version=__version__)
    subparsers = parser.add_subparsers(dest="stage", required=True, metavar="COMMAND", help="one of the commands below")
    groups: dict[str, list[str]] = {group: [] for group in TITLES}
    called: dict[str, str] = {}

    def add(
        name: str,
        run: Callable[[argparse.Namespace], None],
        text: str,
        group: str = "stages",
        examples: str = "",
        former: Sequence[str] = (),
    ) -> argparse.ArgumentParser:
        epilog = f"examples:\n{textwrap.indent(textwrap.dedent(examples).strip(), '  ')}" if examples else None
        description = f"{text[0].upper()}{text[1:]}."
        made = subparsers.add_parser(name, aliases=former, description=description, epilog=epilog, formatter_class=raw)
        made.set_defaults(run=run)
        made.add_argument("--log", type=Path, metavar="FILE", help="also write progress and errors to this file")
        groups[group].append(_line(name, text))
        called.update(dict.fromkeys((name, *former), name))
        return made

    for subject in SUBJECTS:
        subject.add_to(add)
    for stage in stages.STAGES.values():
        made = add(stage.name, stage.execute, stage.text(), former=stage.former)
        if stage.job:
            made.add_argument("--settings", required=True, metavar="JSON", help="JSON text, or a JSON or YAML file")
        stage.add_arguments(made)
    parser.epilog = "\n\n".join(f"{title}:\n" + "\n".join(groups[group]) for group, title in TITLES.items())
    return parser, called


def _line(name: str, text: str) -> str:
    """A subcommand as the list has it: its name and what it does."""
    start = f"  {name}".ljust(COLUMN)
    start += "" if len(start) == COLUMN else "\n" + " " * COLUMN
    return start + f"\n{' ' * COLUMN}".join(textwrap.wrap(text, WIDTH - COLUMN))


def parse(argv: Sequence[str] | None = None) -> argparse.Namespace:
    """What a command line says; a subcommand with ``rest`` gets there what this package does not know.

    A misspelt subcommand ends, with exit status 2, in one line that says which may have been meant.
    """
    command_parser, called = _parser()
    words = list(sys.argv[1:] if argv is None else argv)
    command = next((word for word in words if not word.startswith("-")), None)
    if command is not None and command not in called:
        near = difflib.get_close_matches(command, called, n=3, cutoff=0.6)
        near = list(dict.fromkeys(called[name] for name in near))
        meant = f"did you mean {' or '.join(near)}?" if near else "expertaug --help lists all"
        command_parser.exit(2, f"expertaug: no command '{command}'; {meant}\n")
    for word in words:
        if word.startswith("-") and len(word) < LONGEST and Path(word).is_file():
            command_parser.exit(
                2, f"expertaug: '{word}' is taken for an option; write ./{word} where the file is meant\n"
            )
    arguments, rest = command_parser.parse_known_args(words)
    if "rest" in arguments:
        arguments.rest = rest
    elif rest:
        command_parser.error(f"unrecognized arguments: {' '.join(rest)}")
    return arguments

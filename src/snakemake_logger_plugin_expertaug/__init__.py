"""Snakemake's log as Snakemake writes it, but for configuration files that it cannot read and targets that are none:
those get one clear line.

Snakemake reads ``--configfile`` before any line of a workflow runs, and ends on a file that is missing or not YAML with
a traceback, or with a message that does not name the file.  A logger plugin is what it offers to word its errors
otherwise; ``logger: expertaug`` in a profile turns this one on.  The Snakefile says which targets there are
(:data:`targets`).
"""

from __future__ import annotations

import difflib
import logging
import re
import sys
from collections.abc import Sequence

from snakemake_interface_logger_plugins.base import LogHandlerBase
from snakemake_interface_logger_plugins.common import LogEvent

targets: list[str] = []  # names that the workflow makes, from its Snakefile
_NO_RULE = re.compile(r"No rule to produce (?P<name>.+?) \(if you use input functions")
_OPTIONS = ("--configfile", "--configfiles")


class LogHandler(LogHandlerBase):
    """Snakemake's own handler of the terminal, given another text where a configuration file is at fault."""

    def __post_init__(self) -> None:
        from snakemake.logging import ColorizingTextHandler  # it looks for plugins while it is imported

        stream = sys.stdout if self.common_settings.stdout else sys.stderr
        self.terminal = ColorizingTextHandler(nocolor=self.common_settings.nocolor, stream=stream)

    def setFormatter(self, fmt: logging.Formatter | None) -> None:
        """Of the terminal as well."""
        super().setFormatter(fmt)
        self.terminal.setFormatter(fmt)

    def emit(self, record: logging.LogRecord) -> None:
        if getattr(record, "event", None) == LogEvent.ERROR and (
            said := refusals(sys.argv[1:]) or no_target(record.getMessage())
        ):
            record = logging.makeLogRecord({"levelno": record.levelno, "levelname": record.levelname, "msg": said})
        self.terminal.emit(record)

    @property
    def writes_to_stream(self) -> bool:
        return True

    @property
    def writes_to_file(self) -> bool:
        return False

    @property
    def has_filter(self) -> bool:
        return False

    @property
    def has_formatter(self) -> bool:
        return False

    @property
    def needs_rulegraph(self) -> bool:
        return False


def configuration_files(arguments: Sequence[str]) -> list[str]:
    """The configuration files that Snakemake's command line names."""
    found, takes = [], False
    for argument in arguments:
        option, equals, value = argument.partition("=")
        if argument.startswith("-"):
            takes = option in _OPTIONS
            found += [value] * (takes and bool(equals))
        elif takes:
            found.append(argument)
    return found


def refusals(arguments: Sequence[str]) -> str:
    """A line for each configuration file of the command line that cannot be read; empty where all can be."""
    from expertaug.config import yaml_file
    from expertaug.errors import InputError

    said = []
    for path in configuration_files(arguments):
        try:
            yaml_file.read(path)
        except InputError as error:
            said.append(f"configuration: {error}")
    return "\n".join(said)


def no_target(message: str) -> str:
    """One line for a target that is none, by Snakemake's message; empty where that is about something else."""
    found = _NO_RULE.search(message)
    if found is None or not targets:
        return ""
    name = found["name"]
    near = difflib.get_close_matches(name, targets, n=1)
    meant = f"did you mean {near[0]}?" if near else f"targets are {', '.join(targets)}"
    return f"target: nothing makes {name!r}; {meant}"

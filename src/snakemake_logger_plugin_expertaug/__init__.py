"""Snakemake's log as Snakemake writes it, but for configuration files that it cannot read: those get one clear line.

Snakemake reads ``--configfile`` before any line of a workflow runs, and ends on a file that is missing or not YAML with
a traceback, or with a message that does not name the file.  A logger plugin is what it offers to word its errors
otherwise; ``logger: expertaug`` in a profile turns this one on.
"""

from __future__ import annotations

import logging
import sys
from collections.abc import Sequence

from snakemake_interface_logger_plugins.base import LogHandlerBase
from snakemake_interface_logger_plugins.common import LogEvent

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
        if getattr(record, "event", None) == LogEvent.ERROR and (said := refusals(sys.argv[1:])):
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

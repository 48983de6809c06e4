"""Snakemake's log in few words: a line when a job starts and one when it fails, and one clear line for configuration
files that it cannot read and targets that are none.  Its own log file has everything; so have ``-n``, ``-p`` and
``--verbose``.

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
import time
from collections.abc import Sequence

from snakemake_interface_logger_plugins.base import LogHandlerBase
from snakemake_interface_logger_plugins.common import LogEvent

targets: list[str] = []  # names that the workflow makes, from its Snakefile
_NO_RULE = re.compile(r"No rule to produce (?P<name>.+?) \(if you use input functions")
_OPTIONS = ("--configfile", "--configfiles")
# What begins its lines on how it is set up and where it is in its own work.
_SETUP = (
    *("Using workflow specific profile", "Config file ", "Assuming unrestricted shared filesystem", "Building DAG"),
    *("Using shell: ", "Provided cores: ", "Rules claiming more threads", "Provided resources: ", "Job stats:"),
    *("Conda environments: ignored", "Select jobs to execute", "Touching output file "),
)
_UNTOLD = (LogEvent.JOB_STARTED, LogEvent.JOB_FINISHED, LogEvent.RUN_INFO, LogEvent.RESOURCES_INFO)


class LogHandler(LogHandlerBase):
    """Snakemake's own handler of the terminal, given fewer words."""

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
            record = _saying(said, record)
        settings = self.common_settings
        if settings.dryrun or settings.printshellcmds or settings.verbose:
            self.terminal.emit(record)
        elif (shorter := in_few_words(record)) is not None:
            self.terminal.emit(shorter)

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


def in_few_words(record: logging.LogRecord) -> logging.LogRecord | None:
    """What the terminal gets of a record; None for nothing."""
    event, message = getattr(record, "event", None), str(record.msg or "")
    clock = time.strftime("%H:%M:%S", time.localtime(record.created))
    if event in _UNTOLD or (event is None and message.startswith(_SETUP)):
        return None
    if event == LogEvent.JOB_INFO:
        rule_message = getattr(record, "rule_msg", None)  # a target has none, and files by the hundred
        return _saying(f"{clock}  {rule_message}", record) if rule_message else None
    if event == LogEvent.JOB_ERROR:
        rule_message, logs = (getattr(record, name, None) for name in ("rule_msg", "log"))
        where = f" (log: {', '.join(map(str, logs))})" if logs else ""
        name = getattr(record, "rule_name", None) or "a job"
        return _saying(f"{clock}  Error in rule {name}{f': {rule_message}' if rule_message else ''}{where}", record)
    return record


def _saying(text: str, record: logging.LogRecord) -> logging.LogRecord:
    """A plain record of the level of another one."""
    fields = {"levelno": record.levelno, "levelname": record.levelname, "msg": text, "created": record.created}
    return logging.makeLogRecord(fields)


def configuration_files(arguments: Sequence[str]) -> list[str]:
    """The configuration files that Snakemake's command line names."""
    files, takes = [], False
    for argument in arguments:
        option, equals, value = argument.partition("=")
        if argument.startswith("-"):
            takes = option in _OPTIONS
            files += [value] * (takes and bool(equals))
        elif takes:
            files.append(argument)
    return files


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
    match = _NO_RULE.search(message)
    if match is None or not targets:
        return ""
    name = match["name"]
    near = difflib.get_close_matches(name, targets, n=1)
    meant = f"did you mean {near[0]}?" if near else f"targets are {', '.join(targets)}"
    return f"target: nothing makes {name!r}; {meant}"

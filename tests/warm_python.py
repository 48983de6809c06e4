"""Warm programs for the tests (see expertaug.runs.warm): seconds less for each command.

``interpreter()`` takes the place of ``sys.executable``, and ``path()`` that of ``PATH``, so that ``python``,
``expertaug`` and ``snakemake`` that a command starts are warm too.  Tests of imports, of start-up, of killed runs and
of determinism start ``sys.executable``.
"""

from __future__ import annotations

import atexit
import fcntl
import functools
import json
import os
import sys
import tempfile
from pathlib import Path

from expertaug import source_files
from expertaug.runs import warm

PROGRAMS = {warm.PYTHON: "", "expertaug": "expertaug.cli", "snakemake": "snakemake.cli"}


def interpreter() -> str:
    """The warm ``python``; where the system has no such forks, the ordinary one."""
    return str(folder / warm.PYTHON) if (folder := _folder()) else sys.executable


def path() -> str:
    """``PATH`` with the warm programs first, and those beside the ordinary Python next."""
    ordinary = [str(Path(sys.executable).parent), os.environ["PATH"]]
    return os.pathsep.join([str(folder), *ordinary] if (folder := _folder()) else ordinary)


@functools.cache
def _folder() -> Path | None:
    """Of the programs: one process forks for all test processes of a run, and ends with the last of them that asked.

    It ends when nobody holds its standard input open any more: those that come later open it once more.
    """
    run = os.environ.get("PYTEST_XDIST_TESTRUNUID")
    if run is None:
        return _serve()[0]
    told = Path(tempfile.gettempdir()) / f"warm_python_{run}.json"
    with told.open("a+") as stream:
        fcntl.flock(stream, fcntl.LOCK_EX)
        stream.seek(0)
        try:
            folder, held = json.loads(stream.read())
            _KEPT.append(open(held, "wb", buffering=0))  # noqa: SIM115, PTH123
            return Path(folder)
        except (OSError, ValueError):  # nobody has started it, or who did has ended
            folder, held = _serve()
            stream.truncate(0)
            stream.write(json.dumps([str(folder), held]) if folder else "")
    atexit.register(told.unlink, missing_ok=True)
    return folder


_KEPT: list[object] = []  # as long as this process lives


def _serve() -> tuple[Path | None, str]:
    """The folder of a process that forks, and where its standard input can be opened."""
    started = warm.serve(PROGRAMS, [*source_files.libraries(), "snakemake.cli", "snakemake.api"])
    if started is None:
        return None, ""
    _KEPT.append(started)
    return started.folder, f"/proc/{os.getpid()}/fd/{started.process.stdin.fileno()}"

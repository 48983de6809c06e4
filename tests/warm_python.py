"""Warm programs for the tests (see expertaug.runs.warm): seconds less for each command.

``interpreter()`` takes the place of ``sys.executable``, and ``path()`` that of ``PATH``, so that ``python``,
``expertaug`` and ``snakemake`` that a command starts are warm too.  Tests of imports, of start-up, of killed runs and
of determinism start ``sys.executable``.
"""

from __future__ import annotations

import functools
import os
import sys
from pathlib import Path

from expertaug import source_files
from expertaug.runs import warm

PROGRAMS = {warm.PYTHON: "", "expertaug": "expertaug.cli", "snakemake": "snakemake.cli"}


def interpreter() -> str:
    """The warm ``python``; where the system has no such forks, the ordinary one."""
    return str(started.folder / warm.PYTHON) if (started := _started()) else sys.executable


def path() -> str:
    """``PATH`` with the warm programs first, and those beside the ordinary Python next."""
    ordinary = [str(Path(sys.executable).parent), os.environ["PATH"]]
    return os.pathsep.join([str(started.folder), *ordinary] if (started := _started()) else ordinary)


@functools.cache
def _started() -> warm.Warm | None:
    """The process that forks; it ends with this one."""
    return warm.serve(PROGRAMS, [*source_files.libraries(), "snakemake.cli", "snakemake.api"])

"""The command ``expertaug``: one subcommand for each stage, for the workflow and for people."""

from __future__ import annotations

import ctypes
import errno
import json
import logging
import os
import resource
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from expertaug import commands
from expertaug.errors import InputError, SolveError, lines

# One thread a job: two jobs of one thread each beat two of two. Set before any numerical library is loaded.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

BAD_INPUT, FAILED, INTERRUPTED = 2, 3, 130
# Of glibc's malloc.h: options of mallopt, and how many bytes may lie unused (at most what its int holds).
TRIM_THRESHOLD, MMAP_THRESHOLD, KEPT, LARGE = -1, -3, 2**30, 2**23
logger = logging.getLogger("expertaug")


def main(argv: Sequence[str] | None = None) -> int:
    """Run a stage; 0 when it went well, 2 for bad input, 3 for a failed solve, 1 for a bug."""
    began = time.monotonic()
    arguments = commands.parse(argv)
    stage = arguments.stage
    keep_freed_memory()
    try:
        _log_to(arguments.log)
        arguments.run(arguments)
        sys.stdout.flush()
        if arguments.log is not None:
            _write_cost(arguments.log.with_suffix(".cost.json"), time.monotonic() - began)
    except BrokenPipeError:  # whoever read the output, as head does, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except InputError as error:
        for line in lines(error):
            _fail(stage, line, BAD_INPUT)
        return BAD_INPUT
    except SolveError as error:
        return _fail(stage, error, FAILED)
    except OSError as error:
        refused = error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES, errno.EPERM)
        if not refused and error.filename is None:
            return _bug(stage)
        remedy = "free some space or choose a writable folder" if refused else "correct the path, or what lies there"
        input_error = InputError(error.filename or "output", error.strerror or str(error), remedy)
        return _fail(stage, input_error, BAD_INPUT)
    except KeyboardInterrupt:
        return _fail(stage, "interrupted", INTERRUPTED)
    except Exception:
        return _bug(stage)
    return 0


def keep_freed_memory() -> bool:
    """Have the C library keep the memory of tensors that are gone for the next ones; whether it can.

    glibc gives large blocks back to the system at once, and every step of a solver then has its pages mapped and zeroed
    again: up to half of an evaluation's time (benchmarks/allocation.py).  Blocks above 8 MiB go back: kept, they leave
    holes that the next ones do not fit into, by which a job grew to several times the memory that it needs.  Numbers do
    not depend on it.
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError, TypeError):  # another C library
        return False
    return bool(mallopt(MMAP_THRESHOLD, LARGE)) & bool(mallopt(TRIM_THRESHOLD, KEPT))


def _write_cost(path: Path, seconds: float) -> None:
    """What the job took, for expertaug.evaluation.costs: Snakemake cannot measure one that starts warm."""
    unit = 2**20 if sys.platform == "darwin" else 2**10  # getrusage tells bytes there, KiB on Linux
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    cost = {
        "seconds": round(seconds, 2),
        "cpu_seconds": round(sum(usage.ru_utime + usage.ru_stime for usage in used), 2),
        "peak_memory_mb": round(max(usage.ru_maxrss for usage in used) / unit, 1),
    }
    path.write_text(json.dumps(cost) + "\n", encoding="utf-8")


def _bug(stage: str) -> int:
    logger.exception("expertaug %s: failed", stage)
    return 1


def _fail(stage: str, error: object, status: int) -> int:
    logger.error("expertaug %s: %s", stage, " ".join(str(error).split()))
    return status


def _log_to(path: Path | None) -> None:
    """Progress and warnings to standard error, and to a file as well where one is named."""
    logging.raiseExceptions = False  # a full disk is told by what could not be written, not by every line of the log
    handlers: list[logging.Handler] = [logging.StreamHandler(sys.stderr)]
    logging.basicConfig(level=logging.INFO, format="%(message)s", handlers=handlers, force=True)
    for noisy in ("mlflow", "alembic", "matplotlib", "sqlalchemy", "fontTools"):
        logging.getLogger(noisy).setLevel(logging.WARNING)
    if path is None:
        return
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handler = logging.FileHandler(path, mode="w", encoding="utf-8")
    except OSError as error:
        remedy = "choose a writable results folder"
        raise InputError(path, f"cannot be written ({error.strerror})", remedy) from error
    handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(message)s"))
    logging.getLogger().addHandler(handler)


if __name__ == "__main__":
    sys.exit(main())

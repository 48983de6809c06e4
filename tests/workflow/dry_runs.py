"""Dry runs of one project by a process that has imported Snakemake already: most of what a small one costs.

Each is a fork that knows nothing of the others. Run as a script in the project's folder: a line of arguments in, a line
of what Snakemake returned and said out, both JSON.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import traceback
from collections.abc import Mapping, Sequence
from pathlib import Path


class DryRuns:
    """The process, as seen from a test."""

    def __init__(self, project: Path, environment: Mapping[str, str]) -> None:
        command = [sys.executable, str(Path(__file__).resolve())]
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
        self._server = subprocess.Popen(command, cwd=project, env=dict(environment), **pipes)

    def run(self, arguments: Sequence[str]) -> subprocess.CompletedProcess:
        """``snakemake --dry-run`` with these arguments; its output is all of one piece."""
        self._server.stdin.write(json.dumps(arguments) + "\n")
        self._server.stdin.flush()
        status, said = json.loads(self._server.stdout.readline())
        return subprocess.CompletedProcess(arguments, status, said, "")

    def close(self) -> None:
        self._server.stdin.close()
        self._server.wait()
        self._server.stdout.close()


def serve() -> None:
    import pandas  # noqa: F401

    from expertaug.config import jobs, load, stage_settings  # noqa: F401
    from expertaug.runs import own_classes, progress, record  # noqa: F401

    for line in sys.stdin:
        with tempfile.TemporaryFile("w+") as said:
            child = os.fork()
            if not child:
                run(json.loads(line), said.fileno())
            status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
            said.seek(0)
            print(json.dumps([status, said.read()]), flush=True)


def run(arguments: list[str], said: int) -> None:
    """In the fork, which ends here."""
    from snakemake.cli import main

    os.dup2(said, 1)
    os.dup2(said, 2)
    sys.argv = ["snakemake", *arguments]
    status: object = 1
    try:
        main()
    except SystemExit as end:
        status = end.code
    except BaseException:
        traceback.print_exc()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status if isinstance(status, int) else int(status is not None))


if __name__ == "__main__":
    serve()

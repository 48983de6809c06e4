"""One smoke run for all tests of the workflow, whichever process they run in."""

from __future__ import annotations

import fcntl
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from dry_runs import DryRuns
from running import DRY_RUNS, SMOKE, copy_project, env_of, snakemake

# Written into the environment of the smoke run: each job of the command line says which modules it has loaded.
RECORDER = """
import atexit, json, os, sys, uuid
def record():
    files = [getattr(m, "__file__", None) for n, m in list(sys.modules.items()) if n.startswith("expertaug")]
    if os.path.basename(sys.argv[0]) == "expertaug":
        with open(os.path.join(os.environ["RECORD"], uuid.uuid4().hex), "w") as stream:
            json.dump([sys.argv[1], [f for f in files if f]], stream)
atexit.register(record)
"""


@pytest.fixture(scope="session")
def smoke_run(tmp_path_factory) -> Path:
    """A copy of the project in which the smoke run has ended well: made by the test process that comes first."""
    root = tmp_path_factory.getbasetemp()
    root = root.parent if "PYTEST_XDIST_WORKER" in os.environ else root
    folder = root / "smoke_run"
    with (root / "smoke_run.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not folder.exists():
            record = copy_project(folder) / "record"
            record.mkdir()
            (record / "sitecustomize.py").write_text(RECORDER)
            python_path = os.pathsep.join([str(folder / "src"), str(record)])
            done = snakemake(folder, *SMOKE, warm=False, PYTHONPATH=python_path, RECORD=str(record))
            (folder / "said").write_text(done.stdout + done.stderr)
            (folder / "status").write_text(str(done.returncode))
    if (folder / "status").read_text() != "0":
        lines = (folder / "said").read_text().splitlines()
        told = [line for line in lines if line.startswith(("expertaug ", "Error in rule"))] or lines[-3:]
        pytest.fail(f"the smoke run failed: {'; '.join(told)}", pytrace=False)
    return folder


@pytest.fixture(scope="session")
def project(smoke_run, tmp_path_factory) -> Iterator[Path]:
    """This process's own copy of that project: its tests ask what would be done, or put back what they change."""
    folder = shutil.copytree(smoke_run, tmp_path_factory.mktemp("project") / "project")
    DRY_RUNS[folder] = DryRuns(folder, env_of(folder))
    yield folder
    DRY_RUNS.pop(folder).close()

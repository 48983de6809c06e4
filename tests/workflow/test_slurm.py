"""The profile for SLURM, as shipped, on a real cluster of one node that the tests start themselves."""

from __future__ import annotations

import fcntl
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import slurm_cluster
from running import SMOKE, copy_project, env_of, override

# As shipped, but for how often a job is looked after: for seconds, not for hours.
PROFILE = ["--workflow-profile", "profiles/slurm", "--slurm-init-seconds-before-status-checks", "2"]
TIMEOUT_S = 3600
MEAN = "pendulum/mean/seeds_0_1/model.safetensors"  # of a smoke run: takes no time


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    """One cluster at a time: it takes all of this machine."""
    if reason := slurm_cluster.missing():
        pytest.skip(reason)
    root = tmp_path_factory.getbasetemp()
    with ((root.parent if "PYTEST_XDIST_WORKER" in os.environ else root) / "cluster.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        with slurm_cluster.cluster(tmp_path_factory.mktemp("cluster")) as env:
            yield env


def submit(project: Path, cluster: dict[str, str], *arguments: object) -> subprocess.Popen:
    """Start a run on the cluster; what it says is in the file ``said`` of the project."""
    own = env_of(project)
    env = cluster | own | {"PATH": os.pathsep.join((cluster["PATH"].partition(os.pathsep)[0], own["PATH"]))}
    with (project / "said").open("w") as said:
        command = [sys.executable, "-m", "snakemake", *PROFILE, *map(str, arguments)]
        return subprocess.Popen(command, cwd=project, env=env, stdout=said, stderr=said, start_new_session=True)


def when(true, run: subprocess.Popen, project: Path) -> None:
    """Wait until something is so."""
    until = time.monotonic() + 300
    while not true():
        assert run.poll() is None and time.monotonic() < until, (project / "said").read_text()[-3000:]
        time.sleep(0.05)


def running(cluster: dict[str, str]) -> list[str]:
    return [job["JobId"] for job in slurm_cluster.jobs(cluster) if job["JobState"] == "RUNNING"]


def ids(cluster: dict[str, str]) -> set[str]:
    return {job["JobId"] for job in slurm_cluster.jobs(cluster)}


def ended(run: subprocess.Popen, project: Path) -> str:
    try:
        assert run.wait(TIMEOUT_S) == 0, (project / "said").read_text()[-3000:]
    finally:
        if run.poll() is None:
            os.killpg(run.pid, signal.SIGKILL)
    return (project / "said").read_text()


def kill_training(project: Path) -> None:
    """Kill the stage that trains in this project, as a node out of memory does."""
    for process in Path("/proc").glob("[0-9]*"):
        try:
            words = (process / "cmdline").read_bytes().split(b"\0")
            here = (process / "cwd").readlink() == project
        except OSError:
            continue
        if here and b"train" in words and any(word.endswith(b"expertaug") for word in words):
            os.kill(int(process.name), signal.SIGKILL)


def test_a_stopped_job_is_tried_again(smoke_run, cluster, tmp_path):
    project, before = shutil.copytree(smoke_run, tmp_path / "project"), ids(cluster)
    (project / "results/smoke" / MEAN).unlink()
    run = submit(project, cluster, f"results/smoke/{MEAN}", *SMOKE)
    try:
        when(lambda: running(cluster), run, project)
        subprocess.run(["scancel", *running(cluster)], env=cluster, check=True)
    finally:
        said = ended(run, project)
    assert "Trying to restart job" in said and "Falling back to 'sacct'" not in said
    first, second = slurm_cluster.jobs(cluster, before)
    assert (first["JobState"], second["JobState"]) == ("CANCELLED", "COMPLETED")
    assert "gpu" not in second.get("TresPerNode", "") + second.get("TresPerJob", "")
    assert (project / "results/smoke" / MEAN).is_file()


def test_a_killed_training_goes_on_where_it_was(smoke_run, cluster, tmp_path):
    project, before = shutil.copytree(smoke_run, tmp_path / "project"), ids(cluster)
    results, model = project / "results/smoke", "pendulum/aphynity/seeds_0_1/model.safetensors"
    training = {"epochs": 40, "checkpoint_s": 0.0}
    arguments = [f"results/smoke/{model}", *override(project, {"experiments": {"pendulum": {"training": training}}})]
    checkpoint = results / ".work/pendulum/aphynity/seeds_0_1/checkpoint.pt"
    log = (results / model).with_name("log.jsonl")
    run = submit(project, cluster, *arguments)
    try:
        when(checkpoint.exists, run, project)
        identity = json.loads(log.read_text().partition("\n")[0])["id"]
        kill_training(project)
    finally:
        ended(run, project)
    assert [job["JobState"] for job in slurm_cluster.jobs(cluster, before)] == ["FAILED", "COMPLETED"]
    assert json.loads(log.read_text().partition("\n")[0])["id"] == identity, "the training began again"
    assert (results / model).is_file()


def test_a_card_is_asked_for_where_device_says_so(smoke_run, cluster, tmp_path):
    project, before = shutil.copytree(smoke_run, tmp_path / "project"), ids(cluster)
    arguments = [f"results/smoke/{MEAN}", *SMOKE, "--config", "device=cuda"]
    run = submit(project, cluster, *arguments)
    run.wait(TIMEOUT_S)  # it fails where there is no card: the cluster's is none
    asked = slurm_cluster.jobs(cluster, before)
    assert asked and all("gpu" in job.get("TresPerNode", "") + job.get("TresPerJob", "") for job in asked)


@pytest.mark.outside
@pytest.mark.parametrize("array", [False, True], ids=["jobs", "arrays"])
def test_the_small_run_of_one_system_passes(cluster, tmp_path, array):
    """With a job for each seed; the arrays are of all the jobs of a stage that are ready."""
    project, before = copy_project(tmp_path / "project"), ids(cluster)
    change = {"run": ["rlc"], "seeds_per_job": 1, "experiments": {"rlc": {"methods": ["mean", "aphynity"]}}}
    (project / "one.yaml").write_text(json.dumps(change))
    options = ["--slurm-array-jobs", "train_seed_group,finetune_seed_group,evaluate_seed_group"] if array else []
    ended(submit(project, cluster, *options, "--configfile", "config/smoke.yaml", "one.yaml"), project)
    assert (project / "results/smoke/tables/rlc.md").is_file()
    found = slurm_cluster.jobs(cluster, before)
    assert {job["JobState"] for job in found} == {"COMPLETED"}
    assert any("ArrayTaskId" in job for job in found) == array


@pytest.mark.outside
def test_the_small_run_passes(cluster, tmp_path):
    project = copy_project(tmp_path / "project")
    ended(submit(project, cluster, "--configfile", "config/smoke.yaml"), project)
    assert (project / "results/smoke/tables/published.md").is_file()

"""A SLURM cluster of one node, this machine, that lives in a folder and as long as a test."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import time
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch", "srun", "squeue", "scontrol")
# Slurm's own defaults but for where everything lies and how long it tells of jobs that have ended; no accounting
# database, and a card that is none.
CONFIGURATION = """
ClusterName=test
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={ports[0]}
SlurmdPort={ports[1]}
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
SlurmUser=root
SlurmdUser=root
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU_Memory
AccountingStorageType=accounting_storage/none
ReturnToService=2
MinJobAge=7200
MailProg=/bin/true
GresTypes=gpu
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
NodeName={host} NodeAddr=127.0.0.1 CPUs=2 RealMemory={memory} Gres=gpu:1
PartitionName=main Nodes={host} Default=YES
"""
# A job's own steps lose SLURM_CONF (the executor plugin's jobstep removes SLURM_*), and would look in /etc/slurm.
STEP = '#!/bin/sh\nSLURM_CONF="{folder}/slurm.conf" exec {srun} "$@"\n'
PATIENCE_S = 60


def missing() -> str:
    """Why there can be no cluster on this machine; empty where there can."""
    if lacking := [name for name in PROGRAMS if shutil.which(name) is None]:
        return f"no {lacking[0]}: apt-get install slurm-wlm munge"
    if find_spec("snakemake_executor_plugin_slurm") is None:
        return "no executor plugin: pip install -c constraints.txt -e '.[slurm]'"
    return "" if os.getuid() == 0 else "slurmd and munged are started as root"


@contextmanager
def cluster(folder: Path) -> Iterator[dict[str, str]]:
    """Start the daemons; gives the environment in which SLURM's commands find them, and stops them in the end."""
    for name in ("state", "spool", "bin"):
        (folder / name).mkdir(parents=True)
    host, ports = socket.gethostname().partition(".")[0], _free_ports(2)
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 2**20 - 500
    (folder / "slurm.conf").write_text(CONFIGURATION.format(folder=folder, host=host, ports=ports, memory=memory))
    (folder / "gres.conf").write_text("Name=gpu File=/dev/null\n")
    (folder / "munge.key").write_bytes(os.urandom(128))
    (folder / "munge.key").chmod(0o600)
    (folder / "bin" / "srun").write_text(STEP.format(folder=folder, srun=shutil.which("srun")))
    (folder / "bin" / "srun").chmod(0o755)
    path = os.pathsep.join((str(folder / "bin"), os.environ["PATH"]))
    env = os.environ | {"SLURM_CONF": str(folder / "slurm.conf"), "PATH": path}
    places = [f"--{name}={folder}/munge.{name.partition('-')[0]}" for name in ("socket", "key-file", "pid-file")]
    places += [f"--log-file={folder}/munge.log", f"--seed-file={folder}/munge.seed"]
    daemons = []
    try:
        for command in (["munged", "-F", "--force", *places], ["slurmctld", "-D"], ["slurmd", "-D"]):
            with (folder / f"{command[0]}.said").open("w") as said:
                daemons.append(subprocess.Popen(command, env=env, stdout=said, stderr=said))
            if command[0] == "munged":
                _wait_for(lambda: (folder / "munge.socket").exists(), folder)
        _wait_for(lambda: "idle" in _said(env, "sinfo", "--noheader", "--format=%T"), folder)
        yield env
    finally:
        subprocess.run(["scancel", "--state=RUNNING"], env=env, capture_output=True, check=False)
        for daemon in reversed(daemons):
            daemon.terminate()
            daemon.wait(PATIENCE_S)


def jobs(env: dict[str, str], known: Collection[str] = ()) -> list[dict[str, str]]:
    """What SLURM tells of all jobs but the ``known``, by names of its own: JobId, JobState, ExitCode, TresPerNode, …"""
    lines = _said(env, "scontrol", "--oneliner", "show", "jobs").splitlines()
    told = [line for line in lines if line.startswith("JobId=")]
    found = [dict(word.split("=", 1) for word in line.split() if "=" in word) for line in told]
    return [job for job in found if job["JobId"] not in known]


def _said(env: dict[str, str], *command: str) -> str:
    return subprocess.run(command, env=env, capture_output=True, text=True, check=False).stdout


def _wait_for(true, folder: Path) -> None:
    until = time.monotonic() + PATIENCE_S
    while not true():
        if time.monotonic() > until:
            said = [path.read_text()[-500:] for path in folder.glob("*.said")]
            raise AssertionError("the cluster did not start: " + "\n".join(said))
        time.sleep(0.1)


def _free_ports(count: int) -> list[int]:
    sockets = [socket.socket() for _ in range(count)]
    for one in sockets:
        one.bind(("127.0.0.1", 0))
    ports = [one.getsockname()[1] for one in sockets]
    for one in sockets:
        one.close()
    return ports

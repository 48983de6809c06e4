"""What jobs cost: Snakemake's benchmark files of a run, and the costs.csv of a published one."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import NamedTuple

from expertaug.files import find

RENAMED = {"along": "during_training"}  # stages that runs published before were called otherwise


class Cost(NamedTuple):
    """What one job took."""

    seconds: float
    peak_memory_mb: float  # resident; 0 where it was not measured


def of_run(benchmarks: Path) -> dict[str, Cost]:
    """What each job of a results folder took (``train/pendulum_aphynity_seeds_0_1_2``), as Snakemake measured it.

    Arguments:
        benchmarks: folder of its benchmark files; one that a job is just writing is left out.
    """
    found = {}
    for path in find(benchmarks, "*.tsv"):
        with path.open(encoding="utf-8", newline="") as stream:
            rows = list(csv.DictReader(stream, delimiter="\t"))
        if rows:
            memory = rows[-1].get("max_rss") or "NA"
            job = path.relative_to(benchmarks).with_suffix("").as_posix()
            found[job] = Cost(float(rows[-1]["s"]), 0.0 if memory in ("NA", "-") else float(memory))
    return found


def published(folder: Path) -> dict[str, dict[str, float]]:
    """Seconds by job of every published run, by the run's name; stages are called as they are today."""
    files = sorted(Path(folder).glob("*/costs.csv"))
    return {path.parent.name: {job: cost.seconds for job, cost in read(path).items()} for path in files}


def read(path: Path) -> dict[str, Cost]:
    """What each job took, by a costs.csv; stages are called as they are today."""
    with Path(path).open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    return {_today(row["job"]): Cost(float(row["seconds"]), float(row["peak_memory_mb"])) for row in rows}


def as_csv(costs: dict[str, Cost]) -> str:
    """The text of a costs.csv."""
    lines = [f"{job},{cost.seconds:.1f},{cost.peak_memory_mb:.0f}" for job, cost in costs.items()]
    return "\n".join(["job,seconds,peak_memory_mb", *lines]) + "\n"


def _today(job: str) -> str:
    stage, slash, rest = job.partition("/")
    return RENAMED.get(stage, stage) + slash + rest

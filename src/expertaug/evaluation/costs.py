"""What jobs cost: the files beside the logs of a run, and the costs.csv of a published one."""

from __future__ import annotations

import csv
import json
from dataclasses import dataclass
from pathlib import Path

from expertaug.files import find

COST = ".cost.json"  # in place of a log's ending, as expertaug.cli writes it
RENAMED = {"along": "during_training"}  # stages that runs published before were called otherwise


@dataclass(frozen=True)
class Cost:
    """What one job took.

    Attributes:
        seconds: of the clock, once Python runs.
        cpu_seconds: of the job and what it started; 0 where nobody measured them.
        peak_memory_mb: resident, of a job that starts warm with all libraries; 0 where nobody measured it.
    """

    seconds: float
    cpu_seconds: float = 0.0
    peak_memory_mb: float = 0.0

    @property
    def alone_s(self) -> float:
        """Seconds on a core of its own: a job has one thread, and beside other work the clock says more."""
        return min(self.seconds, self.cpu_seconds or self.seconds)


def of_run(logs: Path) -> dict[str, Cost]:
    """What each job of a results folder took (``train/pendulum_aphynity_seeds_0_1_2``), as the command line wrote it.

    Arguments:
        logs: folder of its logs; a cost that cannot be read, as one that is just being written, is left out.
    """
    costs = {}
    for path in find(logs, f"*{COST}"):
        try:
            fields = json.loads(path.read_text(encoding="utf-8"))
            cost = Cost(**{name: float(value) for name, value in fields.items()})
        except (OSError, ValueError, TypeError, AttributeError):
            continue
        costs[path.relative_to(logs).as_posix().removesuffix(COST)] = cost
    return costs


def read_published(folder: Path) -> dict[str, dict[str, float]]:
    """Seconds by job of every published run, each on a core of its own, by the run's name; stages are called as they
    are today."""
    files = sorted(Path(folder).glob("*/costs.csv"))
    return {path.parent.name: {job: cost.alone_s for job, cost in read(path).items()} for path in files}


def read(path: Path) -> dict[str, Cost]:
    """What each job took, by a costs.csv; stages are called as they are today."""
    with Path(path).open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    return {_today(row.pop("job")): Cost(**{name: float(value) for name, value in row.items()}) for row in rows}


def as_csv(costs: dict[str, Cost]) -> str:
    """The text of a costs.csv."""
    lines = [f"{job},{c.seconds:.1f},{c.cpu_seconds:.1f},{c.peak_memory_mb:.0f}" for job, c in costs.items()]
    return "\n".join(["job,seconds,cpu_seconds,peak_memory_mb", *lines]) + "\n"


def _today(job: str) -> str:
    stage, slash, rest = job.partition("/")
    return RENAMED.get(stage, stage) + slash + rest

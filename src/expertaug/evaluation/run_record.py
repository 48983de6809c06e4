"""Where a run's numbers come from, and what they cost in sum: of a record, and as tables of the report."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from expertaug.evaluation.costs import Cost
from expertaug.evaluation.settings import ReportJob
from expertaug.evaluation.table import Table
from expertaug.files import find
from expertaug.tracking import provenance
from expertaug.tracking.log import read_log


@dataclass(frozen=True)
class RunRecord:
    """What computed a run's numbers, and what that took.

    Attributes:
        git_revisions: of the code that trained and fine-tuned, as its logs say.
        versions, machine: of packages, and of the machine, as the process sees them that asks.
        job_seconds: of all jobs in sum.
        peak_memory_mb: the largest of one.
    """

    git_revisions: list[str]
    versions: dict[str, str]
    machine: dict[str, object]
    job_seconds: int
    peak_memory_mb: int


def of_run(results: Path, measured: Mapping[str, Cost]) -> RunRecord:
    """Git revisions of the code that trained and fine-tuned, as its logs say; versions of packages and the machine, of
    the process that asks; seconds of all jobs in sum, and the largest memory of one.

    Arguments:
        results: the results folder.
        measured: what its jobs took.
    """
    logs = [read_log(path) for path in find(results, "log.jsonl")]
    return RunRecord(
        git_revisions=sorted({log.header.tags.get("git_revision", "unknown") for log in logs}),
        versions=provenance.versions(),
        machine=provenance.machine(),
        job_seconds=round(sum(cost.seconds for cost in measured.values())),
        peak_memory_mb=round(max((cost.peak_memory_mb for cost in measured.values()), default=0)),
    )


def costs_table(measured: Mapping[str, Cost]) -> Table:
    """Jobs, time and memory of every stage that measured them, the dearest first, and of all."""
    stages: dict[str, list[Cost]] = {}
    for job, cost in measured.items():
        stages.setdefault(job.partition("/")[0], []).append(cost)
    ranked = sorted(stages.items(), key=lambda stage: -sum(cost.seconds for cost in stage[1]))
    rows = [_row(name.replace("_", " "), costs) for name, costs in ranked]
    if len(rows) > 1:
        rows.append(_row("all", list(measured.values())))
    return Table(["stage", "jobs", "total time", "longest job", "largest memory of a job [MB]"], [("", rows)])


def duration(seconds: float) -> str:
    """Hours, minutes and seconds: ``2 h 05 min``, ``3 min 20 s``, ``8 s``."""
    whole = round(seconds)
    hours, minutes = whole // 3600, whole % 3600 // 60
    if hours:
        return f"{hours} h {minutes:02d} min"
    return f"{minutes} min {whole % 60:02d} s" if minutes else f"{whole} s"


def provenance_table(record: RunRecord, job: ReportJob, revision: str | None) -> Table:
    """Configuration, revisions, machine and versions.

    Arguments:
        record: of :func:`of_run`.
        job: of the stage.
        revision: of the code that made the page.
    """
    rows = [
        ["configuration", ", ".join(job.files)],
        [
            "preset, seeds, device",
            f"{job.preset}; {', '.join(map(str, job.seeds))}; {job.device}",
        ],
        ["code that trained", ", ".join(record.git_revisions) or "nothing was trained"],
        ["code that made this page", revision or "unknown: not a git checkout"],
        ["machine", ", ".join(f"{key} {value}" for key, value in record.machine.items())],
        ["packages", ", ".join(f"{name} {version}" for name, version in record.versions.items())],
    ]
    return Table(["what", "which"], [("", rows)])


def _row(name: str, costs: list[Cost]) -> list[str]:
    seconds, memory = [cost.seconds for cost in costs], max(cost.peak_memory_mb for cost in costs)
    return [name, str(len(costs)), duration(sum(seconds)), duration(max(seconds)), f"{memory:.0f}" if memory else "–"]

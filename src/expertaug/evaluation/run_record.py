"""Where a run's numbers come from, and what they cost in sum."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from expertaug.evaluation.costs import Cost
from expertaug.tracking import provenance
from expertaug.tracking.log_file import read_log


def of_run(results: Path, measured: Mapping[str, Cost]) -> dict[str, object]:
    """Git revisions of the code that trained and fine-tuned, as its logs say; versions of packages and the machine, of
    the process that asks; seconds of all jobs in sum, and the largest memory of one.

    Arguments:
        results: the results folder.
        measured: what its jobs took.
    """
    logs = [read_log(path) for path in sorted(Path(results).rglob("log.jsonl"))]
    return {
        "git_revisions": sorted({log.header["tags"].get("git_revision", "unknown") for log in logs}),
        "versions": provenance.versions(),
        "machine": provenance.machine(),
        "job_seconds": round(sum(cost.seconds for cost in measured.values())),
        "peak_memory_mb": round(max((cost.peak_memory_mb for cost in measured.values()), default=0)),
    }

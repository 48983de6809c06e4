"""Copies the tables and figures of a full run, with their provenance, to a folder that is kept."""

from __future__ import annotations

import csv
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path

import yaml

from expertaug.config import load as config
from expertaug.errors import InputError
from expertaug.evaluation.plot import NAMES
from expertaug.evaluation.studies import KINDS
from expertaug.files import write_json, write_text
from expertaug.tracking import provenance
from expertaug.tracking.log_file import read_log

KEPT = ["tables/{0}.csv", "tables/{0}_long.csv", "tables/{0}.md", "tables/{0}.tex"]
KEPT += [f"figures/{{0}}_{name}.png" for name in (*NAMES, "splits")]
KEPT += [f"tables/{{0}}_{name}.{end}" for name in (*KINDS, "grid", "published") for end in ("csv", "md", "tex")]
KEPT += [f"figures/{{0}}_{name}.png" for name in (*KINDS, "grid")]
KEPT += ["{0}/data/splits.json", "{0}/data/calibration.json"]
OVERALL = ["recordings/summary.csv", "recordings/summary.md"]
OVERALL += [f"tables/published.{end}" for end in ("csv", "md", "tex")]
OVERALL += [f"figures/{name}.png" for name in ("log_mse", "parameter_errors", "za_shifted")]


def publish(configs: Sequence[Path], folder: Path, command: str) -> None:
    """Replace ``folder`` by the tables and figures of the finished run of a configuration.

    Besides them it holds config.yaml (the completed configuration), costs.csv (seconds and peak memory of every job)
    and provenance.json (command, git revisions, package versions, machine, jobs' seconds in sum, peak memory).

    Arguments:
        configs: YAML files, later ones win: those of the run.
        folder: target.
        command: how the run was started, for the record.

    Raises:
        InputError: a figure or table of the run is missing.
    """
    settings = config.validate(config.load(configs))
    results, folder = Path(settings["results"]), Path(folder)
    for experiment in settings["run"]:
        for needed in (results / f"tables/{experiment}.md", results / f"figures/{experiment}_log_mse.png"):
            if not needed.exists():
                raise InputError(needed, "no such file", "run the workflow to its end first")
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder.parent) as name:
        new = Path(name) / folder.name
        files = [pattern.format(experiment) for pattern in KEPT for experiment in settings["run"]]
        for file in (*files, *OVERALL):
            if (results / file).exists():
                (new / file).parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(results / file, new / file)
        costs = _costs(results / "benchmarks")
        lines = ["job,seconds,peak_memory_mb", *(f"{job},{seconds:.1f},{memory:.0f}" for job, seconds, memory in costs)]
        write_text(new / "costs.csv", "\n".join(lines) + "\n")
        settings["tracking"]["uri"] = None
        write_text(new / "config.yaml", yaml.safe_dump(settings, sort_keys=False, allow_unicode=True))
        record = {
            "command": command,
            "git_revisions": _revisions(results),
            "versions": provenance.versions(),
            "machine": provenance.machine(),
            "job_seconds": round(sum(seconds for _, seconds, _ in costs)),
            "peak_memory_mb": round(max((memory for *_, memory in costs), default=0)),
        }
        write_json(new / "provenance.json", record)
        if folder.exists():
            shutil.rmtree(folder)
        new.replace(folder)


def _revisions(results: Path) -> list[str]:
    """Git revisions of the code that trained and fine-tuned, as its logs say."""
    logs = [read_log(path) for path in sorted(results.rglob("log.jsonl"))]
    return sorted({log.header["tags"].get("git_revision", "unknown") for log in logs})


def _costs(folder: Path) -> list[tuple[str, float, float]]:
    """Job, seconds and peak resident memory in MB, from Snakemake's benchmark files."""
    found = []
    for path in sorted(folder.rglob("*.tsv")):
        with path.open(encoding="utf-8") as stream:
            row = next(csv.DictReader(stream, delimiter="\t"), None)
        if row is not None:
            memory = 0.0 if row["max_rss"] in ("NA", "-") else float(row["max_rss"])
            found.append((str(path.relative_to(folder).with_suffix("")), float(row["s"]), memory))
    return found

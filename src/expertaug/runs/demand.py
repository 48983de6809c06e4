"""What a run asks of a cluster: jobs, hours and memory of learning and evaluation, by what published runs took."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import yaml
from pydantic import BaseModel, ConfigDict

from expertaug.config import jobs
from expertaug.config.models import Configuration, Experiment
from expertaug.errors import InputError
from expertaug.evaluation import costs
from expertaug.versions import Version

STAGES = ("train", "augment", "finetune", "flow", "evaluate")


class Job(NamedTuple):
    """A job to come: its stage, experiment and version, how much it does, in passes over all samples and seeds, its
    number of seeds and the samples of each set."""

    stage: str
    experiment: str
    variant: str
    work: float
    seeds: int
    sizes: Mapping[str, int]


class Seen(NamedTuple):
    """A job of a published run, and what it took."""

    run: str
    seconds: float
    memory_mb: float
    job: Job


class Row(NamedTuple):
    """A stage's jobs: how many, their hours in sum and the longest's, the largest memory, how many were seen before.

    Hours and memory are nan where no published run has the stage.
    """

    stage: str
    jobs: int
    hours: float
    longest_h: float
    memory_mb: float
    known: int


class _Published(BaseModel):
    """What is read of a published config.yaml, which an earlier version may have written: it may lack keys."""

    model_config = ConfigDict(extra="ignore")


class _PublishedTraining(_Published):
    epochs: int = 1


class _PublishedSet(_Published):
    size: int = 1


class _PublishedData(_Published):
    sets: dict[str, _PublishedSet] = {}


class _PublishedOverride(_Published):
    training: _PublishedTraining | None = None
    finetuning: _PublishedTraining | None = None


class _PublishedExperiment(_PublishedOverride):
    data: _PublishedData
    overrides: dict[str, _PublishedOverride] = {}


class _PublishedRun(_Published):
    experiments: dict[str, _PublishedExperiment]


def of_config(config: Configuration, published: Path) -> list[Row]:
    """What the run of a completed configuration asks for, by stage.

    The same job in a published run is taken as it was: stage, experiment, version, passes, samples, seeds; of several
    runs that which has most of the jobs asked for. Without one, the mean of jobs of the same stage, experiment and
    version, their seconds times the ratio of passes, samples and seeds (an upper bound, as seeds are trained together),
    their memory times that of seeds. Without these, the mean of the stage's jobs in that experiment, else in all.
    Networks of other sizes are not accounted for.

    Raises:
        InputError: the folder holds no published run.
    """
    asked, history = list(_jobs(config)), _read_published(published)
    if not history:
        raise InputError("--published", f"no published run in '{published}'", "give the folder that holds them")
    runs = Counter(seen.run for job in asked for seen in history.get(job[:3], []) if seen.job == job)
    rows = []
    for stage in STAGES:
        each = [_like(job, history, runs) for job in asked if job.stage == stage]
        if each:
            seconds = [estimate[0] for estimate in each]
            memory = max(estimate[1] for estimate in each)
            hours = sum(seconds) / 3600, max(seconds) / 3600
            rows.append(Row(stage, len(each), *hours, memory, sum(estimate[2] for estimate in each)))
    return rows


def table(rows: list[Row]) -> list[str]:
    """The rows as a Markdown table, with their sum."""
    hours, longest_h, memory_mb = zip(*((row.hours, row.longest_h, row.memory_mb) for row in rows), strict=True)
    jobs_of_all, known_jobs = sum(row.jobs for row in rows), sum(row.known for row in rows)
    largest = float(np.nanmax(longest_h)), float(np.nanmax(memory_mb))
    total = Row("all", jobs_of_all, float(np.nansum(hours)), *largest, known_jobs)
    cells = [[r.stage, f"{r.jobs:.0f}", *map(_number, r[2:5]), f"{r.known:.0f}"] for r in (*rows, total)]
    head = ["stage", "jobs", "total [h]", "longest job [h]", "largest memory [MB]", "published before"]
    return [f"| {' | '.join(line)} |" for line in (head, ["---", *["---:"] * 5], *cells)]


def _jobs(config: Configuration) -> Iterator[Job]:
    """The learning and evaluating jobs of a completed configuration."""
    for experiment in config.run:
        versions = [*jobs.variants(config, experiment), *jobs.further_variants(config, experiment)]
        for seeds in jobs.seed_groups(config, experiment).values():
            for variant in versions:
                for stage in _stages(variant):
                    yield _job(config.experiments[experiment], stage, experiment, variant, len(seeds))


def _job(settings: Experiment | _PublishedExperiment, stage: str, experiment: str, variant: str, seeds: int) -> Job:
    sizes = {name: each.size for name, each in (settings.data.sets or {}).items() if each is not None}
    return Job(stage, experiment, variant, _work(settings, stage, variant, seeds), seeds, sizes)


def _stages(variant: str) -> tuple[str, ...]:
    if not Version.parse(variant).is_trained:
        return ("evaluate",)
    if Version.parse(variant).is_flow:
        return ("flow", "evaluate")
    if Version.parse(variant).is_augmented:
        return ("augment", "finetune", "evaluate")
    return ("finetune" if Version.parse(variant).is_control else "train", "evaluate")


def _work(settings: Experiment | _PublishedExperiment, stage: str, variant: str, seeds: int) -> float:
    """Passes times samples times seeds; of stages without passes the seeds alone."""
    block = {"train": "training", "finetune": "finetuning"}.get(stage)
    if block is None:
        return float(seeds)
    whole, over = getattr(settings, block), settings.overrides.get(Version.parse(variant).method)
    own = getattr(over, block, None)
    said = [part.epochs for part in (own, whole) if part is not None and "epochs" in part.model_fields_set]
    train = (settings.data.sets or {}).get("train")
    return float(next(iter(said), 1) * (train.size if train is not None else 1) * seeds)


def _read_published(folder: Path) -> dict[tuple[str, str, str], list[Seen]]:
    """What jobs of every published run took, by stage, experiment and version."""
    history: dict[tuple[str, str, str], list[Seen]] = {}
    for path in sorted(Path(folder).glob("*/config.yaml")):
        run = _PublishedRun.model_validate(yaml.safe_load(path.read_text(encoding="utf-8")))
        for name, cost in costs.read(path.with_name("costs.csv")).items():
            stage, _, rest = name.partition("/")
            experiment = max((e for e in run.experiments if rest.startswith(f"{e}_")), key=len, default=None)
            if stage not in STAGES or experiment is None:
                continue
            variant, _, numbers = rest.removeprefix(f"{experiment}_").partition("_seeds_")
            job = _job(run.experiments[experiment], stage, experiment, variant, len(numbers.split("_")))
            history.setdefault(job[:3], []).append(Seen(path.parent.name, cost.alone_s, cost.peak_memory_mb, job))
    return history


def _like(
    job: Job, history: Mapping[tuple[str, str, str], Sequence[Seen]], runs: Mapping[str, int]
) -> tuple[float, float, bool]:
    """Seconds and memory of a job, and whether one like it is known; ``runs`` says how many of the jobs asked for each
    published run has."""
    own = history.get(job[:3], [])
    if same := [seen for seen in own if seen.job == job]:
        most = max(same, key=lambda seen: runs[seen.run]).run
        own = [seen for seen in same if seen.run == most]
    of_experiment = [c for (s, e, _), each in history.items() if (s, e) == (job.stage, job.experiment) for c in each]
    of_stage = [c for (s, _, _), each in history.items() if s == job.stage for c in each]
    like = own or of_experiment or of_stage
    if not like:
        return math.nan, math.nan, False
    ratios = [job.work / seen.job.work if own else job.seeds / seen.job.seeds for seen in like]
    seconds = sum(seen.seconds * ratio for seen, ratio in zip(like, ratios, strict=True)) / len(like)
    return seconds, max(seen.memory_mb * max(1.0, job.seeds / seen.job.seeds) for seen in like), bool(own)


def _number(value: float) -> str:
    if math.isnan(value):
        return "?"
    return f"{value:.{0 if value >= 100 else 1 if value >= 0.95 else 2}f}"  # half a minute is 0.01 h

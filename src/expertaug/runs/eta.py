"""How long a run will take: costs of a published run, corrected by what has been measured here."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from statistics import median

LEARNING = ("train", "finetune", "flow")  # stages whose costs depend most on the experiment
UNMEASURED_S = 5.0  # a job of a stage that nobody has measured
TRUST_S = 60.0  # of published seconds: a few short jobs, mostly start-up, say little of how fast this host is
_POINT = re.compile(r"@\d+")
_SEEDS = re.compile(r"_seeds_[\d_]+$")


def closest(published: Mapping[str, Mapping[str, float]], jobs: Iterable[str]) -> str | None:
    """The published run that has most of these jobs, None where none has any."""
    jobs = set(map(_without_point, jobs))
    shared = {name: len(jobs & costs.keys()) for name, costs in published.items()}
    best = max(shared, key=shared.__getitem__, default=None)
    return best if best is not None and shared[best] else None


def learns_alike(costs: Iterable[str], jobs: Iterable[str]) -> bool:
    """Whether one of these jobs' learning is among the costs, with any seeds; true where the jobs learn nothing."""
    learning = {_seedless(job) for job in jobs if _stage(job) in LEARNING}
    return not learning or bool(learning & set(map(_seedless, costs)))


def typical(published: Mapping[str, Mapping[str, float]]) -> dict[str, float]:
    """The median cost of each stage's jobs over all published runs, as that of one job of the stage."""
    groups: dict[str, list[float]] = {}
    for costs in published.values():
        for job, seconds in costs.items():
            groups.setdefault(_stage(job), []).append(seconds)
    return {f"{stage}/": median(values) for stage, values in groups.items()}


def estimator(costs: Mapping[str, float], measured: Mapping[str, float]) -> Callable[[str], float]:
    """A function: job → seconds.

    The best that is known counts: the job's own measurement, its published cost (of a grid's point the method's), the
    mean of the same training with other seeds, the mean of the stage; published costs times this host's factor,
    measured to published.
    """
    both = [job for job in measured if costs.get(job)]
    factor = (TRUST_S + sum(measured[job] for job in both)) / (TRUST_S + sum(costs[job] for job in both))
    seconds_of = {job: seconds * factor for job, seconds in costs.items()} | dict(measured)
    means = [_means(seconds_of, without) for without in (_seedless, _stage)]

    def seconds(job: str) -> float:
        likely = [seconds_of.get(job), seconds_of.get(_without_point(job))]
        likely += [mean.get(of(job)) for mean, of in zip(means, (_seedless, _stage), strict=True)]
        return next((value for value in likely if value is not None), UNMEASURED_S)

    return seconds


def stages(jobs: Iterable[str]) -> set[str]:
    """Names of the stages of some jobs."""
    return set(map(_stage, jobs))


def by_stage(jobs: Mapping[str, float]) -> dict[str, dict[str, float]]:
    """The jobs of each stage (see :func:`remaining`)."""
    groups: dict[str, dict[str, float]] = {}
    for job, elapsed in jobs.items():
        groups.setdefault(_stage(job), {})[job] = elapsed
    return groups


def remaining(jobs: Mapping[str, float], seconds: Callable[[str], float], cores: int) -> float:
    """Seconds until all jobs have ended.

    Arguments:
        jobs: those that have not ended, with the seconds that each has been running.
        seconds: see :func:`estimator`.
        cores: jobs that run at a time.
    """
    left = [max(0.0, seconds(job) - elapsed) for job, elapsed in jobs.items()]
    return max(sum(left) / max(1, cores), max(left, default=0.0))


def text(seconds: float) -> str:
    """A duration as one says it: ``40 seconds``, ``82 minutes``, ``3.5 hours``."""
    if seconds < 90:
        return f"{max(10, round(seconds, -1)):.0f} seconds"
    return f"{seconds / 60:.0f} minutes" if seconds < 120 * 60 else f"{seconds / 3600:.1f} hours"


def _means(seconds_of: Mapping[str, float], of: Callable[[str], str]) -> dict[str, float]:
    groups: dict[str, list[float]] = {}
    for job, seconds in seconds_of.items():
        groups.setdefault(of(job), []).append(seconds)
    return {name: sum(values) / len(values) for name, values in groups.items()}


def _seedless(job: str) -> str:
    return _SEEDS.sub("", _without_point(job))


def _without_point(job: str) -> str:
    return _POINT.sub("", job)


def _stage(job: str) -> str:
    return job.partition("/")[0]

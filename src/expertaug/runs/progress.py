"""What a run of the workflow tells while it goes on: how long it will take, and at its end what was refused."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Sequence, Sized
from pathlib import Path
from typing import Any

from expertaug import __version__
from expertaug.evaluation import costs
from expertaug.runs import eta
from expertaug.tracking.settings import tracking_of_run

logger = logging.getLogger("snakemake.logging")  # what is said here is on the terminal and in Snakemake's own log
OTHERS = "others"  # jobs of stages that nobody has measured
_ERROR = " ERROR "  # as expertaug.cli writes it


class Watch(logging.Handler):
    """Listens to the events that Snakemake logs; it changes nothing in the run.

    Arguments:
        results: the results folder.
        published: folder of published runs, whose costs estimate this one's.
        run: names of the run's experiments.
    """

    def __init__(self, results: Path, published: Path, run: Sequence[str] = ()) -> None:
        super().__init__()
        self.logs = Path(results) / "logs"
        self.published, self.run = Path(published), list(run)
        self.began: dict[int, float] = {}
        self.ended: set[int] = set()
        self.failed: dict[int, tuple[str, list[str]]] = {}
        self.dag: Any = None
        self.cores = 1
        self.costs: dict[str, float] = {}

    def start(self, dag, cores: int) -> None:
        """Say what the run will do and how long that will take, and listen from now on.

        Arguments:
            dag: Snakemake's, whose ``needrun_jobs`` are those to come; it may grow when a checkpoint has ended.
            cores: jobs that run at a time.
        """
        self.dag, self.cores = dag, cores
        logger.addHandler(self)
        try:
            estimate = self.first_estimate()
            for line in (f"expertaug {__version__}: {', '.join(self.run)}", *self.plan(), estimate):
                logger.info(line)
        except Exception as error:  # it never ends a run
            logger.warning(f"How long this takes cannot be estimated: {error}")

    def first_estimate(self) -> str:
        """How long the run will take, in one line."""
        jobs, published = self.jobs(), costs.read_published(self.published)
        name = eta.closest(published, jobs)
        cores = f"{self.cores} core{'s' * (self.cores > 1)}"
        if not published and not self.measured():
            return f"{count(jobs)} on {cores}; the time left is estimated once some have ended."
        if name is not None and eta.learns_alike(published[name], jobs):
            self.costs, source = dict(published[name]), f" (by the costs of the published run '{name}')"
        else:  # the toy run has jobs of every run, such as its report: it says nothing of how long others train
            self.costs, source = eta.typical(published), " (a guess: no published run has these experiments)"
        unknown = eta.stages(jobs) - self.known()
        about = "At least" if unknown else "About"
        return f"{about} {self.left(jobs)} for {count(jobs)} on {cores}{source}."

    def plan(self) -> list[str]:
        """How many jobs each stage has and how long they will take, the longest first; nothing where there is one."""
        jobs = self.jobs()
        seconds, known_stages, by_stage = eta.estimator(self.costs, self.measured()), self.known(), eta.by_stage(jobs)
        times = {
            stage: eta.remaining(by_stage[stage], seconds, self.cores) for stage in by_stage if stage in known_stages
        }
        rows = [
            (stage.replace("_", " "), count(by_stage[stage]), f"about {eta.text(times[stage])}")
            for stage in sorted(times, key=times.__getitem__, reverse=True)
        ]
        if others := [stage for stage in by_stage if stage not in known_stages]:
            names = ", ".join(sorted(stage.replace("_", " ") for stage in others))
            rows.append(
                (OTHERS, count([job for stage in others for job in by_stage[stage]]), f"cost not known: {names}")
            )
        width = max((len(name) for name, _, _ in rows), default=0)
        lines = [f"  {name:{width}}  {jobs_of:>8}  {said}" for name, jobs_of, said in rows]
        return ["What is to be done:", *lines] if len(by_stage) > 1 else []

    def jobs(self) -> dict[str, float]:
        """Jobs that have not ended, called as in costs.csv, with the seconds that each has been running."""
        now, left = time.monotonic(), {}
        for job in self.dag.needrun_jobs():
            if not job.rule.norun and job.jobid not in self.ended:
                left[self.called(job)] = now - self.began.get(job.jobid, now)
        return left

    def measured(self) -> dict[str, float]:
        """Seconds by job of what has been run in this results folder."""
        return {job: cost.seconds for job, cost in costs.of_run(self.logs).items()}

    def known(self) -> set[str]:
        """Stages of which a job has been measured, here or in the published run."""
        return eta.stages([*self.costs, *self.measured()])

    def left(self, jobs: dict[str, float]) -> str:
        """How long these jobs will take, as a text."""
        seconds = eta.estimator(self.costs, self.measured())
        return eta.text(eta.remaining(jobs, seconds, self.cores))

    def emit(self, record: logging.LogRecord) -> None:
        try:
            said: Any = record  # what Snakemake adds to it depends on the event
            event = getattr(said, "event", None)
            if event == "job_started":
                self.began |= dict.fromkeys(said.jobs, time.monotonic())
            elif event == "job_finished":
                self.ended.add(said.job_id)
                self.failed.pop(said.job_id, None)  # it went well when it was tried again
            elif event == "job_error":
                rule = said.rule_name or self.rule_of(said.jobid)
                self.failed[said.jobid] = rule, [str(path) for path in said.log]
            elif event == "progress" and (jobs := self.jobs()):
                logger.info(f"About {self.left(jobs)} left for {count(jobs)}.")
        except Exception:  # it never ends a run
            self.handleError(record)

    def where_to_look(self) -> list[str]:
        """Where the results of a run that went well are, and how the dashboard is opened; a line each."""
        results = self.logs.parent
        places = {"Report": "report.html", "Tables": "tables", "Figures": "figures"}
        said = [f"{name}: {results / place}" for name, place in places.items() if (results / place).exists()]
        tracking = tracking_of_run(results)
        if tracking is not None and tracking.experiments:
            command = f" {tracking.command}, then" if tracking.command else ""
            pages = [f"  {name}: {tracking.page_of(name)}" for name in tracking.experiments]
            said += [f"Dashboard:{command}", *pages]
        return said

    def refusals(self) -> list[str]:
        """One line for each job that failed: what it said last, and where its log lies."""
        return [_say(rule, logs) for rule, logs in self.failed.values()]

    def rule_of(self, jobid: int) -> str:
        """The name of a job's rule; Snakemake does not tell it of a job that was stopped."""
        return next((job.rule.name for job in self.dag.jobs if job.jobid == jobid), "a job")

    def called(self, job) -> str:
        """A job as costs.csv calls it."""
        return Path(str(job.log[0])).relative_to(self.logs).with_suffix("").as_posix()


def cancel_timers() -> None:
    """Cancel Snakemake's timers, each of which would look for jobs once more: a process ends when all of its threads
    have, and these took ten seconds after everything had been said."""
    for thread in threading.enumerate():
        if isinstance(thread, threading.Timer):
            thread.cancel()


def count(jobs: Sized) -> str:
    """How many jobs there are, as a text."""
    return "1 job" if len(jobs) == 1 else f"{len(jobs)} jobs"


def _say(rule: str, logs: list[str]) -> str:
    path = next((path for path in map(Path, logs) if path.is_file()), None)
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines() if path else []
    at = next((k for k in reversed(range(len(lines))) if _ERROR in lines[k]), None)
    if at is None:
        said = f"{rule}: ended without a word (killed, or short of memory?)"
    else:
        said = lines[at].partition(_ERROR)[2]
        if at + 1 < len(lines):  # a traceback: its last line says what happened
            said = f"{said}: {lines[-1].strip()}"
    return f"{said} (log: {path})" if path else said

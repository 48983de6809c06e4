"""The stage during_training: scores of a model at several stages of its training, before and after fine-tuning."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from torch import Tensor

from expertaug.evaluation.score import Scored, score
from expertaug.evaluation.settings import DuringTrainingJob, Scoring
from expertaug.learning import snapshots
from expertaug.learning.during_training import BASE, ModelState, kept_states
from expertaug.learning.job import lock_job
from expertaug.models.store import device_of
from expertaug.rows import write_csv
from expertaug.tracking.log import Run
from expertaug.tracking.metrics_csv import MetricRow
from expertaug.tracking.run_log import RunLog
from expertaug.tracking.settings import Tracking
from expertaug.trajectories import SetFolder, Trajectories
from expertaug.versions import MAIN_SETS

LOGGED = ("finetune_epochs", "augment", "finetune", "evaluation", "choices")  # of the job, in the log


def run_stage(
    file: Path, data: Path, output: Path, work: Path, job: DuringTrainingJob, tracking: Tracking | None
) -> None:
    """Stage: write the metrics of every snapshot of a training and of its augmented, fine-tuned versions.

    Arguments:
        file: states along a training (:mod:`expertaug.learning.snapshots`).
        data: folder of the sets.
        output: CSV as of the stage evaluate, with the columns epoch (passes of training) and finetune_epochs (0 = as
            trained).
        work: folder for checkpoints.
        tracking: as of :class:`expertaug.tracking.run_log.RunLog`; the log, during_training.jsonl beside ``output``,
            has the metrics with the passes of training as step.
    """
    card, epochs = snapshots.read_card(file), snapshots.passes(file)
    settings = job.to_json()
    run = Run(
        experiment=job.experiment,
        method=job.method,
        label=job.label,
        preset=job.preset,
        system=card.system_name,
        stage="during_training",
        seeds=tuple(card.seeds),
        params={"epochs": epochs} | {name: settings[name] for name in LOGGED},
    )
    device, rows = device_of(job.device), []
    with (
        lock_job(work),  # an orphan may still be writing the log
        RunLog(Path(output).with_name("during_training.jsonl"), run, tracking) as log,
    ):
        for name in MAIN_SETS:
            log.dataset(name, Path(data) / f"{name}.npz")
        models = kept_states(file, data, work, job.augment, job.finetune, job.finetune_epochs, device)
        for scores in score_states(models, SetFolder(data), job):
            rows += scores.rows(job)
            for name, scored in scores.of_sets.items():
                log.metrics(scores.state.epoch, _name_metrics(name, scores.state.finetune_epochs, scored))
            log.flush()  # the next fine-tuning may take hours
        write_csv(Path(output), MetricRow, rows)
        log.artifact(output)


@dataclass(frozen=True)
class StateScores:
    """The scores of a model at a stage of its training, by set."""

    state: ModelState
    of_sets: Mapping[str, Scored]

    def rows(self, job: DuringTrainingJob) -> list[MetricRow]:
        """The metrics of each seed and set."""
        stored, passes = self.state.stored, (self.state.epoch, self.state.finetune_epochs)
        identity = (job.experiment, stored.card.system_name, job.method, job.label, job.preset)
        return [
            MetricRow(*identity, seed, name, metric, value, *passes)
            for name, scored in self.of_sets.items()
            for metric, seed, value in scored.of_seeds(stored.seeds)
        ]


def during_training(
    models: Iterable[ModelState], sets: Mapping[str, Trajectories], job: DuringTrainingJob
) -> list[MetricRow]:
    """The metrics of a model at several stages of its training, and of what fine-tuning makes of it there: what the
    table and the figure of the study show (:func:`expertaug.evaluation.studies.study`).

    Arguments:
        models: each is needed but once; of a training's snapshots, :func:`expertaug.learning.during_training.states`.
        sets: train, validation and test.
    """
    return [row for scores in score_states(models, sets, job) for row in scores.rows(job)]


def score_states(
    models: Iterable[ModelState], sets: Mapping[str, Trajectories], job: DuringTrainingJob
) -> Iterator[StateScores]:
    """The scores of each model before the next is asked for; arguments are those of :func:`during_training`."""
    device, scoring = device_of(job.device), Scoring.of_forecasts(job.evaluation)
    samples = {name: sets[name].spread(scoring.max_samples) for name in MAIN_SETS}  # no more than is scored
    for state in models:
        of_sets = {
            name: score(state.stored, truth, scoring, job.choices.forecast_start, device)
            for name, truth in samples.items()
        }
        yield StateScores(state, of_sets)


def _name_metrics(name: str, finetuned: int, scored: Scored) -> dict[str, Tensor]:
    """A set's metrics, (S,) each, as ``set/metric`` and, after fine-tuning, ``set/metric_finetuned_10``."""
    end = "" if finetuned == BASE else f"_finetuned_{finetuned}"
    return {f"{name}/{metric}{end}": value for metric, value in scored.values.items()}

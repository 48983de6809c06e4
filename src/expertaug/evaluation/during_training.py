"""The stage during_training: scores of a model at several stages of its training, before and after fine-tuning."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from torch import Tensor

from expertaug.evaluation.score import Scored, score
from expertaug.evaluation.settings import DuringTrainingJob, Scoring
from expertaug.learning import snapshots as states
from expertaug.learning.during_training import BASE, stages
from expertaug.learning.job import locked
from expertaug.models.store import StoredModel, device_of
from expertaug.rows import write_csv
from expertaug.tracking.log import Run
from expertaug.tracking.metrics_csv import MetricRow
from expertaug.tracking.run_log import RunLog
from expertaug.tracking.settings import Tracking
from expertaug.trajectories import SetFolder, Trajectories
from expertaug.versions import MAIN_SETS

LOGGED = ("finetune_epochs", "augment", "finetune", "evaluation", "choices")  # of the job, in the log


def run_stage(
    snapshots: Path, data: Path, output: Path, work: Path, job: DuringTrainingJob, tracking: Tracking | None
) -> None:
    """Stage: write the metrics of every snapshot of a training and of its augmented, fine-tuned versions.

    Arguments:
        snapshots: states along a training (:mod:`expertaug.learning.snapshots`).
        data: folder of the sets.
        output: CSV as of the stage evaluate, with the columns epoch (passes of training) and finetune_epochs (0 = as
            trained).
        work: folder for checkpoints.
        tracking: as of :class:`expertaug.tracking.run_log.RunLog`; the log, during_training.jsonl beside ``output``,
            has the metrics with the passes of training as step.
    """
    device, sets = device_of(job.device), SetFolder(data)
    samples = {name: sets[name].spread(job.evaluation.max_samples) for name in MAIN_SETS}  # no more than is scored
    card, epochs = states.read_card(snapshots), states.passes(snapshots)
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
    with (
        locked(work),  # an orphan may still be writing the log
        RunLog(Path(output).with_name("during_training.jsonl"), run, tracking) as log,
    ):
        for name in MAIN_SETS:
            log.dataset(name, Path(data) / f"{name}.npz")
        models = stages(snapshots, data, work, job.augment, job.finetune, job.finetune_epochs, device)
        write_csv(Path(output), MetricRow, during_training(models, samples, job, log))
        log.artifact(output)


def during_training(
    models: Iterable[tuple[int, int, StoredModel]],
    sets: Mapping[str, Trajectories],
    job: DuringTrainingJob,
    log: RunLog | None = None,
) -> list[MetricRow]:
    """The metrics of a model at several stages of its training, and of what fine-tuning makes of it there.

    Arguments:
        models: passes of training, passes of fine-tuning (0 = as trained) and the model: each is needed but once.
        sets: train, validation and test.
        log: gets the metrics of each model as soon as it is scored.
    """
    device, scoring = device_of(job.device), Scoring.of_forecasts(job.evaluation)
    samples = {name: sets[name].spread(scoring.max_samples) for name in MAIN_SETS}
    rows = []
    for epoch, finetuned, stored in models:
        identity = (job.experiment, stored.card.system_name, job.method, job.label, job.preset)
        for name, truth in samples.items():
            scored = score(stored, truth, scoring, job.choices.forecast_start, device)
            rows += [
                MetricRow(*identity, seed, name, metric, value, epoch, finetuned)
                for metric, seed, value in scored.of_seeds(stored.seeds)
            ]
            if log is not None:
                log.metrics(epoch, _named(name, finetuned, scored))
        if log is not None:
            log.flush()  # the next fine-tuning may take hours
    return rows


def _named(name: str, finetuned: int, scored: Scored) -> dict[str, Tensor]:
    """A set's metrics, (S,) each, as ``set/metric`` and, after fine-tuning, ``set/metric_finetuned_10``."""
    end = "" if finetuned == BASE else f"_finetuned_{finetuned}"
    return {f"{name}/{metric}{end}": value for metric, value in scored.values.items()}

"""The stage during_training: scores of a model at several stages of its training, before and after fine-tuning."""

from __future__ import annotations

from pathlib import Path

from torch import Tensor

from expertaug.evaluation.score import Scored, score
from expertaug.evaluation.settings import DuringTrainingJob, Scoring
from expertaug.learning import snapshots as states
from expertaug.learning.during_training import BASE, stages
from expertaug.learning.job import locked
from expertaug.models.store import device_of
from expertaug.rows import write_csv
from expertaug.tracking.log import Run
from expertaug.tracking.metrics_csv import MetricRow
from expertaug.tracking.run_log import RunLog
from expertaug.tracking.settings import Tracking
from expertaug.trajectories import Trajectories
from expertaug.versions import MAIN_SETS

LOGGED = ("finetune_epochs", "augment", "finetune", "evaluation", "choices")  # of the job, in the log


def during_training(
    snapshots: Path, data: Path, output: Path, work: Path, job: DuringTrainingJob, tracking: Tracking | None
) -> None:
    """Write the metrics of every snapshot of a training and of its augmented, fine-tuned versions.

    Arguments:
        snapshots: states along a training (:mod:`expertaug.learning.snapshots`).
        data: folder of the sets.
        output: CSV as of the stage evaluate, with the columns epoch (passes of training) and finetune_epochs (0 = as
            trained).
        work: folder for checkpoints.
        tracking: as of :class:`expertaug.tracking.run_log.RunLog`; the log, during_training.jsonl beside ``output``,
            has the metrics with the passes of training as step.
    """
    device, scoring = device_of(job.device), Scoring.of_forecasts(job.evaluation)
    sets = {name: Trajectories.load(Path(data) / f"{name}.npz") for name in MAIN_SETS}
    sets = {name: whole.spread(scoring.max_samples) for name, whole in sets.items()}
    card, epochs = states.read_card(snapshots), states.passes(snapshots)
    identity = (job.experiment, card.system_name, job.method, job.label, job.preset)
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
    rows = []
    with (
        locked(work),  # an orphan may still be writing the log
        RunLog(Path(output).with_name("during_training.jsonl"), run, tracking) as log,
    ):
        for name in MAIN_SETS:
            log.dataset(name, Path(data) / f"{name}.npz")
        every = stages(snapshots, data, work, job.augment, job.finetune, job.finetune_epochs, device)
        for epoch, finetuned, stored in every:
            for name, truth in sets.items():
                scored = score(stored, truth, scoring, job.choices.forecast_start, device)
                rows += [
                    MetricRow(*identity, seed, name, metric, value, epoch, finetuned)
                    for metric, seed, value in scored.of_seeds(stored.seeds)
                ]
                log.metrics(epoch, _named(name, finetuned, scored))
            log.flush()  # the next fine-tuning may take hours
        write_csv(Path(output), MetricRow, rows)
        log.artifact(output)


def _named(name: str, finetuned: int, scored: Scored) -> dict[str, Tensor]:
    """A set's metrics, (S,) each, as ``set/metric`` and, after fine-tuning, ``set/metric_finetuned_10``."""
    end = "" if finetuned == BASE else f"_finetuned_{finetuned}"
    return {f"{name}/{metric}{end}": value for metric, value in scored.values.items()}

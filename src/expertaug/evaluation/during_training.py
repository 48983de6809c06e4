"""The stage during_training: scores of a model at several stages of its training, before and after fine-tuning."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pandas as pd
from torch import Tensor

from expertaug.evaluation.score import Scored, score, spread
from expertaug.files import atomic
from expertaug.learning import snapshots as states
from expertaug.learning.during_training import BASE, stages
from expertaug.learning.job import locked
from expertaug.learning.settings import AugmentJob, FinetuneJob
from expertaug.models.store import device_of
from expertaug.tracking.log import Run
from expertaug.tracking.metrics_csv import COLUMNS
from expertaug.tracking.run_log import RunLog
from expertaug.tracking.settings import Tracking
from expertaug.trajectories import Trajectories
from expertaug.versions import MAIN_SETS


def during_training(
    snapshots: Path, data: Path, output: Path, work: Path, settings: Mapping, tracking: Tracking | None
) -> None:
    """Write the metrics of every snapshot of a training and of its augmented, fine-tuned versions.

    Arguments:
        snapshots: states along a training (:mod:`expertaug.learning.snapshots`).
        data: folder of the sets.
        output: CSV as of the stage evaluate, with the columns epoch (passes of training) and finetune_epochs (0 = as
            trained).
        work: folder for checkpoints.
        settings: {experiment, method, label, preset, augment, finetune, finetune_epochs, evaluation, choices, seeds,
            device}: settings of the stages augment, finetune and evaluate, and the lengths of the fine-tunings.
        tracking: as of :class:`expertaug.tracking.run_log.RunLog`; the log, during_training.jsonl beside ``output``,
            has the metrics with the passes of training as step.
    """
    device = device_of(settings["device"])
    drawing = AugmentJob.from_mapping(settings["augment"], "--settings.augment")
    tuning = FinetuneJob.from_mapping(settings["finetune"], "--settings.finetune")
    lengths = settings["finetune_epochs"]
    options = settings["evaluation"]
    sets = {name: Trajectories.load(Path(data) / f"{name}.npz") for name in MAIN_SETS}
    sets = {name: spread(found, options.get("max_samples")) for name, found in sets.items()}
    card, epochs = states.read_card(snapshots), states.passes(snapshots)
    identity = {k: settings[k] for k in ("experiment", "method", "label", "preset")}
    identity["system"] = card.system_name
    params = {k: settings[k] for k in ("finetune_epochs", "augment", "finetune", "evaluation", "choices")}
    run = Run(**identity, stage="during_training", seeds=card.seeds, params={"epochs": epochs} | params)
    rows = []
    with (
        locked(work),  # an orphan may still be writing the log
        RunLog(Path(output).with_name("during_training.jsonl"), run, tracking) as log,
    ):
        for name in MAIN_SETS:
            log.dataset(name, Path(data) / f"{name}.npz")
        for epoch, finetuned, stored in stages(snapshots, data, work, drawing, tuning, lengths, device):
            place = {"epoch": epoch, "finetune_epochs": finetuned}
            for name, truth in sets.items():
                scored = score(stored, truth, options, settings["choices"]["forecast_start"], device)
                rows += scored.rows(identity | place | {"set": name}, stored.seeds)
                log.metrics(epoch, _named(name, finetuned, scored))
            log.flush()  # the next fine-tuning may take hours
        with atomic(output) as temporary:
            pd.DataFrame(rows)[[*COLUMNS, "epoch", "finetune_epochs"]].to_csv(temporary, index=False)
        log.artifact(output)


def _named(name: str, finetuned: int, scored: Scored) -> dict[str, Tensor]:
    """A set's metrics, (S,) each, as ``set/metric`` and, after fine-tuning, ``set/metric_finetuned_10``."""
    end = "" if finetuned == BASE else f"_finetuned_{finetuned}"
    return {f"{name}/{metric}{end}": value for metric, value in scored.values.items()}

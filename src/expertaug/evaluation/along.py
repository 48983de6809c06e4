"""The stage along: scores of a model at several stages of its training, before and after fine-tuning."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from expertaug.evaluation.evaluate import MAIN_SETS, score, spread
from expertaug.files import atomic
from expertaug.learning.along import stages
from expertaug.loglines import COLUMNS
from expertaug.models.device import device_of
from expertaug.types import Trajectories


def along(snapshots: Path, data: Path, output: Path, work: Path, settings: Mapping) -> None:
    """Write the metrics of every snapshot of a training and of its augmented, fine-tuned versions.

    Arguments:
        snapshots: states along a training (:mod:`expertaug.learning.snapshots`).
        data: folder of the sets.
        output: CSV as of the stage evaluate, with the columns epoch (passes of training) and finetune_epochs (0 = as
            trained).
        work: folder for checkpoints.
        settings: {experiment, method, label, preset, augment, finetune, finetune_epochs, evaluation, choices, seeds,
            device}: settings of the stages augment, finetune and evaluate, and the lengths of the fine-tunings.
    """
    device = device_of(settings["device"])
    options = settings["evaluation"]
    sets = {name: Trajectories.load(Path(data) / f"{name}.npz") for name in MAIN_SETS}
    sets = {name: spread(found, options.get("max_samples")) for name, found in sets.items()}
    identity = {k: settings[k] for k in ("experiment", "method", "label", "preset")}
    rows = []
    for epoch, finetuned, stored in stages(snapshots, data, work, settings, device):
        place = {"epoch": epoch, "finetune_epochs": finetuned, "system": stored.description["system"]["name"]}
        for name, truth in sets.items():
            scored = score(stored, truth, options, settings["choices"]["forecast_start"], device)
            rows += scored.rows(identity | place | {"set": name}, stored.seeds)
    with atomic(output) as temporary:
        pd.DataFrame(rows)[[*COLUMNS, "epoch", "finetune_epochs"]].to_csv(temporary, index=False)

"""Augmenting a model at several stages of its training (paper, figure augmentation_along_training)."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path

import torch

from expertaug.learning import augment, finetune, snapshots
from expertaug.learning.job import fingerprint
from expertaug.learning.settings import AugmentJob, FinetuneJob, named_modules
from expertaug.models import store

BASE = 0  # as the length of a fine-tuning: the snapshot itself


def stages(
    file: Path,
    data: Path,
    work: Path,
    drawing: AugmentJob,
    tuning: FinetuneJob,
    lengths: Sequence[int],
    device: torch.device,
) -> Iterator[tuple[int, int, store.StoredModel]]:
    """Every snapshot, and what fine-tunings of several lengths make of it: (pass, passes of fine-tuning, model).

    Each fine-tuning is a run of the stages augment and finetune, with a schedule of its own.  A killed run goes on:
    what it has finished stays in ``work``, which is removed at the end.

    Arguments:
        file: snapshots of a training.
        data: folder of the sets.
        work: folder for models and checkpoints; the caller holds its lock.
        drawing, tuning: settings of the two stages.
        lengths: passes of each fine-tuning.
    """
    file, work, classes = Path(file), Path(work), tuning.classes or ()
    inputs = [file, *(Path(data) / f"{name}.npz" for name in ("train", "validation"))]
    used = {"augment": drawing.to_json(), "finetune": tuning.to_json(), "finetune_epochs": list(lengths)}
    card = snapshots.read_card(file)
    named = named_modules(card.system_name, card.model.to_json(), card.objective)
    folder = work / fingerprint(used, inputs, [__name__, *named])[:16]
    for other in work.glob("*"):  # of other settings, code or data
        if other != folder:
            shutil.rmtree(other)
    for epoch, stored in snapshots.load(file, device, classes).items():
        yield epoch, BASE, stored
        model, augmented = folder / f"{epoch}/model.safetensors", folder / f"{epoch}/augmented.safetensors"
        if not augmented.exists():
            store.save(model, stored.model, stored.card)
            augment.run_stage(model, data, augmented, drawing)
        for count in lengths:
            tuned = folder / f"{epoch}_{count}/model.safetensors"
            if not tuned.exists():
                training = tuning.training.model_copy(update={"epochs": count})
                options = tuning.model_copy(update={"training": training})
                finetune.run_stage(model, augmented, data, tuned, tuned.with_name("work"), options, None)
            yield epoch, count, store.load(tuned, device, classes)
    shutil.rmtree(work)

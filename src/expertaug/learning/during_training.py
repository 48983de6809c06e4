"""Augmenting a model at several stages of its training (paper, figure augmentation_along_training)."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import torch

from expertaug.learning import augment, finetune, snapshots
from expertaug.learning.augment import Augmented
from expertaug.learning.job import Job, fingerprint
from expertaug.learning.settings import AugmentJob, FinetuneJob, named_modules
from expertaug.learning.trainer import Progress
from expertaug.learning.training_data import set_files
from expertaug.models import store
from expertaug.models.store import StoredModel
from expertaug.settings import given_ranges
from expertaug.trajectories import Trajectories

BASE = 0  # as the length of a fine-tuning: the snapshot itself


@dataclass(frozen=True)
class ModelState:
    """A model at a stage of its training.

    Attributes:
        epoch: passes of training.
        finetune_epochs: passes of fine-tuning after them; 0 as trained.
        stored: the model.
    """

    epoch: int
    finetune_epochs: int
    stored: StoredModel


class Steps:
    """From snapshots of a training to fine-tuned models, in memory.

    Arguments:
        train, validation: the sets of the training.
    """

    def __init__(self, train: Trajectories, validation: Trajectories) -> None:
        self.train, self.validation = train, validation

    def augment(self, base: ModelState, drawing: AugmentJob) -> Augmented:
        """A snapshot's D⁺."""
        prior, how = given_ranges(drawing.prior), (drawing.noise, drawing.choices, drawing.worst)
        return augment.augment(base.stored, self.train, self.validation, prior, *how, base.stored.where)

    def finetune(
        self, base: ModelState, plus: Augmented, options: FinetuneJob, progress: Progress | None = None
    ) -> StoredModel:
        """What fine-tuning makes of a snapshot."""
        return finetune.finetune(base.stored, plus, self.train, self.validation, options, progress)


class KeptSteps(Steps):
    """The same, each kept in files, from which a killed run goes on.

    Arguments:
        folder: for models, augmented samples and checkpoints.
        data: folder of the sets.
    """

    def __init__(self, folder: Path, data: Path) -> None:
        self.folder, self.sets = folder, set_files(data)
        super().__init__(*map(Trajectories.load, self.sets))

    def augment(self, base: ModelState, drawing: AugmentJob) -> Augmented:
        model, augmented = self._files(base)
        if not augmented.exists():
            store.save(model, base.stored.model, base.stored.card)
            augment.save(augmented, super().augment(base, drawing))
        return augment.load(augmented, base.stored.device, torch.tensor(base.stored.card.t))

    def finetune(
        self, base: ModelState, plus: Augmented, options: FinetuneJob, progress: Progress | None = None
    ) -> StoredModel:
        tuned = self.folder / f"{base.epoch}_{options.training.epochs}/model.safetensors"
        if not tuned.exists():
            inputs = [*self._files(base), *self.sets]
            settings = finetune.inherit_options(base.stored, plus, options)
            with Job(tuned, tuned.with_name("work"), inputs, settings, None, finetune.__name__) as job:
                job.write(super().finetune(base, plus, settings, job))
        return store.load(tuned, base.stored.device, options.classes or ())

    def _files(self, base: ModelState) -> tuple[Path, Path]:
        """Of a snapshot and of its D⁺."""
        return self.folder / f"{base.epoch}/model.safetensors", self.folder / f"{base.epoch}/augmented.safetensors"


def states(
    trained: Iterable[ModelState], steps: Steps, drawing: AugmentJob, tuning: FinetuneJob, lengths: Sequence[int]
) -> Iterator[ModelState]:
    """Every snapshot of a training, and what fine-tunings of several lengths make of it, each with a schedule of its
    own.

    Arguments:
        trained: the snapshots.
        drawing, tuning: how D⁺ is drawn, and how models are fine-tuned.
        lengths: passes of each fine-tuning.
    """
    for base in trained:
        yield base
        plus = steps.augment(base, drawing)
        for count in lengths:
            training = tuning.training.model_copy(update={"epochs": count})
            options = tuning.model_copy(update={"training": training})
            yield ModelState(base.epoch, count, steps.finetune(base, plus, options))


def kept_states(
    file: Path,
    data: Path,
    work: Path,
    drawing: AugmentJob,
    tuning: FinetuneJob,
    lengths: Sequence[int],
    device: torch.device,
) -> Iterator[ModelState]:
    """As :func:`states`, of files.  A killed run goes on: what it has finished stays in ``work``, which is removed at
    the end.

    Arguments:
        file: snapshots of a training.
        data: folder of the sets.
        work: folder for models and checkpoints; the caller holds its lock.
    """
    file, work, classes = Path(file), Path(work), tuning.classes or ()
    used = {"augment": drawing.to_json(), "finetune": tuning.to_json(), "finetune_epochs": list(lengths)}
    card = snapshots.read_card(file)
    named = named_modules(card.system_name, card.model.to_json(), card.objective)
    folder = work / fingerprint(used, [file, *set_files(data)], [__name__, *named])[:16]
    for other in work.glob("*"):  # of other settings, code or data
        if other != folder:
            shutil.rmtree(other)
    kept = snapshots.load(file, device, classes).items()
    trained = (ModelState(epoch, BASE, stored) for epoch, stored in kept)
    yield from states(trained, KeptSteps(folder, Path(data)), drawing, tuning, lengths)
    shutil.rmtree(work)

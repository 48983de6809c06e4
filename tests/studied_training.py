"""A training with snapshots and what a study of it asks, as the tests of both share them."""

from __future__ import annotations

import torch

from expertaug.evaluation import during_training as following
from expertaug.evaluation.settings import DuringTrainingJob, ForecastScoring
from expertaug.learning import snapshots
from expertaug.learning.during_training import ModelState, Steps, states
from expertaug.learning.settings import AugmentJob, FinetuneJob, TrainSettings
from expertaug.learning.train import run_stage as train
from expertaug.models import store
from expertaug.trajectories import Trajectories
from tiny import PRIOR, of_kind

CPU = torch.device("cpu")


def run(data, folder, settings):
    train(data, folder / "model.safetensors", folder / "work", settings, None)
    return store.load(folder / "model.safetensors").model.state_dict()


def study_of(settings):
    training = TrainSettings(epochs=9, batch_size=20)
    return of_kind(
        DuringTrainingJob,
        settings,
        augment=of_kind(AugmentJob, settings, method="aphynity+", prior=PRIOR, noise=0.01),
        finetune=of_kind(FinetuneJob, settings, method="aphynity+", label="APHYNITY+", training=training),
        finetune_epochs=[1, 2],
        evaluation=ForecastScoring(max_samples=7),
    )


def in_memory(snapshots_file, data, settings):
    """The rows of a study's job, without a file of its own."""
    trained = [ModelState(k, 0, stored) for k, stored in snapshots.load(snapshots_file, CPU).items()]
    sets = {name: Trajectories.load(data / f"{name}.npz") for name in ("train", "validation", "test")}
    steps = Steps(sets["train"], sets["validation"])
    models = states(trained, steps, settings.augment, settings.finetune, settings.finetune_epochs)
    return following.during_training(models, sets, settings)

"""A trained pendulum and its augmented samples, as the tests of augmentation and of fine-tuning share them."""

from __future__ import annotations

import pytest
import torch

from expertaug.learning import augment as augmentation
from expertaug.learning.augment import run_stage as augment
from expertaug.learning.settings import AugmentJob
from expertaug.learning.train import run_stage as train
from tiny import PRIOR, SETTINGS, but, of_kind

CPU = torch.device("cpu")
PLUS = {"method": "aphynity+", "label": "APHYNITY+"}
TIMES = torch.arange(31) * 0.1


@pytest.fixture(scope="session")
def trained(data, tmp_path_factory):
    folder = tmp_path_factory.mktemp("trained")
    train(data, folder / "model.safetensors", folder / "work", SETTINGS, None)
    return folder / "model.safetensors"


def augmented(trained, data, folder, settings, worst=None, **choices):
    job = of_kind(AugmentJob, settings, prior=PRIOR, noise=0.01, choices=but(settings.choices, **choices))
    augment(trained, data, folder / "plus.st", job if worst is None else but(job, worst=worst))
    plus = augmentation.load(folder / "plus.st", CPU, TIMES)
    return plus.train, plus.validation, plus.drawing.to_json()

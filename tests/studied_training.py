"""A training, as the tests of its snapshots and of what is made of them share it."""

from __future__ import annotations

import torch

from expertaug.learning.train import run_stage as train
from expertaug.models import store

CPU = torch.device("cpu")


def run(data, folder, settings):
    train(data, folder / "model.safetensors", folder / "work", settings, None)
    return store.load(folder / "model.safetensors").model.state_dict()

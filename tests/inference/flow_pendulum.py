"""A trained pendulum, and the flow that is asked of it, as the tests of flows share them."""

from __future__ import annotations

import pytest
import torch
from known_posterior import COMMON, asked

import tiny
from expertaug.learning.settings import Build, TrainJob, TrainSettings
from expertaug.learning.train import run_stage as train
from expertaug.models.settings import PartsSettings
from expertaug.systems.settings import SolverSettings
from tiny import but

PENDULUM = asked({"omega0": (0.5, 3.5)}, 0.01)


def windows(data, points, seeds):
    y = torch.from_numpy(data.y).movedim(0, 1)[:points, None]
    return y.expand(-1, seeds, *y.shape[2:]).contiguous()


@pytest.fixture(scope="session")
def pendulum(tmp_path_factory):
    """Folder of a pendulum's sets and of the models ``both`` (seeds 0 and 1) and ``alone`` (seed 1)."""
    folder = tmp_path_factory.mktemp("pendulum")
    sets = dict.fromkeys(("train", "validation", "test"), tiny.swings(40))
    tiny.simulated(folder, tiny.DATA.model_copy(update={"sets": sets}))
    windows = {"theta": [0.0, 1.0], "omega": [0.0, 1.0]}
    job = TrainJob(
        **COMMON,
        method="aphynity",
        label="APHYNITY",
        system={"name": "pendulum"},
        build=Build(kind="hybrid"),
        model=PartsSettings(
            encoder={"kind": "window", "windows": windows, "layers": [8], "latent": 3},
            interaction={"kind": "mlp", "layers": [6]},
        ),
        training=TrainSettings(epochs=1, batch_size=10, solver=SolverSettings(method="rk4")),
        t1_s=1.0,
    )
    for name, seeds in (("both", [0, 1]), ("alone", [1])):
        train(folder, folder / f"{name}.safetensors", folder / name, but(job, seeds=seeds), None)
    return folder

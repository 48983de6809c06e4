"""What the tests of inference share: tiny pendulums, and a system whose posterior is known."""

from __future__ import annotations

import pytest
import torch
from known_posterior import COMMON, NOISE, Line
from tiny import data, settings  # noqa: F401

from expertaug.learning.train import prepare, train
from expertaug.models.describe import describe
from expertaug.models.recipe import HybridModel
from expertaug.models.store import StoredModel
from expertaug.systems.simulate import simulate
from expertaug.trajectories import Trajectories

SETS = {"z_e": {"omega0": [1.5, 3.1]}, "z_a": {"alpha": [0.0, 0.6]}}


@pytest.fixture(scope="session")
def lines() -> tuple[StoredModel, Trajectories]:
    """An expert of lines (one seed, no interaction) and its training set: starts and slopes are standard normal."""
    random = torch.Generator().manual_seed(0)
    t = torch.linspace(0, 1, 5, dtype=torch.float64)
    y0, slope = torch.randn(2, 400, 1, generator=random, dtype=torch.float64)
    y = y0 + slope * t + NOISE * torch.randn(400, 5, generator=random, dtype=torch.float64)
    data = Trajectories(t.numpy(), y.unsqueeze(-1).numpy(), slope.numpy())
    recipe = HybridModel(Line(), {"kind": "recurrent", "hidden": 2, "layers": [2]}, None)
    told = COMMON | {"method": "line", "label": "Line", "objective": "aphynity", "t1_s": 1.0, "seeds": [0]}
    made = prepare(recipe, data, data, told | {"training": {"solver": {"method": "rk4"}}}, describe(recipe))
    return StoredModel(made.trainer.model, {**made.description, "wall_s": 0.0, "failed": []}), data


@pytest.fixture(scope="session")
def pendulum(tmp_path_factory):
    """Folder of a pendulum's sets and of the models ``both`` (seeds 0 and 1) and ``alone`` (seed 1)."""
    folder = tmp_path_factory.mktemp("pendulum")
    data = {"seed": 0, "step_s": 0.1, "t2_s": 2.0, "noise": 0.01}
    data["sets"] = {name: SETS | {"size": 40} for name in ("train", "validation", "test")}
    for name in data["sets"]:
        simulate(name, folder / f"{name}.npz", {"system": {"name": "pendulum"}, "data": data})
    told = COMMON | {"method": "aphynity", "label": "APHYNITY", "t1_s": 1.0, "system": {"name": "pendulum"}}
    told |= {"build": {"kind": "hybrid"}, "training": {"epochs": 1, "batch_size": 10, "solver": {"method": "rk4"}}}
    windows = {"theta": [0.0, 1.0], "omega": [0.0, 1.0]}
    told["model"] = {
        "encoder": {"kind": "window", "windows": windows, "layers": [8], "latent": 3},
        "interaction": {"kind": "mlp", "layers": [6]},
    }
    for name, seeds in (("both", [0, 1]), ("alone", [1])):
        train(folder, folder / f"{name}.safetensors", folder / name, told | {"seeds": seeds}, None)
    return folder

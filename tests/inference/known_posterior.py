"""A system whose posterior is known, and what the tests of inference have in common."""

import torch
from torch import Tensor

from expertaug.inference.settings import FlowJob, FlowSettings
from expertaug.learning.settings import TrainOptions, TrainSettings
from expertaug.learning.train import prepare
from expertaug.models.describe import describe
from expertaug.models.hybrid import HybridModel
from expertaug.models.store import StoredModel
from expertaug.presets import resolve
from expertaug.systems import Parameter, System
from expertaug.systems.settings import SolverSettings
from expertaug.trajectories import Trajectories

COMMON = {"experiment": "toy", "preset": "corrected", "choices": resolve("corrected"), "seeds": [0]}
NOISE = 0.3  # of the lines


class Line(System):
    """dy/dt = z_e: windows are straight lines, and least squares knows the posterior."""

    state = (Parameter("y"),)
    expert_parameters = (Parameter("slope", positive=False),)

    def expert(self, t: Tensor, y: Tensor, z_e: Tensor) -> Tensor:
        return z_e.expand_as(y)


def lines() -> tuple[StoredModel, Trajectories]:
    """An expert of lines (one seed, no interaction) and its training set: starts and slopes are standard normal."""
    random = torch.Generator().manual_seed(0)
    t = torch.linspace(0, 1, 5, dtype=torch.float64)
    y0, slope = torch.randn(2, 400, 1, generator=random, dtype=torch.float64)
    y = y0 + slope * t + NOISE * torch.randn(400, 5, generator=random, dtype=torch.float64)
    data = Trajectories(t.numpy(), y.unsqueeze(-1).numpy(), slope.numpy())
    recipe = HybridModel(Line(), {"kind": "recurrent", "hidden": 2, "layers": [2]}, None)
    training = TrainSettings(solver=SolverSettings(method="rk4"))
    how = TrainOptions(**COMMON, method="line", label="Line", t1_s=1.0, training=training)
    made = prepare(recipe, data, data, how, describe(recipe))
    return StoredModel(made.trainer.model, made.card.but(wall_s=0.0, failed=[])), data


SMALL = {
    "steps": 12,
    "batch_size": 20,
    "pool": 80,
    "uses": 2,
    "held_out": 50,
    "layers": [16],
    "summary": 8,
    "transforms": 1,
    "hidden": [8],
    "latent": 2,
    "samples": 8,
    "checkpoint_s": 0.0,
    "solver": SolverSettings(method="rk4"),
}


def asked(prior, noise, **flow):
    how = FlowSettings(**SMALL | flow)
    return FlowJob(**COMMON, method="a+~flow", label="A+ flow", prior=prior, noise=noise, flow=how)

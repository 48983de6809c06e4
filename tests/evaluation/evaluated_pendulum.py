"""Tiny trained pendulums, and what an evaluation is asked of them."""

from __future__ import annotations

import pytest

import tiny
from expertaug.evaluation.settings import EvaluateJob, Scoring
from expertaug.learning.settings import Build, SolverOnly, TrainSettings, UntrainedJob
from expertaug.learning.train import run_stage as train
from expertaug.models.settings import PartsSettings
from expertaug.presets import Choices
from expertaug.systems.settings import SimulatedData
from tiny import but, of_kind

SETS = dict.fromkeys(("train", "validation", "iid", "test"), tiny.swings(12))
DATA = SimulatedData(seed=0, step_s=0.1, t2_s=2.0, noise=0.0, sets=SETS)
SEEDS = [4, 7]
ENCODER, INTERACTION = {"kind": "recurrent", "hidden": 4, "layers": [4]}, {"kind": "mlp", "layers": [4, 4]}
TRAINING = but(
    tiny.SETTINGS,
    seeds=SEEDS,
    model=PartsSettings(encoder=ENCODER, interaction=INTERACTION),
    training=TrainSettings(epochs=1, batch_size=6),
)
MEAN = of_kind(
    UntrainedJob,
    TRAINING,
    method="mean",
    label="Mean",
    build=Build(kind="mean"),
    model=PartsSettings(),
    training=SolverOnly(),
)


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    folder = tiny.simulated(tmp_path_factory.mktemp("evaluate"), DATA)
    train(folder, folder / "model.safetensors", folder / "work", TRAINING, None)
    train(folder, folder / "mean.safetensors", folder / "work", MEAN, None)
    agnostic = but(TRAINING, method="ml_only", label="ML only", build=Build(kind="hybrid", expert=False))
    train(folder, folder / "ml_only.safetensors", folder / "work", agnostic, None)
    return folder


def asked(method="a", label="a", evaluation=None, start="y0", seeds=SEEDS, **sets):
    return EvaluateJob(
        experiment="pendulum",
        method=method,
        label=label,
        preset="corrected",
        choices=Choices(forecast_start=start),
        seeds=seeds,
        evaluation=evaluation or Scoring(),
        **sets,
    )

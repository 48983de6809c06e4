"""A system and an objective outside the package: nothing but their file and the configuration is needed."""

from __future__ import annotations

import sys
from pathlib import Path

import pandas as pd
import pytest
import yaml

from expertaug.config import jobs, stage_settings
from expertaug.config import load as config
from expertaug.errors import InputError
from expertaug.systems.settings import SimulateJob
from expertaug.systems.simulate import simulate
from typed_jobs import augment, evaluate, finetune, train

SYSTEM = """
import torch
from expertaug.systems.base import Parameter, System


class Duffing(System):
    state = (Parameter("x", "m"), Parameter("v", "m/s"))
    expert_parameters = (Parameter("k", "1/s^2"), Parameter("b", "1/(m s)^2"))
    interaction_parameters = (Parameter("c", "1/s"),)

    def expert(self, t, y, z_e):
        (x, v), (k, b) = y.unbind(-1), z_e.unbind(-1)
        return torch.stack((v, -k * x - b * x**3), dim=-1)

    def truth(self, t, y, z_e, z_a):
        drag = z_a[..., 0] * y[..., 1]
        return self.expert(t, y, z_e) - torch.stack((torch.zeros_like(drag), drag), dim=-1)

    def sample_initial_state(self, n, generator):
        return 2 * torch.rand(n, 2, generator=generator, dtype=torch.float64) - 1
"""
OBJECTIVE = """
from expertaug.learning.objectives import Aphynity


class Scaled(Aphynity):
    def __init__(self, seeds, choices, factor=1.0, **carried):
        super().__init__(seeds, choices, **carried)
        self.factor = factor

    def loss(self, model, batch, task):
        loss, parts = super().loss(model, batch, task)
        return self.factor * loss, parts
"""
EXPERIMENT = """
seeds: [0]
run: [oscillator]
methods: {own: {kind: hybrid, label: Own, objective: "fifth.objective:Scaled"}}
experiments:
  oscillator:
    system: {name: fifth.duffing}
    data:
      source: simulation
      step_s: 0.1
      t1_s: 1.0
      t2_s: 2.0
      sets:
        train: &set {size: 20, z_e: {k: [1.0, 2.0], b: [0.5, 1.0]}, z_a: {c: [0.0, 0.5]}}
        validation: *set
        test: {size: 20, z_e: {k: [2.0, 4.0], b: [1.0, 2.0]}, z_a: {c: [0.0, 0.5]}}
    model:
      encoder: {kind: window, windows: {x: [0.0, 1.0], v: [0.0, 1.0]}, layers: [8, 8], latent: 1}
      interaction: {kind: mlp, layers: [8], components: [v]}
    training: {epochs: 1, batch_size: 10, objective: {factor: 2.0}}
    augmentation: {prior: {k: [1.0, 4.0], b: [0.5, 2.0]}}
    finetuning: {epochs: 1, batch_size: 10}
    methods: [own]
    augmented: [own]
"""


@pytest.fixture
def fifth(tmp_path, monkeypatch) -> Path:
    """A package elsewhere that Python finds."""
    folder = tmp_path / "fifth"
    folder.mkdir()
    (folder / "__init__.py").touch()
    (folder / "duffing.py").write_text(SYSTEM)
    (folder / "objective.py").write_text(OBJECTIVE)
    monkeypatch.syspath_prepend(tmp_path)
    for name in [name for name in sys.modules if name.partition(".")[0] == "fifth"]:  # of the test before
        monkeypatch.delitem(sys.modules, name)
    return folder


def valid(text: str = EXPERIMENT) -> dict:
    base = config.load([Path(__file__).parents[1] / "config" / "config.yaml"])
    return config.validate(config.merge(base, yaml.safe_load(text)))


def test_it_is_simulated_trained_augmented_and_evaluated(fifth, tmp_path):
    whole = valid()
    group = next(iter(jobs.seed_groups(whole)))
    model, samples, tuned = (tmp_path / f"{name}.safetensors" for name in ("model", "samples", "tuned"))
    for name in ("train", "validation", "test"):
        job = SimulateJob.from_mapping(stage_settings.simulate(whole, "oscillator", name))
        simulate(name, tmp_path / f"{name}.npz", job)
    train(tmp_path, model, tmp_path / "work", stage_settings.train(whole, "oscillator", "own", group), None)
    augment(model, tmp_path, samples, stage_settings.augment(whole, "oscillator", "own+", group))
    settings = stage_settings.finetune(whole, "oscillator", "own+", group)
    finetune(model, samples, tmp_path, tuned, tmp_path / "work+", settings, None)
    settings = stage_settings.evaluate(whole, "oscillator", "own+", group)
    evaluate(tuned, tmp_path, tmp_path / "metrics.csv", tmp_path / "forecasts.npz", settings)
    table = pd.read_csv(tmp_path / "metrics.csv")
    assert {"relative_error_k", "relative_error_b"} <= set(table["metric"])
    assert set(table["label"]) == {"Own+"}


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("def expert(", "def expart(", "the class Duffing does not define expert; a System needs it"),
        ("def truth(", "def true(", "the class Duffing does not define truth"),
        ("expert_parameters =", "parameters =", "the class Duffing does not define expert_parameters"),
        ("class Duffing", "class First(System): ...\nclass Duffing", "fifth.duffing defines 2 systems"),
        ("class Duffing(System)", "class Duffing(", r"duffing\.py:\d+: no Python"),
        ('"k"', '"stiffness"', r"sets\.train\.z_e: names k, b; give a range .* of the system fifth\.duffing: stiff"),
        ('"c"', '"drag"', r"sets\.train\.z_a: names c; .*: drag"),
    ],
)
def test_what_a_system_lacks_is_one_line_before_any_job(fifth, old, new, expected):
    (fifth / "duffing.py").write_text(SYSTEM.replace(old, new, 1))
    with pytest.raises(InputError, match=expected):
        valid()


def test_an_objective_without_loss_is_refused(fifth):
    bare = OBJECTIVE.replace("Aphynity", "Objective").replace("def loss", "def less")
    (fifth / "objective.py").write_text(bare)
    with pytest.raises(InputError, match=r"methods\.own\.objective: the class Scaled does not define loss"):
        valid()

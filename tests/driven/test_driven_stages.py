"""A driven system from outside the package through the workflow's stages; what its configuration may not say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch
import yaml

from expertaug.config import jobs, stage_settings
from expertaug.config import load as config
from expertaug.errors import InputErrors
from expertaug.learning.augment import load as load_augmented
from expertaug.runs.own_classes import check_classes
from expertaug.systems.settings import SimulateJob
from expertaug.systems.simulate import simulate
from typed_jobs import augment, evaluate, finetune, train

EXPERIMENT = """
seeds: [0]
run: [oscillator]
experiments:
  oscillator:
    system: {name: "own_systems:Duffing"}
    data:
      source: simulation
      step_s: 0.1
      t1_s: 1.0
      t2_s: 2.0
      sets:
        train: &set
          size: 20
          z_e: {k: [1.0, 2.0], b: [0.5, 1.0]}
          z_a: {c: [0.0, 0.5]}
          inputs: {A: [0.0, 2.0], w: [0.5, 3.0], mass: [1.0, 2.0]}
        validation: *set
        test:
          size: 20
          z_e: {k: [2.0, 4.0], b: [1.0, 2.0]}
          z_a: {c: [0.0, 0.5]}
          inputs: {A: [2.0, 3.0], w: [0.5, 3.0], mass: [1.0, 2.0]}
    model:
      encoder: {kind: window, windows: {x: [0.0, 1.0], force: [0.0, 1.0], mass: [0.0, 0.0]}, layers: [8, 8], latent: 1}
      interaction: {kind: mlp, layers: [8], components: [v], inputs: true, time: true}
    training: {epochs: 1, batch_size: 10}
    augmentation: {prior: {k: [1.0, 4.0], b: [0.5, 2.0]}}
    finetuning: {epochs: 1, batch_size: 10}
    methods: [aphynity, least_squares, mean]
    augmented: [aphynity]
"""
BALL = """
run: [ball]
experiments:
  ball:
    system: {name: bouncing_ball, observed: height}
    data:
      source: simulation
      step_s: 0.1
      t1_s: 1.0
      t2_s: 2.0
      sets: {train: &set {size: 4, z_e: {g: [8, 12], e: [0.6, 0.9]}, z_a: {k: [0, 0.1]}}, validation: *set, test: *set}
    model: {encoder: {kind: recurrent}, interaction: {kind: mlp}}
    training: {epochs: 1}
    augmentation: {prior: {g: [8, 12], e: [0.6, 0.9]}}
    methods: [aphynity]
"""
METHODS = """
methods:
  aphynity: {kind: hybrid, label: APHYNITY}
  least_squares: {kind: least_squares, label: Least squares}
  neural_ode: {kind: hybrid, label: Neural ODE, expert: false}
  mean: {kind: mean, label: Mean}
"""


def valid(*texts: str) -> dict:
    whole = config.load([Path(__file__).parents[2] / "config" / "config.yaml"])
    for text in (METHODS, *texts):
        whole = config.merge(whole, yaml.safe_load(text))
    return config.validate(whole)


@pytest.mark.slow
def test_it_is_simulated_trained_augmented_and_evaluated(tmp_path):
    whole = valid(EXPERIMENT)
    check_classes(whole)
    group = next(iter(jobs.seed_groups(whole)))
    model, samples, tuned = (tmp_path / f"{name}.safetensors" for name in ("model", "samples", "tuned"))
    for name in ("train", "validation", "test"):
        job = SimulateJob.from_mapping(stage_settings.simulate(whole, "oscillator", name))
        simulate(name, tmp_path / f"{name}.npz", job)
    for method, output in (("aphynity", model), ("least_squares", tmp_path / "ls"), ("mean", tmp_path / "mean")):
        train(tmp_path, output, tmp_path / "work", stage_settings.train(whole, "oscillator", method, group), None)
    augment(model, tmp_path, samples, stage_settings.augment(whole, "oscillator", "aphynity+", group))
    u = np.load(tmp_path / "train.npz")["u"]
    plus = load_augmented(samples, "cpu", torch.arange(200) * 0.1).train
    assert np.array_equal(plus.u[:, 0].movedim(1, 0), u[:, : len(plus.y)])
    settings = stage_settings.finetune(whole, "oscillator", "aphynity+", group)
    finetune(model, samples, tmp_path, tuned, tmp_path / "work+", settings, None)
    for variant, file in (("aphynity+", tuned), ("least_squares", tmp_path / "ls"), ("mean", tmp_path / "mean")):
        settings = stage_settings.evaluate(whole, "oscillator", variant, group) | {"classes": ["own_systems:Duffing"]}
        evaluate(file, tmp_path, tmp_path / "metrics.csv", tmp_path / "forecasts.npz", settings)
        table = pd.read_csv(tmp_path / "metrics.csv")
        assert np.isfinite(table["value"]).all() and set(table["set"]) == {"train", "validation", "test"}


@pytest.mark.parametrize(
    ("texts", "change", "expected"),
    [
        ([EXPERIMENT], "{data: {sets: {test: {inputs: {B: [0, 1]}}}}}", "sets.test.inputs: names A, w, mass, B"),
        ([EXPERIMENT], "{model: {encoder: {windows: {torque: [0, 1]}}}}", "'torque' is no component of the state"),
        ([BALL], "{model: {interaction: {inputs: true}}}", "interaction.inputs: the system has no known inputs"),
        ([BALL], "{data: {sets: {test: {inputs: {A: [0, 1]}}}}}", "sets.test.inputs: names A"),
        ([BALL], "{evaluation: {solver: {method: dopri5}}}", "evaluation.solver.method: 'dopri5' steps over the"),
        ([BALL], "{evaluation: {draws_solver: {method: ab5}}}", "evaluation.draws_solver.method: 'ab5' steps over the"),
        ([BALL], "{system: {observed: all}}", "'aphynity' is trained by gradients, and what the system observes jumps"),
        ([BALL], "{methods: [neural_ode]}", "'neural_ode' has no expert, who alone knows the system's events"),
    ],
)  # fmt: skip
def test_what_a_configuration_may_not_say_is_one_line(texts, change, expected):
    name = "oscillator" if texts == [EXPERIMENT] else "ball"
    valid(*texts)
    with pytest.raises(InputErrors) as found:
        valid(*texts, f"experiments: {{{name}: {change}}}")
    assert expected in str(found.value), str(found.value)


def test_a_ball_of_heights_passes_its_checks():
    assert any("method aphynity checked" in line for line in check_classes(valid(BALL)))

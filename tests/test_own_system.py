"""A system with runaways, outside the package: predator and prey whose predators need time for what they eat.

The expert is that of Lotka and Volterra; in truth the predator's appetite saturates (Holling's type II).  A learned
term that is a little wrong makes such populations explode, and the shifted test set is there to show it.
"""

from __future__ import annotations

from pathlib import Path

import yaml

from expertaug.config import load as config
from expertaug.config import stage_settings
from expertaug.config.jobs import variants
from expertaug.evaluation.evaluate import evaluate
from expertaug.evaluation.plot import plot
from expertaug.evaluation.tables import tabulate
from expertaug.learning.augment import augment
from expertaug.learning.finetune import finetune
from expertaug.learning.train import train
from expertaug.systems.simulate import simulate

SYSTEM = '''
"""Predator and prey (Lotka 1925; Volterra 1926), in truth with a saturating appetite (Holling 1959)."""

import torch
from expertaug.systems.base import Parameter, System


class LotkaVolterra(System):
    """dx/dt = a x − b x y, dy/dt = −c y + d x y; in truth b and d are divided by 1 + h x.

    Arguments:
        b, d: what an encounter costs the prey and brings the predator, in 1/s.
    """

    state = (Parameter("x"), Parameter("y"))
    expert_parameters = (Parameter("a", "1/s"), Parameter("c", "1/s"))
    interaction_parameters = (Parameter("h"),)

    def __init__(self, b: float = 0.5, d: float = 0.5) -> None:
        self.b, self.d = b, d

    def expert(self, t, y, z_e):
        return self._rates(y, z_e, 1.0)

    def truth(self, t, y, z_e, z_a):
        return self._rates(y, z_e, 1 / (1 + z_a[..., 0] * y[..., 0]))

    def sample_initial_state(self, n, generator):
        return 1 + 3 * torch.rand(n, 2, generator=generator, dtype=torch.float64)

    def _rates(self, y, z_e, appetite):
        (prey, predator), (a, c) = y.unbind(-1), z_e.unbind(-1)
        eaten = appetite * prey * predator
        return torch.stack((a * prey - self.b * eaten, self.d * eaten - c * predator), dim=-1)
'''
EXPERIMENT = """
seeds: [0, 1]
seeds_per_job: 2
run: [predation]
experiments:
  predation:
    system: {name: own.predation}
    data:
      source: simulation
      step_s: 0.1
      t1_s: 5.0
      t2_s: 15.0
      sets:
        train: &set {size: 100, z_e: {a: [0.5, 1.0], c: [0.3, 0.7]}, z_a: {h: [0.0, 0.1]}}
        validation: &held {size: 30, z_e: {a: [0.5, 1.0], c: [0.3, 0.7]}, z_a: {h: [0.0, 0.1]}}
        test: {size: 30, z_e: {a: [1.0, 1.5], c: [0.7, 1.2]}, z_a: {h: [0.0, 0.1]}}
    model:
      encoder: {kind: window, windows: {x: [0.0, 5.0], y: [0.0, 5.0]}, layers: [64, 64], latent: 1}
      interaction: {kind: mlp, layers: [32, 32]}
    training: {epochs: 20, batch_size: 20}
    augmentation: {prior: {a: [0.5, 1.5], c: [0.3, 1.2]}}
    finetuning: {epochs: 10, batch_size: 20}
    methods: [expert_only, aphynity]
    augmented: [aphynity]
"""
NAME = "predation"


def run(out: Path) -> list[str]:
    """Every stage of the experiment; the variants of its methods."""
    base = config.load([Path(__file__).parents[1] / "config/config.yaml"])
    whole = config.validate(config.merge(base, yaml.safe_load(EXPERIMENT)))
    group = next(iter(stage_settings.seed_groups(whole)))
    for name in ("train", "validation", "test"):
        simulate(name, out / f"{name}.npz", stage_settings.simulate(whole, NAME, name))
    every = variants(whole, NAME)
    for variant in every:
        folder, model = out / variant, out / variant / "model.safetensors"
        if variant.endswith("+"):
            before, plus = out / variant.rstrip("+") / "model.safetensors", folder / "augmented.safetensors"
            augment(before, out, plus, stage_settings.augment(whole, NAME, variant, group))
            settings = stage_settings.finetune(whole, NAME, variant, group)
            finetune(before, plus, out, model, folder / "work", settings, None)
        else:
            train(out, model, folder / "work", stage_settings.train(whole, NAME, variant, group), None)
        settings = stage_settings.evaluate(whole, NAME, variant, group)
        evaluate(model, out, folder / "metrics.csv", folder / "forecasts.npz", settings, None)
    metrics, forecasts, logs = ([out / v / f for v in every] for f in ("metrics.csv", "forecasts.npz", "log.jsonl"))
    outputs = [out / f"table.{end}" for end in ("md", "csv", "tex")] + [out / "table_long.csv"]
    tabulate(metrics, outputs, stage_settings.tabulate(whole, NAME), forecasts)
    plot(metrics, forecasts, logs, out / "figure", stage_settings.plot(whole, NAME))
    return every

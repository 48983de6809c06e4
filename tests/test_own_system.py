"""A system with runaways, outside the package: predator and prey whose predators need time for what they eat.

The expert is that of Lotka and Volterra; in truth the predator's appetite saturates (Holling's type II).  A learned
term that is a little wrong makes such populations explode, and the shifted test set is there to show it.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch
import yaml

from expertaug.config import jobs, report_parameters, stage_settings
from expertaug.config import load as config
from expertaug.config.jobs import variants
from expertaug.evaluation import evaluate as evaluating
from expertaug.evaluation.plot import NAMES
from expertaug.evaluation.plot import run_stage as plot
from expertaug.evaluation.settings import EvaluateJob, PlotJob, Scoring, TabulateJob
from expertaug.evaluation.tabulate import run_stage as tabulate
from expertaug.models import store
from expertaug.presets import Choices
from expertaug.systems.settings import SimulateJob
from expertaug.systems.simulate import simulate
from expertaug.tracking.log import read_log
from typed_jobs import augment, evaluate, finetune, train

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
        train: &set {size: 60, z_e: {a: [0.5, 1.0], c: [0.3, 0.7]}, z_a: {h: [0.0, 0.1]}}
        validation: &held {size: 20, z_e: {a: [0.5, 1.0], c: [0.3, 0.7]}, z_a: {h: [0.0, 0.1]}}
        test: {size: 20, z_e: {a: [1.0, 1.5], c: [0.7, 1.2]}, z_a: {h: [0.0, 0.1]}}
    model:
      encoder: {kind: window, windows: {x: [0.0, 5.0], y: [0.0, 5.0]}, layers: [32, 32], latent: 1}
      interaction: {kind: mlp, layers: [16, 16]}
    training: {epochs: 15, batch_size: 15}
    augmentation: {prior: {a: [0.5, 1.5], c: [0.3, 1.2]}}
    finetuning: {epochs: 5, batch_size: 15}
    methods: [expert_only, aphynity]
    augmented: [aphynity]
"""
NAME = "predation"


def run(out: Path) -> list[str]:
    """Every stage of the experiment; the variants of its methods."""
    base = config.load([Path(__file__).parents[1] / "config/config.yaml"])
    whole = config.validate(config.merge(base, yaml.safe_load(EXPERIMENT)))
    group = next(iter(jobs.seed_groups(whole)))
    for name in ("train", "validation", "test"):
        job = SimulateJob.from_mapping(stage_settings.simulate(whole, NAME, name))
        simulate(name, out / f"{name}.npz", job)
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
        evaluate(model, out, folder / "metrics.csv", folder / "forecasts.npz", settings)
    metrics, forecasts, logs = ([out / v / f for v in every] for f in ("metrics.csv", "forecasts.npz", "log.jsonl"))
    outputs = [out / f"table.{end}" for end in ("md", "csv", "tex")] + [out / "table_long.csv"]
    tabulate(metrics, outputs, TabulateJob.from_mapping(report_parameters.tabulate(whole, NAME)), forecasts)
    job = PlotJob.from_mapping(report_parameters.plot(whole, NAME))
    plot(out / "table_long.csv", forecasts, logs, out / "figure", job)
    return every


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """That of a run, with the system's class."""
    (tmp_path / "own").mkdir()
    (tmp_path / "own/__init__.py").touch()
    (tmp_path / "own/predation.py").write_text(SYSTEM)
    monkeypatch.syspath_prepend(tmp_path)
    for name in [name for name in sys.modules if name.partition(".")[0] == "own"]:
        monkeypatch.delitem(sys.modules, name)
    return tmp_path


def test_the_truth_is_that_of_holling():
    """At x = 10 and h = 0.1 a predator eats half of what it would without a limit."""
    space: dict = {}
    exec(SYSTEM, space)
    system = space["LotkaVolterra"]()
    y, z_e = torch.tensor([10.0, 2.0]), torch.tensor([1.0, 0.5])
    assert system.expert(None, y, z_e).tolist() == [0.0, 9.0]
    assert system.truth(None, y, z_e, torch.tensor([0.1])).tolist() == [5.0, 4.0]


@pytest.mark.slow
def test_a_run_of_it_to_its_tables(folder):
    """One test, since a run takes half a minute."""
    every = run(folder)
    every_cell_is_there(folder, every)
    what_it_learned_beats_what_it_began_with(folder, every)
    a_model_that_explodes_is_scored_like_the_others(folder)


def every_cell_is_there(folder, every):
    assert every == ["expert_only", "aphynity", "aphynity+"]
    table = pd.read_csv(folder / "table.csv").set_index("method")
    metrics = ["log_mse_sum", "log_mse_median", "log_mse_observed", "relative_error", "runaway_share"]
    for name in ("train", "validation", "test"):
        assert np.isfinite(table[[f"{name}/{metric}/mean" for metric in metrics]]).all(axis=None)
        assert (table[[f"{name}/{metric}/n" for metric in metrics]] == 2).all(axis=None)
    text = (folder / "table.md").read_text()
    rows = [line for line in text.split("Choice by validation")[0].splitlines() if line.startswith("| ")]
    assert len(rows) == 5 and not re.search(r"–|nan|not finite", "".join(rows[2:]))
    assert {f"figure_{name}.png" for name in NAMES} <= {path.name for path in folder.iterdir()}


def what_it_learned_beats_what_it_began_with(folder, every):
    """With the defaults of training: every seed has a score, and its errors fall."""
    for variant in every:
        stored = store.load(folder / variant / "model.safetensors", classes=["own.predation"])
        assert stored.failed == [] and np.isfinite(stored.card.best_score).all()
        losses = [line.metrics["loss"] for line in read_log(folder / variant / "log.jsonl").steps]
        assert np.isfinite(losses).all()
    scores = [line.metrics["validation_score"] for line in read_log(folder / "aphynity/log.jsonl").steps]
    assert (np.min(scores, axis=0) < np.array(scores[0]) - 0.5).all()


def a_model_that_explodes_is_scored_like_the_others(folder):
    """A thousand prey and as many predators appear in every second: all of one seed's forecasts leave the bound."""
    stored = store.load(folder / "aphynity/model.safetensors", classes=["own.predation"])
    last = stored.model.interaction.rest.layers[-1]
    last.bias.data[1] = 1e3
    store.save(folder / "wild/model.safetensors", stored.model, stored.card)
    job = EvaluateJob(
        experiment=NAME,
        method="wild",
        label="Wild",
        preset="corrected",
        choices=Choices(forecast_start="y0"),
        seeds=[0, 1],
        evaluation=Scoring(),
        classes=["own.predation"],
    )
    paths = folder / "wild/metrics.csv", folder / "wild/forecasts.npz"
    evaluating.run_stage(folder / "wild/model.safetensors", folder, *paths, job)
    values = pd.read_csv(paths[0]).set_index(["seed", "set", "metric"])["value"]
    assert values[1, "test", "runaway_share"] == 1 and np.isfinite(values).all()
    as_trained = pd.read_csv(folder / "aphynity/metrics.csv").set_index(["seed", "set", "metric"])["value"]
    key = (0, "test", "log_mse_median")
    assert values[key] == pytest.approx(as_trained[key], abs=0.01), "the other seed is what it was"

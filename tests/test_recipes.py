"""The recipes of CONTRIBUTING.md, each followed in a copy of the checkout: the files that it names, and no other.

Those of a metric and of an estimator are tried where these are tested (tests/evaluation/test_metrics.py,
tests/inference/test_estimator_kinds.py).
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

import warm_python

ROOT = Path(__file__).parents[1]
COPIED = ("src/expertaug", "src/expertaug_recordings", "src/snakemake_logger_plugin_expertaug", "workflow", "config")
SYSTEM = '''"""A mass on a spring whose friction is hidden."""

import torch

from expertaug.systems.base import Parameter, System


class Spring(System):
    """x'' = −k x − c x'."""

    state = (Parameter("x", "m"), Parameter("v", "m/s"))
    expert_parameters = (Parameter("k", "1/s^2"),)
    interaction_parameters = (Parameter("c", "1/s"),)

    def expert(self, t, y, z_e):
        return torch.cat((y[..., 1:], -z_e * y[..., :1]), -1)

    def truth(self, t, y, z_e, z_a):
        return self.expert(t, y, z_e) - torch.cat((torch.zeros_like(z_a), z_a * y[..., 1:]), -1)

    def sample_initial_state(self, n, generator):
        return 1 + torch.rand(n, 2, generator=generator, dtype=torch.float64)
'''
ENCODER = '''"""Encoder of the window's mean."""

from torch import nn

from expertaug.models.networks.layers import MLP, feature_count
from expertaug.models.posterior import Delta, Posterior, constrain
from expertaug.models.settings import MeanSettings, configure_by


@configure_by(MeanSettings)
class MeanEncoder(nn.Module):
    """A network of the mean of the observed states.

    Arguments:
        times: of the observed window, unused.
    """

    stackable = True
    head_prefix = "head."

    def __init__(self, system, times, **options):
        super().__init__()
        own = MeanSettings.of(**options)
        self.system, self.latent = system, own.latent
        self.head = MLP(feature_count(system, "model.encoder.kind"), own.layers, own.latent + 1)

    def fit(self, observed):
        """Nothing to learn from the data before training."""

    def forward(self, observed):
        found = self.head(self.system.features(observed).mean(0))
        z_e, z_a = found[..., :1], found[..., 1:]
        return Posterior(Delta(constrain(z_e, self.system.expert_parameters)), Delta(z_a))
'''
STUDY = '''"""The stage count: how many windows each version has forecast."""

import pandas as pd

from expertaug.evaluation.forecasts import Forecasts
from expertaug.evaluation.table import Study, Table
from expertaug.evaluation.windows import windows_of


def run_stage(forecasts, outputs, job):
    """Stage: write the table."""
    count(map(Forecasts.load, forecasts), job).save(outputs)


def count(forecasts, job):
    """The table."""
    versions = windows_of(forecasts)
    numbers = pd.DataFrame({"method": list(versions), "sets": [len(one.sets) for one in versions.values()]})
    rows = [[job.label_of.get(method, method), str(sets)] for method, sets in numbers.itertuples(index=False)]
    return Study(numbers, [Table(["method", "sets"], [("", rows)])])
'''


class Checkout:
    """A copy of the checkout."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        for name in COPIED:
            shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
        shutil.copy(ROOT / "Snakefile", folder)

    def write(self, path: str, text: str) -> None:
        (self.folder / path).write_text(text, encoding="utf-8")

    def insert(self, path: str, before: str, text: str) -> None:
        """Text before the first place where something stands."""
        whole = (self.folder / path).read_text(encoding="utf-8")
        assert before in whole, f"{path} no longer has {before!r}"
        self.write(path, whole.replace(before, text + before, 1))

    def configure(self, block: str) -> None:
        """``my.yaml``: a little run of the pendulum, with this block of its experiment."""
        little = "methods: [mean, aphynity], augmented: [], augmentations: {narrow: null, wide: null}, seeds: [0]"
        experiment = f"experiments: {{pendulum: {{{little}, {block}}}}}"
        self.write("my.yaml", f"run: [pendulum]\nresults: results/mine\n{experiment}\n")

    def run(self, *command: object) -> str:
        done = subprocess.run(
            [warm_python.interpreter(), "-m", *map(str, command)],
            cwd=self.folder,
            env=os.environ | {"PYTHONPATH": str(self.folder / "src"), "PATH": warm_python.path()},
            capture_output=True,
            text=True,
            timeout=240,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout + done.stderr

    def settings(self, *command: str) -> list[dict]:
        """Settings of the jobs that a run of ``my.yaml`` plans, of those whose command has these words."""
        said = self.run("snakemake", "-n", "-p", "--cores", "1", "--configfile", "my.yaml")
        lines = [line for line in said.splitlines() if all(word in line for word in ("expertaug", *command))]
        return [json.loads(re.search(r"--settings '(\{.*?\})' ", line)[1]) for line in lines]


@pytest.fixture
def checkout(tmp_path) -> Checkout:
    return Checkout(tmp_path / "checkout")


def test_a_system(checkout):
    checkout.write("src/expertaug/systems/spring.py", SYSTEM)
    settings = '''class SpringSettings(SystemSettings):
    """A mass on a spring."""

    STATE = ("x", "v")
    EXPERT = ("k",)
    INTERACTION = ("c",)

    name: Literal["spring"] = key("spring", "a mass on a spring")


'''
    checkout.insert("src/expertaug/systems/settings.py", "class UserSystemSettings", settings)
    checkout.write(
        "my.yaml",
        """
run: [spring]
results: results/mine
seeds: [0]
experiments:
  spring:
    system: {name: spring}
    data:
      source: simulation
      step_s: 0.1
      t1_s: 2.0
      t2_s: 4.0
      sets:
        train: {size: 20, z_e: {k: [1, 3]}, z_a: {c: [0, 0.5]}}
        validation: {size: 10, z_e: {k: [1, 3]}, z_a: {c: [0, 0.5]}}
        test: {size: 10, z_e: {k: [3, 4]}, z_a: {c: [0, 0.5]}}
    model: {encoder: {kind: recurrent, hidden: 4, layers: [4]}, interaction: {kind: mlp, layers: [4]}}
    training: {epochs: 1}
    methods: [mean]
""",
    )
    assert "spring" in checkout.run("expertaug.cli", "check-system", "my.yaml")


def test_an_encoder(checkout):
    checkout.write("src/expertaug/models/encoders/mean.py", ENCODER)
    settings = '''class MeanSettings(EncoderSettings):
    """A network of the mean of the observed states."""

    CLASS = "mean:MeanEncoder"

    kind: Literal["mean"] = key("mean", "a network of the mean of the observed states")
    layers: Hidden = key((8,), "widths of the hidden layers")
    latent: Width = key(2, LATENT)


'''
    where = "src/expertaug/models/settings.py"
    checkout.insert(where, "class InteractionSettings", settings)
    checkout.insert(where, "WindowSettings, RecurrentSettings, TwoStep", "MeanSettings, ")
    checkout.configure("model: {encoder: {kind: mean, latent: 3}}")
    assert checkout.settings("expertaug train", "aphynity")[0]["model"]["encoder"]["kind"] == "mean"
    checkout.run("expertaug.cli", "check-system", "my.yaml")
    checkout.run("expertaug.config.reference", "config/README.md")
    assert "a network of the mean of the observed states" in (checkout.folder / "config/README.md").read_text()


def test_a_key(checkout):
    key = '    patience: Count | None = key(None, "passes without a better score after which it ends; null = never")\n'
    checkout.insert("src/expertaug/learning/settings.py", "    checkpoint_s: NotNegative", key)
    use = """            late = self.epoch - int(self.best_epoch.max())
            if settings.patience is not None and late > settings.patience:
                break
"""
    where = "            if time.monotonic() - saved > settings.checkpoint_s"
    checkout.insert("src/expertaug/learning/trainer.py", where, use)
    checkout.configure("training: {patience: 3}")
    assert all(one["training"]["patience"] == 3 for one in checkout.settings("expertaug train", "aphynity"))
    checkout.run("expertaug.config.reference", "config/README.md")
    checkout.run("expertaug.config.schema", "config/schema.json")
    for file in ("README.md", "schema.json"):
        assert "passes without a better score" in (checkout.folder / "config" / file).read_text(encoding="utf-8")


def test_a_table_and_its_stage(checkout):
    checkout.write("src/expertaug/evaluation/count.py", STUDY)
    stage = '''class Count(_WindowStudy):
    """count what each version has forecast"""

    name = "count"
    code = "expertaug.evaluation.count"
    draws = False


'''
    checkout.insert("src/expertaug/stages/evaluation.py", "class Validity", stage)
    checkout.write("workflow/report/count.rst", "How many sets each version has forecast.\n")
    checkout.configure("controls: []")
    given = checkout.settings("expertaug count", "tables/pendulum_count.md", "logs/study/pendulum_count.log")
    assert len(given) == 1 and given[0]["mean"] == "mean"
    report = checkout.settings("expertaug report")[0]
    assert {one["caption"] for one in report["shown"] if "count" in one["path"]} == {"workflow/report/count.rst"}
    assert ["evaluate", "count"] in report["rules"]
    assert "count what each version has forecast" in checkout.run("expertaug.cli", "--help")


def test_recipes_and_walks_name_files_and_functions_that_exist():
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    for path in re.findall(r"`((?:src|workflow|tests|config|docs)/[\w/.-]+\.\w+)`", text):
        assert (ROOT / path).is_file(), f"CONTRIBUTING.md names {path}"
    named = re.findall(r"\[`(\w[\w.]*)`\]\((src/[\w/]+\.py)\)", text)
    assert len(named) > 30
    for name, file in named:
        source = (ROOT / file).read_text(encoding="utf-8")
        for part in name.split("."):
            assert re.search(rf"(?:def|class) {part}\b", source), f"{file} has no {name}"

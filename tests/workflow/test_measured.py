"""Measurements of one's own through the workflow: a spring's elongation as a lab writes it, a system without truth."""

from __future__ import annotations

import hashlib

import numpy as np
import pandas as pd
import pytest
import yaml
from running import copy_project, env_of, planned, snakemake

from expertaug.cli import main

SYSTEM = '''
"""A mass on a spring; what rubs is for F_a to learn."""

import torch
from expertaug.systems.base import Parameter, System


class Spring(System):
    """x'' = −ω0² x."""

    state = (Parameter("x", "m"), Parameter("v", "m/s"))
    expert_parameters = (Parameter("omega0", "rad/s"),)

    def expert(self, t, y, z_e):
        x, v = y[..., :1], y[..., 1:]
        return torch.cat((v, -z_e.square() * x), -1)
'''
SMALL = """
seeds: [0]
tracking: {enabled: false}
experiments:
  measured:
    data: {files: {length: 40, stride: 10, evaluation_stride: 10, horizons_s: [2.4]}}
    model: {encoder: {layers: [8]}, interaction: {layers: [4]}}
    training: {epochs: 2}
    methods: [aphynity]
    augmented: []
"""


def measure(folder, count=12):
    """A CSV a run: ms and mm, now and then without a row."""
    folder.mkdir()
    rng = np.random.default_rng(0)
    for k in range(count):
        t = 40.0 * np.delete(np.arange(70), rng.integers(1, 69, 2))
        x = 20 * (0.5 + rng.random()) * np.cos((2 + 0.5 * rng.random()) * t / 1000) * np.exp(-0.0001 * t)
        rows = {"time (ms)": t, "elongation (mm)": x + 0.05 * rng.standard_normal(len(t))}
        pd.DataFrame(rows).to_csv(folder / f"run{k + 1}.csv", index=False, sep=";")


def sums(folder):
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(folder.iterdir())}


@pytest.fixture
def lab(tmp_path, monkeypatch, capsys):
    """A checkout with measurements, a system and the configuration that inspect-data proposes."""
    project = copy_project(tmp_path / "project")
    measure(project / "lab")
    (project / "springs.py").write_text(SYSTEM)
    (project / "small.yaml").write_text(SMALL)
    monkeypatch.chdir(project)
    monkeypatch.syspath_prepend(str(project))
    assert main(["inspect-data", "lab/run*.csv", "--system", "springs:Spring"]) == 0
    said = capsys.readouterr().out
    assert "12 files, 12 trajectories" in said and "step: 0.04 s (25 Hz)" in said
    assert "x (column 'elongation (mm)')" in said and (project / "data.png").stat().st_size > 10_000
    (project / "mine.yaml").write_text(said)
    return project


@pytest.mark.slow
def test_what_inspect_data_proposes_runs_to_its_tables_and_leaves_the_originals_alone(lab, capsys):
    found = yaml.safe_load((lab / "mine.yaml").read_text())["experiments"]["measured"]["data"]
    assert found["files"]["columns"] == {"x": {"name": "elongation (mm)", "unit": "mm"}} and "v" in found["start"]
    assert found["files"]["time"] == {"name": "time (ms)", "unit": "ms"}
    assert main(["validate", "mine.yaml", "small.yaml"]) == 0
    before = sums(lab / "lab")
    arguments = ["--configfile", "mine.yaml", "small.yaml", "--"]
    table = "results/measured/tables/measured.md"
    path = env_of(lab)["PYTHONPATH"] + f":{lab}"
    done = snakemake(lab, *arguments[:-1], "--", table, PYTHONPATH=path)
    assert done.returncode == 0, done.stdout + done.stderr
    text = (lab / table).read_text()
    assert "APHYNITY" in text and "nan" not in text
    metrics = pd.read_csv(lab / "results/measured/measured/aphynity/seeds_0/metrics.csv")
    assert {"validation_2400ms", "test_2400ms"} <= set(metrics["set"])
    assert np.isfinite(metrics["value"]).all() and not metrics["metric"].str.startswith("relative").any()
    assert sums(lab / "lab") == before
    assert planned(lab, *arguments, table, PYTHONPATH=path) == {}
    # An edited system redoes what follows from it; an edited table its chunks too; neither is an output.
    (lab / "springs.py").write_text(SYSTEM + "\n# another thought\n")
    again = planned(lab, *arguments, table, PYTHONPATH=path)
    assert again["train_seed_group"] == 1 and sums(lab / "lab") == before
    (lab / "lab" / "run1.csv").write_text((lab / "lab" / "run2.csv").read_text())
    assert "cut_measurements_of_experiment" in planned(lab, *arguments, table, PYTHONPATH=path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"paths": "nowhere/*.csv"}, "data.files.paths: no file at 'nowhere/*.csv'"),
        ({"paths": "results/measured/a.csv"}, "no file at 'results/measured/a.csv'"),
        ({"columns": {"x": "width"}}, "has no column 'width'; its columns are time (ms), elongation (mm)"),
        ({"columns": {"y": "elongation (mm)"}}, "columns.y: 'y' is no component of the state"),
        ({"split": {"by": "quantity", "quantity": "x**"}}, "'x**' is no expression"),
        ({"length": "long"}, "length: found 'long'"),
        ({"time": None}, "files.time"),
    ],
)
def test_what_cannot_be_is_said_before_any_job(lab, capsys, change, message):
    wrong = {"experiments": {"measured": {"data": {"files": change}}}}
    (lab / "wrong.yaml").write_text(yaml.safe_dump(wrong))
    capsys.readouterr()
    assert main(["validate", "mine.yaml", "small.yaml", "wrong.yaml"]) == 2
    said = capsys.readouterr().err
    assert message in said and "Traceback" not in said, said
    assert not (lab / "results").exists()

"""A user's file is merged with the defaults in the workflow as it is on the command line."""

from __future__ import annotations

import json
import os
import re
import subprocess
from pathlib import Path

import pytest
import yaml

import warm_python
from expertaug.config.load import merge
from test_own_system import EXPERIMENT, SYSTEM

ROOT = Path(__file__).parents[2]
TEXT = """
results: results/mine
run: [pendulum]
methods: {later: {kind: hybrid, label: Later}}
experiments:
  pendulum:
    methods: [mean, later]
    augmented: []
    augmentations: {narrow: null, wide: null}
    model: {encoder: {kind: recurrent, hidden: 8}}
    seeds: [7]
"""


def plan(folder: Path, text: str, *more: str, dry: bool = True, **environment: str) -> subprocess.CompletedProcess:
    """A run with a configuration of one's own, dry unless it is to stop by itself."""
    (folder / "my.yaml").write_text(text)
    command = [warm_python.interpreter(), "-m", "snakemake", "-s", str(ROOT / "Snakefile"), "-p", "--cores", "1"]
    return subprocess.run(
        [*command, *["-n"] * dry, "--configfile", "my.yaml", *more],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT / "src"), "PATH": warm_python.path()} | environment,
        capture_output=True,
        text=True,
        timeout=240,
    )


def told(done: subprocess.CompletedProcess) -> list[str]:
    return [line for line in done.stderr.splitlines() if line.startswith("configuration: ")]


@pytest.mark.slow
def test_another_kind_brings_its_own_arguments_and_own_methods_come_last(tmp_path):
    done = plan(tmp_path, TEXT)
    said = done.stdout + done.stderr
    assert done.returncode == 0, said
    settings = [json.loads(text) for text in re.findall(r"--settings '(\{.*?\})' ", said)]
    later = next(one for one in settings if one.get("method") == "later" and "model" in one)
    assert later["model"]["encoder"] == {"kind": "recurrent", "hidden": 8}
    assert later["seeds"] == [7] and "results/mine/pendulum/later/seeds_7/model.safetensors" in said
    methods = [name for name, _ in max((one["hues"] for one in settings if "hues" in one), key=len)]
    assert methods[0] == "mean" and methods[-1] == "later"


@pytest.mark.slow
def test_numbers_within_braces_on_the_command_line_are_numbers(tmp_path):
    said = "experiments={pendulum: {seeds: [3, 4], training: {learning_rate: 2e-3, epochs: 7}}}"
    done = plan(tmp_path, TEXT, "--config", said)
    assert done.returncode == 0, done.stderr
    settings = [json.loads(text) for text in re.findall(r"--settings '(\{.*?\})' ", done.stdout + done.stderr)]
    later = next(one for one in settings if one.get("method") == "later" and "model" in one)
    assert later["seeds"] == [3, 4]
    assert (later["training"]["learning_rate"], later["training"]["epochs"]) == (0.002, 7)


def test_everything_that_is_wrong_is_told_with_status_2(tmp_path):
    done = plan(tmp_path, f"{TEXT}    training: {{epoch: 1, batch_size: x}}\n", "--config", "device=gpu")
    assert done.returncode == 2
    assert [line.split(": ")[1] for line in told(done)] == [
        "device",
        "experiments.pendulum.training.epoch",
        "experiments.pendulum.training.batch_size",
    ]
    done = plan(tmp_path, f"{TEXT}run: [rlc]\n")
    line = f"{TEXT}run".count("\n") + 1
    assert done.returncode == 2 and f"my.yaml:{line}: 'run' is there twice" in told(done)[0]


@pytest.mark.slow
def test_tables_of_other_files_are_not_overwritten(tmp_path):
    (tmp_path / "results" / "mine" / "tables").mkdir(parents=True)
    (tmp_path / "results" / "mine" / "tables" / "pendulum_long.csv").touch()
    record = {"runs": [{"files": ["other.yaml"], "digest": "0"}]}
    (tmp_path / "results" / "mine" / ".configuration.json").write_text(json.dumps(record))
    done = plan(tmp_path, TEXT)
    assert done.returncode == 2
    assert "results: 'results/mine' holds the tables of other.yaml, not of my.yaml" in told(done)[0]
    assert plan(tmp_path, TEXT, "--config", "overwrite=true").returncode == 0


@pytest.mark.slow
def test_a_broken_class_of_ones_own_stops_the_run_before_its_first_job(tmp_path):
    """One line for every mistake and no job, no result, no lock; a dry run is none of its business."""
    (tmp_path / "own").mkdir()
    broken = SYSTEM.replace("1 + 3 * torch.rand(n, 2, generator=generator,", "1 + 3 * torch.rand(n, 2,")
    (tmp_path / "own" / "predation.py").write_text(broken)
    shape = {"kind": "own.parts:Wrong"}
    (tmp_path / "own" / "parts.py").write_text(
        "from torch import nn\n\n\nclass Wrong(nn.Module):\n    def forward(self, y, z_a):\n        return y[:, :1]\n"
    )
    other = {"methods": ["aphynity"], "augmented": [], "model": {"interaction": shape}}
    change = {"results": "results/mine", "run": ["predation", "rlc"], "experiments": {"rlc": other}}
    text = yaml.safe_dump(merge(yaml.safe_load(EXPERIMENT), change))
    path = os.pathsep.join([str(ROOT / "src"), str(tmp_path)])
    done = plan(tmp_path, text, PYTHONPATH=path)
    assert done.returncode == 0, done.stderr
    for _ in range(2):
        done = plan(tmp_path, text, dry=False, PYTHONPATH=path)
        said = done.stdout + done.stderr
        assert done.returncode == 2 and "Traceback" not in said, said
        assert [line for line in said.splitlines() if line.startswith("check-system: ")] == [
            "check-system: experiments.predation, system (own/predation.py): LotkaVolterra.sample_initial_state gives "
            "other states for the same generator; draw with generator=generator",
            "check-system: experiments.rlc, aphynity (own/parts.py): model.interaction: Wrong gives shape (4, 1); "
            "give rates of the states' shape (4, 2)",
        ]
        assert "simulate the" not in said and not (tmp_path / "results").exists()


@pytest.mark.slow
def test_no_validity_is_checked_where_it_is_null(tmp_path):
    for text, checked in ((TEXT, True), (f"{TEXT}    validity: null\n", False)):
        done = plan(tmp_path, text)
        said = done.stdout + done.stderr
        assert done.returncode == 0, said
        assert ("validity_of_experiment" in said) == checked
    done = plan(tmp_path, text, "--", "results/mine/tables/pendulum_validity.csv")
    said = done.stdout + done.stderr
    assert done.returncode != 0 and "nothing makes 'results/mine/tables/pendulum_validity.csv'" in said

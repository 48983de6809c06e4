"""What settings of stages must hold is what the workflow gives them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from expertaug.cli import main
from expertaug.config import jobs, stage_settings
from expertaug.config import load as config
from expertaug.config.stage_models import STAGES, require
from expertaug.errors import InputErrors, lines
from expertaug.inference.settings import AlternateJob, FlowJob
from expertaug.learning.settings import AugmentJob, FinetuneJob, train_job

JOBS = {
    "train": train_job,
    "alternate": AlternateJob.from_mapping,
    "augment": AugmentJob.from_mapping,
    "finetune": FinetuneJob.from_mapping,
    "flow": FlowJob.from_mapping,
}
CONFIG = Path(__file__).parents[1] / "config"


def of_stages(given: dict):
    """Stage and settings of jobs of every kind."""
    yield "compare", stage_settings.compare(given, given["run"])
    yield "overview", stage_settings.overview(given, given["run"])
    yield "init-tracking", stage_settings.init_tracking(given)
    for name in given["run"]:
        one, group = given["experiments"][name], next(iter(jobs.seed_groups(given, name)))
        for simulated in jobs.sets(given, name) if one["data"]["source"] == "simulation" else ():
            yield "simulate", stage_settings.simulate(given, name, simulated)
        for stage in ("tabulate", "plot"):
            yield stage, getattr(stage_settings, stage)(given, name)
        for study in jobs.studies(given, name):
            yield "study", stage_settings.study(given, name, study)
        for method in one["methods"]:
            alternating = given["methods"][method]["kind"] == "alternating"
            yield "alternate" if alternating else "train", stage_settings.train(given, name, method, group)
        for variant in jobs.variants(given, name):
            yield "evaluate", stage_settings.evaluate(given, name, variant, group)
            if variant.endswith("+~flow"):
                yield "flow", stage_settings.flow(given, name, variant, group)
            elif variant.endswith("+"):
                yield "augment", stage_settings.augment(given, name, variant, group)
                yield "finetune", stage_settings.finetune(given, name, variant, group)
        if one["studies"].get("during_training"):
            followed = one["augmented"][0]
            yield "during-training", stage_settings.during_training(given, name, followed, group)


@pytest.mark.parametrize("file", ["config", "smoke", "paper", "code"])
def test_the_workflows_settings_are_good(file):
    given = config.validate(config.load([CONFIG / "config.yaml", CONFIG / f"{file}.yaml"]))
    stages = set()
    for stage, settings in of_stages(given):
        if stage in JOBS:
            found = JOBS[stage](settings)
            assert found.to_json().keys() >= settings.keys() and JOBS[stage](found.to_json()) == found
        else:
            require(stage, settings)
        stages.add(stage)
    assert stages == {*STAGES, *JOBS} or file != "config"


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"build": {"kind": "hybrid", "objectve": "hvae"}}, "build.objectve: unknown key; did you mean 'objective'?"),
        ({"choices": {}}, "choices.loss_window: missing"),
        ({"chioces": {}}, "chioces: unknown key; did you mean 'choices'?"),
        ({"training": {"epoch": 3}}, "training.epoch: unknown key; did you mean 'epochs'?"),
        ({"training": {"objective": {"lambda": 3}}}, "training.objective.lambda: unknown key"),
        ({"system": {"name": "rlc", "sorce": 1}}, "system.sorce: unknown key"),
        ({"model": {"encoder": {"kind": "recurrent", "hiden": 3}}}, "model.encoder.hiden: unknown key"),
        ({"seeds": []}, "seeds: found []"),
    ],
)
def test_what_is_misspelt_is_refused_before_anything_runs(change, line, tmp_path, capsys):
    given = config.validate(config.load([CONFIG / "config.yaml"]))
    settings = stage_settings.train(given, "pendulum", "aphynity", "seeds_0_1_2") | change
    paths = [f"--{name}={tmp_path / name}" for name in ("data", "output", "work")]
    assert main(["train", *paths, "--settings", json.dumps(settings)]) == 2
    assert f"--settings.{line}" in capsys.readouterr().err and not list(tmp_path.iterdir())


def test_what_is_missing_is_told():
    with pytest.raises(InputErrors) as caught:
        require("tabulate", {"floors": []})
    assert any("--settings.labels: missing" in line for line in lines(caught.value))

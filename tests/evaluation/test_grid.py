"""A sweep over hyperparameters: what each point trains, and its table by the validation score."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest
import torch

from cards import card
from expertaug.config import jobs, report_parameters, stage_settings
from expertaug.config import load as configuration
from expertaug.errors import InputError
from expertaug.evaluation.grid import run_stage as stage
from expertaug.evaluation.settings import GridJob
from expertaug.models.tensor_file import write_tensors

ROOT = Path(__file__).parents[2]
KEYS = {
    "training.learning_rate": [1e-3, 3e-3],
    "model.interaction.layers": [[16], [50, 50]],
    "choices.multiplier": ["fixed", "lagrangian"],
}


def expanded(keys, method="aphynity", overrides=None):
    study = {"studies": {"grid": {"method": method, "keys": keys}}, "overrides": overrides or {}}
    raw = configuration.load([ROOT / "config" / "config.yaml", ROOT / "config" / "smoke.yaml"])
    raw = configuration.merge(raw, {"run": ["rlc"], "experiments": {"rlc": study}})
    return configuration.complete_configuration(raw)


def train(config, method):
    return stage_settings.train(config, "rlc", method, "seeds_0_1")


def test_every_combination_is_a_training_on_the_same_data():
    config = expanded(KEYS, overrides={"aphynity": {"training": {"learning_rate": 7.0}}})
    assert config.experiments["rlc"].points == [f"aphynity@{k}" for k in range(1, 9)]
    base, last = train(config, "aphynity"), train(config, "aphynity@8")
    assert last["training"] == base["training"] | {"learning_rate": 3e-3}, "a point wins over the method's overrides"
    assert last["model"]["interaction"] == base["model"]["interaction"] | {"layers": [50, 50]}
    assert last["model"]["encoder"] == base["model"]["encoder"]
    assert (train(config, "aphynity@1")["choices"]["multiplier"], last["choices"]["multiplier"]) == (
        "fixed",
        "lagrangian",
    )
    assert (last["method"], last["label"]) == ("aphynity@8", f"{base['label']} @8")
    assert jobs.modules(config, "rlc", "aphynity@8") == jobs.modules(config, "rlc", "aphynity")


def test_points_are_no_methods_of_the_experiment_and_change_none_of_its_jobs():
    keys = {"training.learning_rate": [1e-3]}
    config, plain = expanded(keys), expanded(keys)
    del plain.methods["aphynity@1"]
    assert jobs.variants(config, "rlc") == jobs.variants(plain, "rlc") == ["least_squares", "aphynity", "aphynity+"]
    assert train(config, "aphynity") == train(plain, "aphynity")
    assert report_parameters.plot(config, "rlc") == report_parameters.plot(plain, "rlc")


@pytest.mark.parametrize(
    ("keys", "method", "line"),
    [
        ({"data.noise": [0.1]}, "aphynity", r"rlc\.studies\.grid\.keys\.data\.noise: cannot be varied"),
        ({"training": [1]}, "aphynity", r"grid\.keys\.training: cannot be varied"),
        ({"training.learning_rat": [0.1]}, "aphynity", "learning_rat"),
        ({"training.learning_rate": [-1.0]}, "aphynity", "learning_rate: found -1"),
        ({"training.learning_rate": [0.1]}, "aphinity", r"grid\.method: "),
    ],
)
def test_what_cannot_be_varied_is_named(keys, method, line):
    with pytest.raises(InputError, match=line):
        expanded(keys, method)


def model(folder, method, seeds, scores, epochs):
    path = folder / method / f"{seeds[0]}.safetensors"
    path.parent.mkdir(exist_ok=True)
    description = {"method": method, "seeds": seeds, "best_score": scores, "best_epoch": epochs, "wall_s": 60.0}
    write_tensors(path, {"x": torch.zeros(1)}, card(description, t=[0.0], observed=1).to_json())
    return path


def test_table_and_figure_put_the_best_validation_score_first(tmp_path):
    models = [model(tmp_path, "a@1", [0, 1], [-1.0, -2.0], [3, 5]), model(tmp_path, "a@1", [2], [-3.0], [4])]
    models += [model(tmp_path, "a@2", [0, 1], [-4.0, None], [2, 2]), model(tmp_path, "a@2", [2], [-5.0], [2])]
    points = [("a@1", [0.001, [16]]), ("a@2", [0.003, [50, 50]])]
    job = GridJob(experiment="lab", label="A", keys=["training.learning_rate", "model.layers"], points=points)
    outputs = [tmp_path / f"grid.{end}" for end in ("csv", "md", "tex", "png", "pdf")]
    stage(models, outputs, job)
    table = pd.read_csv(outputs[0])
    assert list(table["point"]) == ["a@1", "a@2"] and list(table["model.layers"]) == ["[16]", "[50, 50]"]
    assert list(table["mean"]) == [-2.0, -4.5] and list(table["n"]) == [3, 2] and list(table["of"]) == [3, 3]
    rows = [line for line in outputs[1].read_text().splitlines() if line.startswith("| a@")]
    assert [row.split(" |")[0] for row in rows] == ["| a@2", "| a@1"]
    assert "−4.50 ± 0.71 (2/3)" in rows[0]
    assert all(path.stat().st_size > 300 for path in outputs[1:])
    with pytest.raises(InputError, match="no model of this point"):
        stage(models[:2], outputs, job)
    with pytest.raises(InputError, match=r"a model of 'a@2'"):
        stage(models, outputs, job.model_copy(update={"points": points[:1]}))

"""What the front door computes is what the workflow's stages compute, bit for bit."""

import json

import numpy as np
import pandas as pd
import pytest
import torch
import yaml
from small_pendulum import ENCODER, FRICTION, INTERACTION, OPTIONS, SEEN, SHIFTED

import expertaug as ea
import tiny
from expertaug.cli import main
from expertaug.config import stage_settings
from expertaug.config.jobs import seed_groups
from expertaug.config.load import load, validate, with_defaults
from expertaug.evaluation.forecasts import Forecasts
from expertaug.learning.augment import load as load_augmented
from expertaug.presets import resolve
from expertaug.systems.settings import SimulatedData, SimulatedSet
from typed_jobs import augment, evaluate, finetune, train

SIZES = {"train": 40, "validation": 10, "test": 10}
SETS = {name: SimulatedSet(size=n, z_e=SEEN, z_a=FRICTION) for name, n in SIZES.items()}
DATA = SimulatedData(seed=0, step_s=0.1, t2_s=2.0, noise=0.01, sets=SETS)
COMMON = {
    "experiment": "pendulum",
    "preset": "corrected",
    "choices": resolve("corrected").model_dump(),
    "seeds": [0, 1],
}
COMMON |= {"method": "a", "label": "A", "device": "cpu"}
PRIOR = {"omega0": list(SHIFTED["omega0"])}
TIMES = torch.arange(21) * 0.1


@pytest.fixture(scope="module")
def stages(tmp_path_factory):
    folder = tmp_path_factory.mktemp("stages")
    tiny.simulated(folder, DATA)
    model, samples, tuned = (folder / f"{name}.safetensors" for name in ("model", "samples", "tuned"))
    system = {"system": {"name": "pendulum"}, "build": {"kind": "hybrid"}, "t1_s": 1.0, "training": OPTIONS}
    parts = {"encoder": ENCODER, "interaction": INTERACTION}
    train(folder, model, folder / "work", COMMON | system | {"model": parts}, None)
    augment(model, folder, samples, COMMON | {"prior": PRIOR, "noise": 0.01})
    finetune(model, samples, folder, tuned, folder / "work", COMMON | {"training": OPTIONS}, None)
    settings = COMMON | {"evaluation": {"samples": 2}}
    evaluate(tuned, folder, folder / "metrics.csv", folder / "forecasts.npz", settings)
    return folder


def equal(first, second):
    a, b = (model.stored.model.state_dict() for model in (first, second))
    return a.keys() == b.keys() and all(torch.equal(a[k], b[k]) for k in a)


def test_a_simulated_set(stages, sets):
    for name, data in sets.items():
        stored = ea.Trajectories.load(stages / f"{name}.npz")
        assert all(np.array_equal(getattr(stored, k), getattr(data, k)) for k in ("t", "y", "z_e", "z_a"))


def test_training_augmentation_and_fine_tuning(stages, sets, fit, plus):
    assert equal(fit, ea.load(stages / "model.safetensors"))
    drawn = ea.augment(fit, sets["train"], sets["validation"], prior=SHIFTED, noise=0.01).drawn
    read = load_augmented(stages / "samples.safetensors", torch.device("cpu"), TIMES)
    train_set, validation_set, header = read.train, read.validation, read.drawing.to_json()
    assert torch.equal(drawn.train.y, train_set.y) and torch.equal(drawn.validation.z_e, validation_set.z_e)
    assert header["prior"] == drawn.drawing.to_json()["prior"]
    assert equal(plus, ea.load(stages / "tuned.safetensors"))
    assert not equal(plus, fit)


def test_the_control_of_equal_compute(stages, sets, fit, plus):
    settings = COMMON | {"training": OPTIONS, "prior": PRIOR}
    finetune(stages / "model.safetensors", None, stages, stages / "c.safetensors", stages / "control", settings, None)
    control = ea.finetune(fit, sets["train"], sets["validation"], prior=SHIFTED, control=True, **OPTIONS)
    assert equal(control, ea.load(stages / "c.safetensors")) and control.label == "Aphynity (control)"
    assert control.history["step"].max() == plus.history["step"].max() and not equal(control, plus)


def test_metrics_and_forecasts(stages, sets, plus):
    table = pd.read_csv(stages / "metrics.csv")
    table = table[table["set"] == "test"].set_index(["seed", "metric"])["value"]
    found = plus.evaluate(sets["test"]).set_index(["seed", "metric"])["value"]
    assert found.index.is_unique and set(found.index) == set(table.index)
    same = [key for key in found.index if key[1] != "estimate_ms"]
    assert all(found[key] == pytest.approx(table[key], rel=1e-15) for key in same)
    kept = Forecasts.load(stages / "forecasts.npz")
    whole = plus.forecast(sets["test"].y[:, :11], sets["test"].t)
    np.testing.assert_array_equal(whole.y[:, kept.kept["test"].index], kept.kept["test"].prediction)
    np.testing.assert_array_equal(whole.z_e["omega0"], kept.estimates["test"][..., 0])


def test_a_fine_tuning_from_given_samples_is_that_from_their_prior(sets, fit, plus):
    samples = ea.augment(fit, sets["train"], sets["validation"], prior=SHIFTED, noise=0.01)
    assert [len(part) for part in samples.train] == [40, 40] and len(samples.validation[1]) == 10
    assert equal(plus, ea.finetune(fit, sets["train"], sets["validation"], augmented=samples, **OPTIONS))


def test_fresh_samples_in_every_pass(sets, fit, plus):
    before = {k: v.clone() for k, v in fit.stored.model.state_dict().items()}
    fresh = ea.finetune(
        fit, sets["train"], sets["validation"], prior=SHIFTED, noise=0.01, choices={"resample": "epoch"}, **OPTIONS
    )
    assert not equal(fresh, plus)
    assert all(torch.equal(v, before[k]) for k, v in fit.stored.model.state_dict().items()), "the base is left alone"
    assert all(p.requires_grad for p in fit.stored.model.parameters())


@pytest.fixture(scope="module")
def command_line(tmp_path_factory):
    """The same by the commands that the workflow's rules call, with the settings of a configuration file."""
    folder = tmp_path_factory.mktemp("command_line")
    own = {
        "system": {"name": "pendulum"},
        "data": {"source": "simulation", "t1_s": 1.0} | DATA.to_json(),
        "model": {"encoder": ENCODER, "interaction": INTERACTION},
        "training": OPTIONS,
        "finetuning": OPTIONS,
        "augmentation": {"prior": PRIOR},
        "methods": ["aphynity"],
        "augmented": ["aphynity"],
    }
    text = yaml.safe_dump({"run": ["tiny"], "device": "cpu", "seeds": [0, 1], "experiments": {"tiny": own}})
    (folder / "tiny.yaml").write_text(text)
    config = validate(load(with_defaults([folder / "tiny.yaml"])))
    (group,) = seed_groups(config, "tiny")

    def call(stage, settings, *words, **paths):
        options = [word for name, file in paths.items() for word in (f"--{name}", str(folder / file))]
        status = main([stage, *words, *options, "--settings", json.dumps(settings, sort_keys=True)])
        assert status == 0, f"expertaug {stage}"

    for name in SIZES:
        call("simulate", stage_settings.simulate(config, "tiny", name), name, output=f"{name}.npz")
    data = {"data": "", "work": "work"}
    settings = stage_settings.train(config, "tiny", "aphynity", group)
    call("train", settings, output="model.safetensors", **data)
    settings = stage_settings.augment(config, "tiny", "aphynity+", group)
    call("augment", settings, model="model.safetensors", data="", output="samples.safetensors")
    settings = stage_settings.finetune(config, "tiny", "aphynity+", group)
    files = {"model": "model.safetensors", "augmented": "samples.safetensors", "output": "tuned.safetensors"}
    call("finetune", settings, **files, **data)
    return folder


def test_the_commands_of_the_workflow(command_line, sets, fit, plus):
    for name, data in sets.items():
        assert np.array_equal(ea.Trajectories.load(command_line / f"{name}.npz").y, data.y)
    assert equal(fit, ea.load(command_line / "model.safetensors"))
    assert equal(plus, ea.load(command_line / "tuned.safetensors"))

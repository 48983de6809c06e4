"""Settings of systems say what their classes do, and a mistake in them is one line."""

from __future__ import annotations

import json

import pytest

from expertaug import systems
from expertaug.cli import main
from expertaug.systems.settings import SYSTEMS
from simulated_pendulums import pendulum_data


@pytest.mark.parametrize("name", SYSTEMS)
def test_units_of_parameters_are_the_systems_own(name):
    given = {"constants": {"B1": 0.1, "G1": 69.0, "B2": 1.3, "G2": 93.0}} if name == "double_pendulum" else {}
    system = systems.load({"name": name} | given)
    parameters = (*system.expert_parameters, *system.interaction_parameters, *system.input_parameters)
    assert {p.name: p.unit for p in parameters if p.unit} == SYSTEMS[name].UNITS


@pytest.mark.parametrize(
    ("where", "change", "expected"),
    [
        ("data", {"nois": 0.5}, "--settings.data.nois: unknown key; did you mean 'noise'?"),
        ("data", {"noise": "0.5"}, "--settings.data.noise: found '0.5'"),
        ("data", {"noise": -1.0}, "--settings.data.noise: found -1.0; give 0 or more"),
        ("data", {"sets": {"test": {"size": 1, "z_e": {}, "za": {}}}}, "data.sets.test.za: unknown key"),
        ("data", {"sets": {"test": {"z_e": {}}}}, "--settings.data.sets.test.size: missing"),
        ("data", {"sets": {}}, "data.sets: no set 'train'"),
        ("system", {"name": "pendulm"}, "--settings.system.name: 'pendulm' is no system; did you mean 'pendulum'?"),
        ("system", {"mass": 1.0}, "--settings.system.mass: unknown key; known: name"),
        ("sytem", {}, "--settings.sytem: unknown key; did you mean 'system'?"),
    ],
)
def test_a_misspelt_setting_is_one_line_and_nothing_is_simulated(tmp_path, capsys, where, change, expected):
    job = {"system": {"name": "pendulum"}, "data": json.loads(pendulum_data(size=2).model_dump_json())}
    job[where] = job.get(where, {}) | change
    assert main(["simulate", "train", "--output", str(tmp_path / "x.npz"), "--settings", json.dumps(job)]) == 2
    told = capsys.readouterr().err
    assert expected in told and len(told.splitlines()) == 1 and not list(tmp_path.iterdir())

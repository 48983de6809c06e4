"""The configuration as typed models: keys that disagree are all told, and what follows from keys is derived once."""

from __future__ import annotations

import pytest

from expertaug.config.models import Data, DataCurves, Grid, OutOfExpertise, Studies
from expertaug.settings import check
from shipped import alone, valid

SET = {"size": 5, "z_e": {"k": [1.0, 2.0]}, "z_a": {}}
SETS = {"train": SET, "validation": SET, "test": SET}
SIMULATED = {"source": "simulation", "t1_s": 1.0, "t2_s": 2.0, "step_s": 0.1, "sets": SETS}


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({}, []),
        ({"t2_s": None, "step_s": None}, ["data.step_s: found null", "data.t2_s: found null"]),
        ({"t1_s": 2.0}, ["data.t1_s: found 2, t2_s is 2; t1_s must be less than t2_s"]),
        ({"t1_s": 0.55, "t2_s": 1.25}, ["data.t1_s: found 0.55; give a multiple", "data.t2_s: found 1.25; give a"]),
        ({"sets": {"train": SET}}, ["data.sets.validation: missing", "data.sets.test: missing"]),
        ({"sets": SETS | {"test": SET | {"z_e": {"m": [1.0, 2.0]}}}}, ["data.sets.test.z_e: names m; give a range"]),
        ({"noise": {"x": 0.1}}, ["data.noise: found"]),
        ({"source": "recordings"}, ["data.split: missing; give split"]),
        ({"source": "files"}, ["data.files: missing; give files"]),
    ],
)
def test_keys_of_the_data_that_disagree_are_all_told(change, expected):
    errors = [str(error) for error in check(Data, SIMULATED | change, "data")]
    assert len(errors) == len(expected)
    assert all(error.startswith(text) for error, text in zip(errors, expected, strict=True))


def test_a_grid_has_a_point_for_each_combination_of_values():
    grid = Grid.of(method="m", keys={"training.epochs": [1, 2], "choices.noise": ["none"]})
    assert grid.points == {
        "m@1": {"training.epochs": 1, "choices.noise": "none"},
        "m@2": {"training.epochs": 2, "choices.noise": "none"},
    }


def test_studies_are_those_that_are_asked_for():
    study = {"distances": ["a", "a"], "panels": {"x": ["test"]}}
    assert [error.where for error in check(OutOfExpertise, study, "s")] == ["s.distances[1]", "s.panels.x"]
    assert [str(error) for error in check(DataCurves, {}, "s")] == [
        "s: no experiment; name some under samples or noise"
    ]
    curves = Studies.of(data_curves={"noise": ["a", "b"]})
    assert curves.names == ["data_curves"] and curves.data_curves.axes == {"noise": ["a", "b"]}


def test_what_an_override_says_is_of_its_method_alone():
    found = valid(
        alone("pendulum"),
        "experiments: {pendulum: {overrides: {hvae: {training: {epochs: 7}}, ml_only: {system: {name: pendulum}}}}}",
    )
    whole = found.experiments["pendulum"]
    assert found.experiment_of("pendulum", "hvae").training.epochs == 7 != whole.training.epochs
    assert found.experiment_of("pendulum", "aphynity").training.epochs == whole.training.epochs
    assert found.experiment_of("pendulum", None) is whole
    assert found.build_of("pendulum", "ml_only").system == {"name": "pendulum"}
    assert found.build_of("pendulum", "aphynity").system is None


def test_the_sets_are_those_of_the_source_then_those_of_long_chunks():
    assert Data.of(**SIMULATED | {"sets": SETS | {"far": SET, "iid": None}}).set_names == [*SETS, "far"]
    files = {"paths": "a.csv", "columns": {"x": "x"}, "horizons_s": [2.0], "step_s": 0.1}
    assert Data.of(source="files", t1_s=1.0, files=files).set_names == [*SETS, "validation_2s", "test_2s"]

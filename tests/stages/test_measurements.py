"""Stages that cut tables are told the components of the system whose state the columns hold."""

from __future__ import annotations

import argparse
from pathlib import Path

import pytest

from expertaug import systems
from expertaug.measurements.settings import CutMeasuredHorizonJob, CutMeasurementsJob
from expertaug.stages.measurements import CutMeasuredHorizon, CutMeasurements

SETTINGS = {"system": {"name": "pendulum"}, "files": {"paths": "a.csv", "columns": {"theta": "angle"}}}
GIVEN = argparse.Namespace(files=[Path("a.csv")], output=Path("out"))


@pytest.fixture
def given(monkeypatch):
    """What the functions behind the stages are called with."""
    calls = []
    for name in ("stage.cut_measurements", "horizons.cut_measured_horizon"):
        monkeypatch.setattr(f"expertaug.measurements.{name}", lambda *a: calls.append(a))
    return calls


def test_sets_are_cut_by_the_names_of_the_state(given):
    job = CutMeasurementsJob.from_mapping(SETTINGS)
    CutMeasurements.run(GIVEN, job)
    ((files, output, settings, names),) = given
    assert (files, output, settings) == (GIVEN.files, GIVEN.output, job.files)
    assert names == systems.names(systems.load({"name": "pendulum"}))


def test_long_chunks_are_cut_for_the_set_that_is_named(given):
    job = CutMeasuredHorizonJob.from_mapping(
        {**SETTINGS, "files": SETTINGS["files"] | {"horizons_s": [2.0]}, "set": "test_2s"}
    )
    CutMeasuredHorizon.run(GIVEN, job)
    assert given[0][:4] == (GIVEN.files, GIVEN.output, job.files, "test_2s")

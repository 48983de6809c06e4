"""The store is prepared as its settings say, or the file that others read says that there is none."""

from __future__ import annotations

import argparse
import json

from expertaug.stages.tracking import InitTracking
from expertaug.tracking import store
from expertaug.tracking.settings import InitTrackingJob

STORE = {"uri": "sqlite:///x.db", "experiment": "e", "experiments": ["swing", "slide"]}


def test_each_experiment_has_its_place_in_the_store(tmp_path, monkeypatch):
    monkeypatch.setattr(store, "connect", lambda uri, experiment, prepare: (None, f"id of {experiment}"))
    given = argparse.Namespace(output=tmp_path / "tracking.json")
    InitTracking.run(given, InitTrackingJob(enabled=True, **STORE))
    assert json.loads(given.output.read_text())["experiments"] == {"swing": "id of e swing", "slide": "id of e slide"}


def test_a_store_that_is_switched_off_is_not_made(tmp_path, monkeypatch):
    monkeypatch.setattr(store, "connect", None)
    given = argparse.Namespace(output=tmp_path / "tracking.json")
    InitTracking.run(given, InitTrackingJob(enabled=False, **STORE))
    assert json.loads(given.output.read_text()) == {"enabled": False}

"""The stage that cuts measurements: its sets, and what it says of them."""

from __future__ import annotations

import json

import pytest
from swings import NAMES, settings, trials

from expertaug.measurements.cut import measure, sets_of
from expertaug.measurements.settings import SplitSettings
from expertaug.measurements.stage import chunks_table, cut_measurements, describe_sets
from expertaug.trajectories import Trajectories


def test_the_stage_writes_sets_and_says_what_they_are(tmp_path):
    path = trials(tmp_path, noise=0.01)
    before = path.read_bytes()
    given = settings(path, columns={"theta": "angle"})
    cut_measurements([path], tmp_path / "data", given, NAMES)
    cut_measurements([path], tmp_path / "again", given, NAMES)
    report = json.loads((tmp_path / "data" / "splits.json").read_text())
    for name in ("train", "validation", "test"):
        one = Trajectories.load(tmp_path / "data" / f"{name}.npz")
        assert len(one) == report["chunks"][name] and not one.mask[..., 1].any()
        assert (tmp_path / "data" / f"{name}.npz").read_bytes() == (tmp_path / "again" / f"{name}.npz").read_bytes()
    assert report["not_measured"] == ["omega"] and report["noise"]["omega"] is None
    assert report["noise"]["theta"] == pytest.approx(0.01, rel=0.15)
    assert path.read_bytes() == before


def test_what_the_stage_says_is_a_call_in_memory(tmp_path):
    data = measure(settings(trials(tmp_path), split=SplitSettings(by="time")), NAMES)
    divided = sets_of(data)
    table, report = chunks_table(data, divided), describe_sets(data, divided)
    assert table.groupby("split").size().to_dict() == report["chunks"]
    assert table["id"].tolist() == [identity for trajectories in divided.sets.values() for identity in trajectories.id]
    assert len(list(tmp_path.iterdir())) == 1

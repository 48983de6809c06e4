"""A store is brought up to date from where it stands, however often it fails in between."""

from __future__ import annotations

import pytest
from logged import RUN, children_of, history, told

from expertaug.tracking import sync
from expertaug.tracking.log import read_log
from expertaug.tracking.run_log import RunLog


@pytest.fixture
def failing(monkeypatch):
    """Say how often the store fails from now on, each time with half of the values stored."""
    left = [0]
    stored = sync.Mirror._log_metrics

    def half(mirror, lines):
        stored(mirror, lines[: len(lines) // 2] if left[0] else lines)
        if left[0]:
            left[0] -= 1
            raise OSError("database is locked")

    monkeypatch.setattr(sync.Mirror, "_log_metrics", half)
    return lambda times: left.__setitem__(0, times)


@pytest.mark.parametrize("later", [True, False], ids=["on the way", "at the end"])
def test_what_a_failing_store_missed_is_stored_later(tmp_path, tracking, failing, later, monkeypatch, caplog):
    monkeypatch.setattr(sync, "FIRST_WAIT_S", 0.0 if later else 1e9)
    log = RunLog(tmp_path / "log.jsonl", RUN, tracking)
    for step in range(40):
        log.metrics(step, {"loss": [step, -step]})
        if step == 20:
            failing(2)
        if step % 4 == 0:
            log.flush()
    failing(0)
    log.close()
    for run in children_of(tracking):
        sign = 1 - 2 * int(run.data.tags["seed"])
        assert [row[:2] for row in history(tracking, run, "loss")] == [(k, sign * k) for k in range(40)]
        assert run.info.status == "FINISHED"
    assert [m for m in told(caplog) if "failed (database is locked)" in m] == told(caplog)
    assert len(told(caplog)) == 1


def test_a_store_that_fails_in_the_last_moment_is_tried_once_more(tmp_path, tracking, failing):
    log = RunLog(tmp_path / "log.jsonl", RUN, tracking)
    log.metrics(0, {"loss": [1, 2]})
    failing(1)
    log.close()
    assert [run.info.status for run in children_of(tracking)] == ["FINISHED", "FINISHED"]
    assert [len(history(tracking, run, "loss")) for run in children_of(tracking)] == [1, 1]


def test_a_store_that_never_comes_back_names_the_remedy(tmp_path, tracking, failing, caplog):
    with RunLog(tmp_path / "log.jsonl", RUN, tracking) as log:
        failing(1000)
        for step in range(3):
            log.metrics(step, {"loss": [1, 2]})
            log.flush()
    first, last = told(caplog)
    assert "the run goes on" in first
    assert "log.jsonl" in last and "expertaug rebuild-tracking RESULTS --uri" in last
    assert len(read_log(tmp_path / "log.jsonl").steps) == 3


def test_nested_settings_are_parameters_with_dots_cut_at_the_limits_of_a_store():
    found = sync.flatten({"a": {"b": {"c=d": 1}, "e": {}}, "f": "x" * 9000, "g": [1, None]})
    assert found == {"a.b.c_d": "1", "a.e": "{}", "f": "x" * sync.PARAM_LENGTH, "g": "[1, null]"}

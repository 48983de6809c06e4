"""A store that fails, comes back or is shared: no value is lost or doubled, and no run left open."""

from __future__ import annotations

import fcntl
import logging
import shutil
import signal
import time
from pathlib import Path

import pytest
from logged import RUN, children_of, elsewhere, settings, start, told

from expertaug import files
from expertaug.errors import InputError
from expertaug.tracking import store
from expertaug.tracking.log import Header, read_log
from expertaug.tracking.rebuild import rebuild
from expertaug.tracking.run_log import RunLog
from expertaug.tracking.store import rebuild_command

DIES = """
    import os, signal, sys
    from expertaug.tracking.log import Run
    from expertaug.tracking.run_log import RunLog
    from expertaug.tracking.settings import Tracking
    from expertaug.tracking.sync import Mirror
    path, tracking, fields, start = eval(sys.argv[1])
    Mirror._log_params = lambda *_: os.kill(os.getpid(), signal.SIGKILL)
    RunLog(path, Run(**fields), tracking)
"""


def superseded(run) -> bool:
    return run.data.tags.get("expertaug.superseded") == "true"


@pytest.mark.slow
def test_a_kill_while_runs_are_made_leaves_none_open(tmp_path, tracking):
    path = tmp_path / "results" / "log.jsonl"
    job = start(str(path), tracking, vars(RUN), 0, code=DIES)
    assert job.wait(60) == -signal.SIGKILL
    assert read_log(path).header.id  # written before any run was made
    assert [run.info.status for run in children_of(tracking)] == ["RUNNING"]
    RunLog(path, RUN, tracking).close()
    found = sorted((superseded(run), run.info.status) for run in children_of(tracking))
    assert found == [(False, "FINISHED"), (False, "FINISHED"), (True, "KILLED")]


def test_a_rerun_marks_the_runs_that_it_replaces(tmp_path, tracking):
    path = tmp_path / "results" / "seeds_0_1" / "log.jsonl"
    other = tmp_path / "results" / "seeds_2" / "log.jsonl"
    RunLog(other, RUN.model_copy(update={"seeds": (2,)}), tracking).close()
    for value in (1, 2, 3):
        with RunLog(path, RUN, tracking) as log:
            log.metrics(0, {"loss": [value, value]})
        if value < 3:
            path.unlink()  # as the workflow does with the outputs of a job that it runs again
    found = children_of(tracking)
    assert {run.info.status for run in found} == {"FINISHED"}
    valid = {run.data.tags["seed"]: run.data.metrics.get("loss") for run in found if not superseded(run)}
    assert valid == {"0": 3, "1": 3, "2": None}
    names = {run.info.run_name for run in found if superseded(run)}
    assert names == {f"Hybrid+ · seed {seed} · train · swing (superseded)" for seed in (0, 1)}
    assert len(found) == 7
    again = elsewhere(tracking, uri=f"sqlite:///{tmp_path}/again/mlflow.db", experiment="again")
    rebuild(tmp_path / "results", again.uri, again.experiment)
    assert sorted(run.data.tags["seed"] for run in children_of(again)) == ["0", "1", "2"]


def test_the_remedy_names_the_results_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    log = Path("my results/a/log.jsonl")
    command = rebuild_command("sqlite:///my results/mlflow/mlflow.db", "expertaug", log)
    assert command == "expertaug rebuild-tracking 'my results'"
    command = rebuild_command("sqlite:///elsewhere/mlflow/mlflow.db", "mine", log)
    assert command == "expertaug rebuild-tracking RESULTS --uri sqlite:///elsewhere/mlflow/mlflow.db --experiment mine"


@pytest.mark.parametrize("replaced", [False, True], ids=["removed", "rebuilt"])
def test_a_database_that_goes_in_mid_training_is_told(tmp_path, replaced, caplog):
    tracking = settings(tmp_path / "results")
    log = RunLog(tmp_path / "results" / "a" / "log.jsonl", RUN, tracking)
    shutil.move(tmp_path / "results" / "mlflow", tmp_path / "away")
    if replaced:
        (tmp_path / "results" / "mlflow").mkdir()
        (tmp_path / "results" / "mlflow" / "mlflow.db").write_bytes(b"")
    with caplog.at_level(logging.WARNING):
        log.metrics(0, {"loss": [1, 2]})
        log.close()
    first, last = told(caplog)
    assert "the database was removed or replaced" in first
    assert "rebuild-tracking" in last and str(tmp_path / "results") in str(Path(last.split()[-3]).resolve())


def test_a_clock_before_1970_stops_neither_mirror_nor_rebuild(tmp_path, tracking, monkeypatch, caplog):
    with monkeypatch.context() as patch:
        patch.setattr(time, "time", lambda: -86400.0)
        with RunLog(tmp_path / "a" / "log.jsonl", RUN, tracking) as log:
            log.metrics(0, {"loss": [1, 2]})
    assert told(caplog) == []
    assert read_log(tmp_path / "a" / "log.jsonl").steps[0].time == -86400.0
    again = elsewhere(tracking, uri=f"sqlite:///{tmp_path}/again/mlflow.db", experiment="again")
    assert rebuild(tmp_path / "a", again.uri, again.experiment) == 1
    for found in (tracking, again):
        assert [(run.info.status, run.info.end_time) for run in children_of(found)] == [("FINISHED", 1)] * 2


def test_a_lock_that_another_holds_is_told_and_waited_for_to_a_limit(tmp_path, monkeypatch, caplog):
    caplog.set_level(logging.INFO)
    monkeypatch.setattr(files, "TOLD_S", 0.0)
    monkeypatch.setattr(store, "LOCK_S", 0.3)
    database = tmp_path / "mlflow.db"
    with (tmp_path / "mlflow.db.lock").open("a") as other:
        fcntl.flock(other, fcntl.LOCK_EX)
        found = r"mlflow\.db\.lock: another process has held"
        with pytest.raises(InputError, match=found), store.lock_store(f"sqlite:///{database}"):
            pass
        (tmp_path / "log.jsonl").write_text(Header.begin(RUN, "x", None, {}).model_dump_json() + "\n")
        with pytest.raises(InputError, match="another process has held this lock"):
            rebuild(tmp_path, f"sqlite:///{database}", "trial")
    assert any("waiting for it" in message for message in caplog.messages)
    with store.lock_store(f"sqlite:///{database}"):
        pass


def test_the_lock_of_a_server_is_in_a_folder_of_the_users_own(tmp_path, monkeypatch):
    cache, shared = tmp_path / "cache", tmp_path / "tmp"
    monkeypatch.setenv("XDG_CACHE_HOME", str(cache))
    monkeypatch.setattr(store.tempfile, "gettempdir", lambda: str(shared))
    with store.lock_store("http://server"):
        assert len(list((cache / "expertaug").glob("*.lock"))) == 1
    assert (cache / "expertaug").stat().st_mode & 0o777 == 0o700
    (cache / "expertaug").chmod(0o777)
    assert store.private_folder().parent == shared
    shutil.rmtree(shared)
    shared.mkdir()
    (tmp_path / "elsewhere").mkdir()
    (shared / f"expertaug-{store.os.getuid()}").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(InputError, match="cannot be used for locks"):
        store.private_folder()

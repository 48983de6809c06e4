"""The store made again from the logs."""

from __future__ import annotations

import json

import numpy as np
import pytest
from logged import FIELDS, RUN, contents, elsewhere, initial, runs_of, settings, start

import warm_python
from expertaug.errors import InputError
from expertaug.files import write_json
from expertaug.tracking.rebuild import rebuild
from expertaug.tracking.run_log import RunLog
from expertaug.tracking.settings import tracking_of_run


def test_rebuild_equals_the_original(tmp_path, tracking):
    results = tmp_path / "results"
    folder = results / "swing" / "hybrid+" / "seeds_0_1"
    folder.mkdir(parents=True)
    (folder / "model.bin").write_bytes(b"model")
    with RunLog(folder / "log.jsonl", RUN, tracking) as log:
        log.dataset("train", folder / "model.bin")
        log.metrics(0, {"loss": [1, np.nan]})
        log.metrics(2, {"loss": [1.25, 3], "rate": 0.1})
        log.artifact(folder / "model.bin")
    rows = ["experiment,system,method,label,preset,seed,set,metric,value"]
    rows += [f"swing,pendulum,hybrid+,Hybrid+,corrected,{seed},test,log_mse_sum,{-seed - 0.5}" for seed in (0, 1)]
    (folder / "metrics.csv").write_text("\n".join(rows) + "\n")
    with RunLog(folder / "evaluate.jsonl", RUN.model_copy(update={"stage": "evaluate"}), tracking) as log:
        log.table(folder / "metrics.csv")
    again = elsewhere(tracking, experiment="again", uri=f"sqlite:///{tmp_path}/again/mlflow.db")
    assert rebuild(results, again.uri, again.experiment) == 2
    assert repr(contents(again)) == repr(contents(tracking))
    (folder / "evaluate.jsonl").unlink()
    third = elsewhere(tracking, uri=f"sqlite:///{tmp_path}/third/mlflow.db")
    assert rebuild(results, third.uri, third.experiment) == 2
    evaluated = [run for run in runs_of(third) if run.data.tags.get("stage") == "evaluate"]
    assert sorted(run.data.metrics["test/log_mse_sum"] for run in evaluated) == [-1.5, -0.5]


@pytest.mark.slow
def test_rebuild_keeps_the_old_store_aside(tmp_path):
    """The first store is made in a process of its own: MLflow keeps a store open as long as the process lives."""
    results, tracking = tmp_path / "results", settings(tmp_path / "results")
    job = start(str(results / "a" / "log.jsonl"), tracking, FIELDS, 0, python=warm_python.interpreter())
    assert job.communicate(timeout=60)[1] == ""
    assert rebuild(results, tracking.uri, "trial") == 1
    assert (results / "mlflow" / "previous" / "mlflow.db").is_file()
    assert len(runs_of(tracking)) == 3


def test_a_rebuilt_store_numbers_its_experiments_as_before(tmp_path):
    """So that links of a report lead where they led; one that had no number gets the next."""
    results = tmp_path / "results"
    for name in ("slide", "hop", "swing"):
        RunLog(results / name / "log.jsonl", RUN.model_copy(update={"experiment": name})).close()
    found = settings(results)
    marker = results / "mlflow" / "tracking.json"
    write_json(marker, initial(found).model_dump() | {"experiments": {"swing": "1", "hop": "2"}})
    rebuild(results, found.uri, found.experiment)
    assert tracking_of_run(results).experiments == {"swing": "1", "hop": "2", "slide": "3"}
    assert len(runs_of(found)) == 3


def test_rebuild_leaves_the_store_alone_when_it_fails(tmp_path, monkeypatch):
    folder = tmp_path / "mlflow"
    (folder / "artifacts").mkdir(parents=True)
    (folder / "mlflow.db").write_text("old")
    uri = f"sqlite:///{folder}/mlflow.db"
    RunLog(tmp_path / "a.jsonl", RUN).close()

    def broken(*_, **__):
        (folder / "mlflow.db-wal").write_text("of the new one")
        raise OSError("disk gone")

    monkeypatch.setattr("expertaug.tracking.store.connect", broken)
    with pytest.raises(InputError, match="disk gone"):
        rebuild(tmp_path, uri, "trial")
    assert (folder / "mlflow.db").read_text() == "old"
    assert not (folder / "mlflow.db-wal").exists()
    (tmp_path / "log.jsonl").write_text("oops\n")
    with pytest.raises(InputError, match="line 1 is not JSON"):
        rebuild(tmp_path, uri, "trial")


@pytest.mark.parametrize("name", ["mistyped", "empty"])
def test_a_folder_without_logs_is_refused_and_gets_no_store(tmp_path, name):
    (tmp_path / "empty").mkdir()
    uri = f"sqlite:///{tmp_path}/{name}/mlflow/mlflow.db"
    with pytest.raises(InputError, match=f"{name}: no run log and no metrics.csv below it; give the results folder"):
        rebuild(tmp_path / name, uri, "trial")
    assert list(tmp_path.rglob("*")) == [tmp_path / "empty"]


@pytest.fixture
def stranger(tmp_path):
    """A results folder that somebody sent, beside what is one's own: secrets, a log, and a folder called previous."""
    own, results = tmp_path / "own", tmp_path / "results"
    for folder in (own / "previous", results / "a", results / "mlflow"):
        folder.mkdir(parents=True)
    for name in ("secret.csv", "previous/kept"):
        (own / name).write_text("secret")
    RunLog(own / "log.jsonl", RUN).close()
    (results / "a" / "model.safetensors").symlink_to(own / "secret.csv")
    (results / "a" / "good.csv").write_text("good")
    with RunLog(results / "a" / "log.jsonl", RUN) as log:
        for path in (own / "secret.csv", results / "a" / "model.safetensors", results / "a" / "good.csv"):
            log.artifact(path)
    with (results / "a" / "log.jsonl").open("a") as stream:
        stream.write(json.dumps({"event": "artifact", "path": str(own / "secret.csv")}) + "\n")
    (results / "b").symlink_to(own)
    (results / "linked.jsonl").symlink_to(own / "log.jsonl")
    return results


def test_rebuild_reads_and_writes_nothing_outside_a_strangers_folder(stranger, caplog):
    own, before = stranger.parent / "own", sorted(stranger.parent.glob("own/**/*"))
    (stranger / "mlflow" / "mlflow.db").write_bytes(b"")
    (stranger / "mlflow" / "previous").symlink_to(own / "previous")
    (stranger / "mlflow" / "artifacts").symlink_to(own / "missing")
    tracking = settings(stranger)
    assert rebuild(stranger, tracking.uri, tracking.experiment) == 1
    stored = [path for path in (stranger / "mlflow").rglob("*") if path.is_file() and path.suffix != ".db"]
    assert {path.name for path in stored} >= {"good.csv"}
    assert not [path for path in stored if b"secret" in path.read_bytes()]
    assert sorted(stranger.parent.glob("own/**/*")) == before
    assert sum("not in the folder of the log that names it" in message for message in caplog.messages) == 3


def test_a_store_that_a_link_puts_outside_is_not_made(stranger):
    (stranger / "mlflow").rmdir()
    (stranger / "mlflow").symlink_to(stranger.parent / "own")
    before = sorted(stranger.parent.glob("own/**/*"))
    with pytest.raises(InputError, match=r"mlflow: leads out of .*results"):
        rebuild(stranger, settings(stranger).uri, "trial")
    assert sorted(stranger.parent.glob("own/**/*")) == before

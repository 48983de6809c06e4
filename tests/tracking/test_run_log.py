"""The run log: what is in the file, what is in the store, and that neither loses or doubles a step."""

from __future__ import annotations

import json
import logging
import signal
import subprocess
import sys
import textwrap
import time

import numpy as np
import pytest
from logged import FIELDS, RUN, contents, elsewhere, history, runs_of, settings, start

from expertaug.errors import InputError
from expertaug.tracking.log import read_log
from expertaug.tracking.run_log import RunLog
from expertaug.tracking.settings import InitTrackingJob, Tracking
from expertaug.tracking.store import initialise


def test_header_and_values_without_a_store(tmp_path):
    path = tmp_path / "log.jsonl"
    with RunLog(path, RUN) as log:
        log.metrics(0, {"loss": np.array([1.5, np.nan]), "rate": 0.1})
    found = read_log(path)
    assert json.loads(found.header.model_dump_json(include=set(FIELDS))) == FIELDS
    assert found.steps[0].metrics["loss"] == pytest.approx((1.5, np.nan), nan_ok=True)
    assert found.steps[0].metrics["rate"] == 0.1
    assert found.lines[-1].status == "FINISHED"
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    assert lines[1]["loss"] == [1.5, "nan"]


def test_wrong_number_of_values_and_reserved_names(tmp_path):
    log = RunLog(tmp_path / "log.jsonl", RUN)
    with pytest.raises(ValueError, match="3 values for 2 seeds"):
        log.metrics(0, {"loss": [1, 2, 3]})
    with pytest.raises(ValueError, match="reserved"):
        log.metrics(0, {"time": [1, 2]})


def test_status_of_a_failing_job(tmp_path):
    with pytest.raises(RuntimeError), RunLog(tmp_path / "log.jsonl", RUN):
        raise RuntimeError
    assert read_log(tmp_path / "log.jsonl").lines[-1].status == "FAILED"


@pytest.mark.parametrize("damage", ["cut", "removed", "another's"])
def test_a_resumed_log_says_what_is_lost_of_it(tmp_path, damage, caplog):
    path = tmp_path / "log.jsonl"
    log = RunLog(path, RUN)
    for step in range(10):
        log.metrics(step, {"loss": [step, step]})
    state = log.state()
    if damage == "cut":
        path.write_bytes(path.read_bytes()[: state["offset"] // 2])
    elif damage == "removed":
        path.unlink()
    else:
        RunLog(path, RUN).close()
    with RunLog(path, RUN, resume=state) as log:
        log.metrics(10, {"loss": [10, 10]})
    assert log.continued == (damage == "cut")
    found = read_log(path)
    assert found.header.id == state["id"]
    assert 0 < len(found.steps) < 11 and found.steps[-1].step == 10
    (lost,) = (line for line in found.lines if getattr(line, "event", "") == "lines_lost")
    (message,) = caplog.messages
    assert message == f"{path}: {lost.reason}: the curves lack what was logged there"


def test_a_folder_that_cannot_be_made(tmp_path):
    (tmp_path / "closed").write_text("a file")
    with pytest.raises(InputError, match="cannot be written"):
        RunLog(tmp_path / "closed" / "log.jsonl", RUN)


def test_disabled_tracking_never_imports_mlflow(tmp_path):
    code = f"""
        import sys
        from expertaug.tracking.log import Run
        from expertaug.tracking.run_log import RunLog
        from expertaug.tracking.settings import Tracking
        fields = {FIELDS!r}
        off = Tracking(enabled=False, uri="", experiment="")
        with RunLog({str(tmp_path / "log.jsonl")!r}, Run(**fields), off) as log:
            log.metrics(0, {{"loss": [1, 2]}})
        assert not any(name.split(".")[0] == "mlflow" for name in sys.modules)
    """
    subprocess.run([sys.executable, "-c", textwrap.dedent(code)], check=True)


def test_store_holds_what_was_logged(tmp_path, tracking):
    folder = tmp_path / "results" / "swing" / "hybrid+" / "seeds_0_1"
    folder.mkdir(parents=True)
    (folder / "model.bin").write_bytes(b"model")
    (folder / "train.npz").write_bytes(b"data")
    with RunLog(folder / "log.jsonl", RUN, tracking) as log:
        log.dataset("train", folder / "train.npz")
        for step in range(3):
            log.metrics(step, {"loss": [step, 10 + step], "odd=name": [1, 1]})
        log.artifact(folder / "model.bin")
    *children, parent = sorted(contents(tracking))
    assert parent[0] == "Hybrid+ · swing"
    assert [child[0] for child in children] == ["Hybrid+ · seed 0 · train · swing", "Hybrid+ · seed 1 · train · swing"]
    for position, (_, info, tags, parent_name, params, metrics, datasets, artifacts) in enumerate(children):
        assert info[0] == "FINISHED"
        assert parent_name == "Hybrid+ · swing"
        assert (tags["rule"], tags["stage"], tags["seed"]) == ("train", "train", str(position))
        assert params["training.rate"] == "0.001"
        assert (params["widths"], params["nothing"]) == ("[50, 50]", "null")
        assert [row[:2] for row in metrics["loss"]] == [(step, 10 * position + step) for step in range(3)]
        assert "odd_name" in metrics
        assert datasets[0][0] == "swing train"
        assert artifacts == ["model.bin"]


def test_resume_after_a_kill_stores_every_step_once(tmp_path, tracking):
    path = tmp_path / "results" / "a" / "log.jsonl"
    job = start(str(path), tracking, FIELDS | {"stage": "stuck"}, 0)
    state = eval(job.stdout.readline())
    assert job.stdout.readline() == "ready\n"
    job.send_signal(signal.SIGKILL)
    job.wait()
    log = RunLog(path, RUN, tracking, resume=json.loads(json.dumps(state)))
    for step in range(156, 300):
        log.metrics(step, {"loss": [step, step]})
    log.close()
    assert [(line.step, line.metrics["loss"]) for line in read_log(path).steps] == [(k, (k, k)) for k in range(300)]
    children = [run for run in runs_of(tracking) if "seed" in run.data.tags]
    assert len(children) == 2
    for run in children:
        assert run.info.status == "FINISHED"
        assert [row[0] for row in history(tracking, run, "loss")] == list(range(300))


def test_resume_fills_what_an_unreachable_store_missed(tmp_path, tracking):
    path = tmp_path / "results" / "a" / "log.jsonl"
    log = RunLog(path, RUN, elsewhere(tracking, uri="http://127.0.0.1:9"))
    log.metrics(0, {"loss": [1, 2]})
    state = log.state()
    with RunLog(path, RUN, tracking, resume=state) as log:
        log.metrics(1, {"loss": [3, 4]})
    runs = {run.data.tags["seed"]: run for run in runs_of(tracking) if "seed" in run.data.tags}
    assert [row[:2] for row in history(tracking, runs["1"], "loss")] == [(0, 2), (1, 4)]


def test_starting_afresh_closes_what_was_left_open(tmp_path, tracking):
    path = tmp_path / "results" / "a" / "log.jsonl"
    RunLog(path, RUN, tracking).flush()
    with RunLog(path, RUN, tracking) as log:
        log.metrics(0, {"loss": [1, 2]})
    statuses = sorted(run.info.status for run in runs_of(tracking) if "seed" in run.data.tags)
    assert statuses == ["FINISHED", "FINISHED", "KILLED", "KILLED"]
    assert len(read_log(path).steps) == 1


@pytest.mark.slow
def test_two_processes_at_once_make_the_store_and_lose_nothing(tmp_path):
    tracking = settings(tmp_path / "results")
    jobs = []
    for group in ([0, 1], [2, 3]):
        path = tmp_path / "results" / str(group[0]) / "log.jsonl"
        jobs.append(start(str(path), tracking, FIELDS | {"seeds": group}, time.time() + 1))
    errors = [job.communicate(timeout=60)[1] for job in jobs]
    assert errors == ["", ""]
    runs = runs_of(tracking)
    children = [run for run in runs if "seed" in run.data.tags]
    assert sorted(run.data.tags["seed"] for run in children) == ["0", "1", "2", "3"]
    assert len(runs) == 5
    assert len({run.data.tags["mlflow.parentRunId"] for run in children}) == 1
    for run in children:
        assert [row[:2] for row in history(tracking, run, "loss")] == [(k, k) for k in range(300)]


def test_unreachable_server_costs_a_warning_at_first_and_one_at_the_end(tmp_path, caplog):
    tracking = Tracking(enabled=True, uri="http://127.0.0.1:9", experiment="trial")
    before = time.monotonic()
    with caplog.at_level(logging.WARNING), RunLog(tmp_path / "log.jsonl", RUN, tracking) as log:
        for step in range(3):
            log.metrics(step, {"loss": [1, 2]})
            log.flush()
    assert time.monotonic() - before < 10
    first, last = (r.getMessage() for r in caplog.records if r.levelno >= logging.WARNING)
    assert "connection refused" in first
    assert "expertaug rebuild-tracking RESULTS --uri http://127.0.0.1:9 --experiment trial" in last
    assert len(read_log(tmp_path / "log.jsonl").steps) == 3


def test_initialise_warns_where_the_server_is_unreachable(tmp_path, caplog):
    settings = InitTrackingJob(enabled=True, uri="http://127.0.0.1:9", experiment="trial", experiments=["swing"])
    initialise(settings, tmp_path / "marker.json")
    assert len(caplog.records) == 1
    assert json.loads((tmp_path / "marker.json").read_text())["experiments"] is None

"""The run log: what is in the file, what is in the store, and that neither loses or doubles a step."""

from __future__ import annotations

import json
import logging
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import numpy as np
import pytest

from expertaug.errors import InputError
from expertaug.tracking.runlog import RunLog, initialise, read_log, rebuild

FIELDS = {
    "experiment": "swing",
    "method": "hybrid+",
    "label": "Hybrid+",
    "system": "pendulum",
    "preset": "corrected",
    "stage": "train",
    "seeds": [0, 1],
    "params": {"training": {"epochs": 3, "rate": 0.001}, "widths": [50, 50], "nothing": None},
}


def settings(folder: Path) -> dict:
    return {
        "enabled": True,
        "uri": f"sqlite:///{folder}/mlflow/mlflow.db",
        "experiment": "trial",
        "tags": {"rule": "train"},
    }


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    """One store for the module: making one costs seconds, an experiment of its own in it nothing."""
    folder = tmp_path_factory.mktemp("store")
    found = settings(folder)
    initialise(found["uri"], "empty", folder / "marker.json")
    assert json.loads((folder / "marker.json").read_text())["experiment_id"]
    return found


@pytest.fixture
def tracking(store, request):
    return store | {"experiment": request.node.name}


def runs_of(tracking: dict) -> list:
    from mlflow.tracking import MlflowClient

    client = MlflowClient(tracking_uri=tracking["uri"])
    experiment = client.get_experiment_by_name(tracking["experiment"])
    return client.search_runs([experiment.experiment_id], max_results=1000)


def history(tracking: dict, run, key: str) -> list[tuple[int, float, int]]:
    from mlflow.tracking import MlflowClient

    found = MlflowClient(tracking_uri=tracking["uri"]).get_metric_history(run.info.run_id, key)
    return sorted((metric.step, metric.value, metric.timestamp) for metric in found)


def contents(tracking: dict) -> list:
    """All that a store holds, without the ids that every store makes for itself."""
    from mlflow.tracking import MlflowClient

    client = MlflowClient(tracking_uri=tracking["uri"])
    found = []
    for run in runs_of(tracking):
        tags = {k: v for k, v in run.data.tags.items() if k not in ("mlflow.parentRunId",)}
        parent = run.data.tags.get("mlflow.parentRunId")
        found.append(
            (
                run.info.run_name,
                (run.info.status, run.info.start_time, run.info.end_time),
                tags,
                client.get_run(parent).info.run_name if parent else "",
                run.data.params,
                {key: history(tracking, run, key) for key in run.data.metrics},
                sorted((i.dataset.name, i.dataset.digest, i.dataset.source) for i in run.inputs.dataset_inputs),
                sorted(item.path for item in client.list_artifacts(run.info.run_id)),
            )
        )
    return sorted(found, key=repr)


def test_header_and_values_without_a_store(tmp_path):
    path = tmp_path / "log.jsonl"
    with RunLog(path, None, **FIELDS) as log:
        log.metrics(0, {"loss": np.array([1.5, np.nan]), "rate": 0.1})
    found = read_log(path)
    assert {key: found.header[key] for key in FIELDS} == FIELDS
    assert found.steps[0]["loss"] == [1.5, "nan"]
    assert found.steps[0]["rate"] == 0.1
    assert found.lines[-1]["status"] == "FINISHED"
    assert all(json.loads(line) for line in path.read_text().splitlines())


def test_wrong_number_of_values_and_reserved_names(tmp_path):
    log = RunLog(tmp_path / "log.jsonl", None, **FIELDS)
    with pytest.raises(ValueError, match="3 values for 2 seeds"):
        log.metrics(0, {"loss": [1, 2, 3]})
    with pytest.raises(ValueError, match="reserved"):
        log.metrics(0, {"time": [1, 2]})


def test_status_of_a_failing_job(tmp_path):
    with pytest.raises(RuntimeError), RunLog(tmp_path / "log.jsonl", None, **FIELDS):
        raise RuntimeError
    assert read_log(tmp_path / "log.jsonl").lines[-1]["status"] == "FAILED"


def test_torn_last_line_is_ignored_and_a_broken_one_named(tmp_path):
    path = tmp_path / "log.jsonl"
    RunLog(path, None, **FIELDS).close()
    whole = path.read_bytes()
    path.write_bytes(whole + b'{"step": 1, "lo')
    assert len(read_log(path).lines) == 1
    path.write_bytes(whole + b"oops\n")
    with pytest.raises(InputError, match="line 3 is not JSON"):
        read_log(path)


def test_a_folder_that_cannot_be_made(tmp_path):
    (tmp_path / "closed").write_text("a file")
    with pytest.raises(InputError, match="cannot be written"):
        RunLog(tmp_path / "closed" / "log.jsonl", None, **FIELDS)


def test_disabled_tracking_never_imports_mlflow(tmp_path):
    code = f"""
        import sys
        from expertaug.tracking.runlog import RunLog
        fields = {FIELDS!r}
        with RunLog({str(tmp_path / "log.jsonl")!r}, {{"enabled": False}}, **fields) as log:
            log.metrics(0, {{"loss": [1, 2]}})
        assert not any(name.split(".")[0] == "mlflow" for name in sys.modules)
    """
    subprocess.run([sys.executable, "-c", textwrap.dedent(code)], check=True)


def test_store_holds_what_was_logged(tmp_path, tracking):
    folder = tmp_path / "results" / "swing" / "hybrid+" / "seeds_0_1"
    folder.mkdir(parents=True)
    (folder / "model.bin").write_bytes(b"model")
    (folder / "train.npz").write_bytes(b"data")
    with RunLog(folder / "log.jsonl", tracking, **FIELDS) as log:
        log.dataset("train", folder / "train.npz")
        for step in range(3):
            log.metrics(step, {"loss": [step, 10 + step], "odd=name": [1, 1]})
        log.artifact(folder / "model.bin")
    parent, *children = sorted(contents(tracking))
    assert parent[0] == "swing/Hybrid+"
    assert [child[0] for child in children] == ["swing/Hybrid+/seed0", "swing/Hybrid+/seed1"]
    for position, (_, info, tags, parent_name, params, metrics, datasets, artifacts) in enumerate(children):
        assert info[0] == "FINISHED"
        assert parent_name == "swing/Hybrid+"
        assert (tags["rule"], tags["stage"], tags["seed"]) == ("train", "train", str(position))
        assert params["training.rate"] == "0.001"
        assert (params["widths"], params["nothing"]) == ("[50, 50]", "null")
        assert [row[:2] for row in metrics["loss"]] == [(step, 10 * position + step) for step in range(3)]
        assert "odd_name" in metrics
        assert datasets[0][0] == "train"
        assert artifacts == ["model.bin"]


WORKER = """
    import sys, time
    from pathlib import Path
    from expertaug.tracking.runlog import RunLog
    path, tracking, fields, start = eval(sys.argv[1])
    while time.time() < start: pass
    log = RunLog(path, tracking, **fields)
    for step in range(300):
        log.metrics(step, {"loss": [step] * len(fields["seeds"])})
        if step % 10 == 0: log.flush()
        if step == 155:
            print(repr(log.state()), flush=True)
            if fields["stage"] == "stuck":
                for late in range(156, 190): log.metrics(late, {"loss": [-1] * len(fields["seeds"])})
                log.flush()
                log.metrics(190, {"loss": [-1] * len(fields["seeds"])})
                print("ready", flush=True)
                time.sleep(60)
    log.close()
"""


def start(*arguments) -> subprocess.Popen:
    command = [sys.executable, "-c", textwrap.dedent(WORKER), repr(arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def test_resume_after_a_kill_stores_every_step_once(tmp_path, tracking):
    path = tmp_path / "results" / "a" / "log.jsonl"
    job = start(str(path), tracking, FIELDS | {"stage": "stuck"}, 0)
    state = eval(job.stdout.readline())
    assert job.stdout.readline() == "ready\n"
    job.send_signal(signal.SIGKILL)
    job.wait()
    log = RunLog(path, tracking, **FIELDS, resume=json.loads(json.dumps(state)))
    for step in range(156, 300):
        log.metrics(step, {"loss": [step, step]})
    log.close()
    assert [(line["step"], line["loss"]) for line in read_log(path).steps] == [(k, [k, k]) for k in range(300)]
    children = [run for run in runs_of(tracking) if "seed" in run.data.tags]
    assert len(children) == 2
    for run in children:
        assert run.info.status == "FINISHED"
        assert [row[0] for row in history(tracking, run, "loss")] == list(range(300))


def test_resume_fills_what_an_unreachable_store_missed(tmp_path, tracking):
    path = tmp_path / "results" / "a" / "log.jsonl"
    log = RunLog(path, tracking | {"uri": "http://127.0.0.1:9"}, **FIELDS)
    log.metrics(0, {"loss": [1, 2]})
    state = log.state()
    with RunLog(path, tracking, **FIELDS, resume=state) as log:
        log.metrics(1, {"loss": [3, 4]})
    found = read_log(path)
    assert set(found.header["runs"]) == {"0", "1"}
    runs = {run.data.tags["seed"]: run for run in runs_of(tracking) if "seed" in run.data.tags}
    assert [row[:2] for row in history(tracking, runs["1"], "loss")] == [(0, 2), (1, 4)]


def test_starting_afresh_closes_what_was_left_open(tmp_path, tracking):
    path = tmp_path / "results" / "a" / "log.jsonl"
    RunLog(path, tracking, **FIELDS).flush()
    with RunLog(path, tracking, **FIELDS) as log:
        log.metrics(0, {"loss": [1, 2]})
    statuses = sorted(run.info.status for run in runs_of(tracking) if "seed" in run.data.tags)
    assert statuses == ["FINISHED", "FINISHED", "KILLED", "KILLED"]
    assert len(read_log(path).steps) == 1


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


def test_unreachable_server_costs_one_warning(tmp_path, caplog):
    tracking = {"enabled": True, "uri": "http://127.0.0.1:9", "experiment": "trial"}
    before = time.monotonic()
    with caplog.at_level(logging.WARNING), RunLog(tmp_path / "log.jsonl", tracking, **FIELDS) as log:
        for step in range(3):
            log.metrics(step, {"loss": [1, 2]})
            log.flush()
    assert time.monotonic() - before < 10
    assert [record.levelname for record in caplog.records] == ["WARNING"]
    assert "connection refused" in caplog.text
    assert len(read_log(tmp_path / "log.jsonl").steps) == 3


def test_a_store_that_breaks_on_the_way_costs_one_warning(tmp_path, tracking, caplog):
    log = RunLog(tmp_path / "log.jsonl", tracking, **FIELDS)

    def broken(lines):
        raise OSError("disk gone")

    log._mirror.write = broken
    for step in range(3):
        log.metrics(step, {"loss": [1, 2]})
        log.flush()
    log.close()
    assert len(caplog.records) == 1
    assert len(read_log(tmp_path / "log.jsonl").steps) == 3


def test_initialise_warns_where_the_server_is_unreachable(tmp_path, caplog):
    initialise("http://127.0.0.1:9", "trial", tmp_path / "marker.json")
    assert len(caplog.records) == 1
    assert json.loads((tmp_path / "marker.json").read_text())["experiment_id"] is None


def test_rebuild_equals_the_original(tmp_path, tracking):
    results = tmp_path / "results"
    folder = results / "swing" / "hybrid+" / "seeds_0_1"
    folder.mkdir(parents=True)
    (folder / "model.bin").write_bytes(b"model")
    with RunLog(folder / "log.jsonl", tracking, **FIELDS) as log:
        log.dataset("train", folder / "model.bin")
        log.metrics(0, {"loss": [1, np.nan]})
        log.metrics(2, {"loss": [1.25, 3], "rate": 0.1})
        log.artifact(folder / "model.bin")
    rows = ["experiment,system,method,label,preset,seed,set,metric,value"]
    rows += [f"swing,pendulum,hybrid+,Hybrid+,corrected,{seed},test,log_mse_sum,{-seed - 0.5}" for seed in (0, 1)]
    (folder / "metrics.csv").write_text("\n".join(rows) + "\n")
    with RunLog(folder / "evaluate.jsonl", tracking, **(FIELDS | {"stage": "evaluate"})) as log:
        log.table(folder / "metrics.csv")
    again = tracking | {"experiment": "again"}
    again["uri"] = f"sqlite:///{tmp_path}/again/mlflow.db"
    assert rebuild(results, again["uri"], again["experiment"]) == 2
    assert repr(contents(again)) == repr(contents(tracking))
    (folder / "evaluate.jsonl").unlink()
    third = tracking | {"uri": f"sqlite:///{tmp_path}/third/mlflow.db"}
    assert rebuild(results, third["uri"], third["experiment"]) == 2
    evaluated = [run for run in runs_of(third) if run.data.tags.get("stage") == "evaluate"]
    assert sorted(run.data.metrics["test/log_mse_sum"] for run in evaluated) == [-1.5, -0.5]


def test_rebuild_keeps_the_old_store_aside(tmp_path):
    """The first store is made in a process of its own: MLflow keeps a store open as long as the process lives."""
    results, tracking = tmp_path / "results", settings(tmp_path / "results")
    job = start(str(results / "a" / "log.jsonl"), tracking, FIELDS, 0)
    assert job.communicate(timeout=60)[1] == ""
    assert rebuild(results, tracking["uri"], "trial") == 1
    assert (results / "mlflow" / "previous" / "mlflow.db").is_file()
    assert len(runs_of(tracking)) == 3


def test_rebuild_leaves_the_store_alone_when_it_fails(tmp_path, monkeypatch):
    folder = tmp_path / "mlflow"
    (folder / "artifacts").mkdir(parents=True)
    (folder / "mlflow.db").write_text("old")
    uri = f"sqlite:///{folder}/mlflow.db"

    def broken(*_, **__):
        (folder / "mlflow.db-wal").write_text("of the new one")
        raise OSError("disk gone")

    monkeypatch.setattr("expertaug.tracking.mlflow_store.connect", broken)
    with pytest.raises(InputError, match="disk gone"):
        rebuild(tmp_path, uri, "trial")
    assert (folder / "mlflow.db").read_text() == "old"
    assert not (folder / "mlflow.db-wal").exists()
    (tmp_path / "log.jsonl").write_text("oops\n")
    with pytest.raises(InputError, match="line 1 is not JSON"):
        rebuild(tmp_path, uri, "trial")

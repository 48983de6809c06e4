"""The parent run of a method, its data sets and models: what the dashboard shows without unfolding anything."""

from __future__ import annotations

import json

import numpy as np
import pytest
from logged import RUN, elsewhere, runs_of
from mlflow.tracking import MlflowClient
from safetensors.numpy import save_file

from expertaug.tracking.run_log import RunLog, describe_data
from expertaug.tracking.settings import Tracking


def parent_of(tracking: Tracking):
    return next(run for run in runs_of(tracking) if "parent_key" in run.data.tags)


def test_a_parent_has_mean_spread_parameters_data_and_figures(tmp_path, tracking):
    folder = tmp_path / "results" / "swing" / "hybrid+" / "seeds_0_1"
    folder.mkdir(parents=True)
    np.savez(folder / "train.npz", y=np.zeros((5, 3, 2)), t=np.zeros(3))
    (folder / "curve.png").write_bytes(b"a figure")
    with RunLog(folder / "log.jsonl", RUN, tracking) as log:
        log.dataset("train", folder / "train.npz")
        log.metrics(1, {"loss": [9, 9], "validation_score": [1, 2]})
        log.metrics(2, {"loss": [1, 3], "validation_score": [1, 2]})
        log.artifact(folder / "curve.png")
    with RunLog(folder.parent / "seeds_2" / "log.jsonl", RUN.model_copy(update={"seeds": (2,)}), tracking) as log:
        log.metrics(2, {"loss": [8], "validation_score": [6]})
    parent = parent_of(tracking)
    score = "selection score - observed window - per dimension"
    assert parent.data.metrics[score] == 3 and "loss" not in parent.data.metrics
    assert parent.data.metrics[f"{score} sd"] == pytest.approx(np.std([1, 2, 6], ddof=1))
    assert parent.data.params["training.rate"] == "0.001" and "seed" not in parent.data.params
    assert "tables/swing.md" in parent.data.tags["mlflow.note.content"]
    client = MlflowClient(tracking_uri=tracking.uri)
    assert [item.path for item in client.list_artifacts(parent.info.run_id, "seeds_0_1")] == ["seeds_0_1/curve.png"]
    (found,) = parent.inputs.dataset_inputs
    assert found.dataset.name == "swing train" and json.loads(found.dataset.profile) == {"num_rows": 5}
    features = json.loads(found.dataset.schema)["mlflow_tensorspec"]["features"]
    assert {one["name"]: one["tensor-spec"]["shape"] for one in features} == {"y": [5, 3, 2], "t": [3]}


@pytest.mark.parametrize(
    ("one", "other", "worst"),
    [
        ("FINISHED", "FINISHED", "FINISHED"),
        ("KILLED", "FINISHED", "KILLED"),
        ("FAILED", "KILLED", "FAILED"),
        (None, "FINISHED", "RUNNING"),
    ],
)
def test_a_parent_has_the_worst_state_of_its_runs(tmp_path, store, one, other, worst):
    tracking = elsewhere(store, experiment=f"worst {one} {other}")
    for seed, state in enumerate((one, other, "FINISHED")):
        log = RunLog(tmp_path / str(seed) / "log.jsonl", RUN.model_copy(update={"seeds": (seed,)}), tracking)
        if state is None:
            log.flush()  # it still runs
        else:
            log.close(state)
    assert parent_of(tracking).info.status == worst


def test_a_file_of_tensors_is_listed_as_a_model_without_pickle(tmp_path, tracking):
    folder = tmp_path / "results" / "a"
    folder.mkdir(parents=True)
    save_file({"w": np.zeros(3)}, folder / "model.safetensors")
    with RunLog(folder / "log.jsonl", RUN, tracking) as log:
        log.artifact(folder / "model.safetensors")
    client = MlflowClient(tracking_uri=tracking.uri)
    found = client.search_logged_models([parent_of(tracking).info.experiment_id])
    assert sorted(model.name for model in found) == ["swing Hybrid+ seed 0", "swing Hybrid+ seed 1"]
    assert {(model.status.value, model.tags["format"]) for model in found} == {("READY", "safetensors")}
    runs = {run.info.run_id: run for run in runs_of(tracking)}
    for model in found:
        run = runs[model.source_run_id]
        assert [one.model_id for one in run.outputs.model_outputs] == [model.model_id]
        assert model.params["training.rate"] == "0.001"


def test_what_is_no_archive_of_arrays_is_not_describe_data(tmp_path):
    (tmp_path / "model.safetensors").write_bytes(b"tensors")
    assert describe_data(tmp_path / "model.safetensors") == {}

"""Figures of evaluations, and their logs in a tracking store."""

from __future__ import annotations

import json

import pytest
from evaluated_pendulum import SEEDS, asked

from expertaug.evaluation.evaluate import run_stage as evaluate
from expertaug.evaluation.log_evaluations import run_stage as log_evaluations
from expertaug.tracking.settings import Tracking


@pytest.fixture
def evaluated(folder, tmp_path):
    """Forecasts of two versions, each in a folder of its own as the workflow has them."""
    found = []
    for name in ("model", "mean"):
        found.append(tmp_path / name / "forecasts.npz")
        job = asked(name, name.upper())
        evaluate(folder / f"{name}.safetensors", folder, tmp_path / name / "metrics.csv", found[-1], job)
    return found


@pytest.mark.slow
@pytest.mark.usefixtures("quick_stores")
def test_figures_and_metrics_are_artifacts_of_the_tracked_runs(evaluated, tmp_path):
    import mlflow

    tracking = Tracking(enabled=True, uri=f"sqlite:///{tmp_path}/mlflow.db", experiment="test")
    log_evaluations(evaluated[:1], tmp_path / "evaluations.json", tracking)
    log_evaluations(evaluated, tmp_path / "evaluations.json", tracking)  # the first is not stored twice
    assert list(json.loads((tmp_path / "evaluations.json").read_text())["stored"].values()) == [True, True]
    client = mlflow.MlflowClient(tracking.uri)
    experiment = client.get_experiment_by_name("test pendulum").experiment_id
    runs = {run.info.run_id: run for run in client.search_runs([experiment])}
    assert len(runs) == len(client.search_runs([experiment])) == 2 + 2 * len(SEEDS)
    names = {"metrics.csv", "forecasts.png", "parameters.png"}
    made = json.loads((tmp_path / "evaluations.json").read_text())["runs"]  # which run has the numbers of a row
    for label in ("MODEL", "MEAN"):
        for seed in SEEDS:
            run = runs[made[label][str(seed)]]
            assert {f.path for f in client.list_artifacts(run.info.run_id)} == names
            assert "test/log_mse_sum" in run.data.metrics and run.data.tags["rule"] == "evaluate"
            assert (run.info.run_name, run.data.tags["table"]) == (
                f"{label} · seed {seed} · evaluate · pendulum",
                "tables/pendulum.md",
            )
            assert run.info.status == "FINISHED"


def test_a_store_that_fails_is_told_once_and_costs_no_figure(evaluated, tmp_path, caplog):
    (tmp_path / "file").touch()
    tracking = Tracking(enabled=True, uri=f"sqlite:///{tmp_path}/file/mlflow.db", experiment="test")
    log_evaluations(evaluated, tmp_path / "evaluations.json", tracking)
    assert list(json.loads((tmp_path / "evaluations.json").read_text())["stored"].values()) == [False, False]
    assert all((path.with_name("parameters.png")).is_file() for path in evaluated)
    assert sum("failed" in record.getMessage() for record in caplog.records) == 1

"""The study during training: each snapshot is scored, fine-tuned and stored."""

from __future__ import annotations

import pandas as pd
import pytest

from expertaug.evaluation import during_training as following
from expertaug.evaluation.during_training import run_stage as during_training
from expertaug.evaluation.settings import DuringTrainingJob, ForecastScoring
from expertaug.learning import finetune, snapshots
from expertaug.learning.during_training import ModelState, Steps, states
from expertaug.learning.settings import AugmentJob, FinetuneJob, TrainSettings
from expertaug.learning.train import run_stage as train
from expertaug.rows import frame
from expertaug.tracking.log import read_log
from expertaug.tracking.metrics_csv import MetricRow
from expertaug.tracking.settings import Tracking
from expertaug.trajectories import Trajectories
from studied_training import CPU, run
from tiny import PRIOR, but, of_kind


def study_of(settings):
    training = TrainSettings(epochs=9, batch_size=20)
    return of_kind(
        DuringTrainingJob,
        settings,
        augment=of_kind(AugmentJob, settings, method="aphynity+", prior=PRIOR, noise=0.01),
        finetune=of_kind(FinetuneJob, settings, method="aphynity+", label="APHYNITY+", training=training),
        finetune_epochs=[1, 2],
        evaluation=ForecastScoring(max_samples=7),
    )


def in_memory(snapshots_file, data, settings):
    """The rows of a study's job, without a file of its own."""
    trained = [ModelState(k, 0, stored) for k, stored in snapshots.load(snapshots_file, CPU).items()]
    sets = {name: Trajectories.load(data / f"{name}.npz") for name in ("train", "validation", "test")}
    steps = Steps(sets["train"], sets["validation"])
    models = states(trained, steps, settings.augment, settings.finetune, settings.finetune_epochs)
    return following.during_training(models, sets, settings)


@pytest.mark.slow
def test_every_snapshot_is_scored_before_and_after_fine_tuning(data, tmp_path, settings, monkeypatch):
    run(data, tmp_path, but(settings, snapshots=[1, 3]))
    study = study_of(settings)
    tune, trained = finetune.finetune, []

    def dying(*arguments):
        if len(trained) == 2:
            raise KeyboardInterrupt
        trained.append(arguments[4].training.epochs)
        return tune(*arguments)

    files = tmp_path / snapshots.NAME, data, tmp_path / "during_training.csv", tmp_path / "work_during_training"
    monkeypatch.setattr(finetune, "finetune", dying)
    with pytest.raises(KeyboardInterrupt):
        during_training(*files, study, None)
    assert trained == [1, 2] and not files[2].exists()
    assert read_log(tmp_path / "during_training.jsonl").lines[-1].status == "KILLED"
    calls = []
    monkeypatch.setattr(finetune, "finetune", lambda *a: calls.append(a[4].training.epochs) or tune(*a))
    during_training(*files, study, None)
    assert calls == [1, 2], "those of the first snapshot were there already"
    assert not files[3].exists()
    table = pd.read_csv(files[2])
    assert set(zip(table["epoch"], table["finetune_epochs"], strict=True)) == {
        (e, f) for e in (1, 3) for f in (0, 1, 2)
    }
    scores = table[table["metric"] == "log_mse_sum"].set_index(["epoch", "finetune_epochs", "set", "seed"])["value"]
    assert len(scores) == 2 * 3 * 3 * 2 and scores.is_unique
    rows = frame(MetricRow, in_memory(files[0], data, study))
    timed = table["metric"] == "estimate_ms"
    pd.testing.assert_frame_equal(rows[~timed], table[~timed], check_exact=True)


@pytest.mark.slow
@pytest.mark.usefixtures("quick_stores")
def test_a_block_is_a_run_of_each_seed_below_its_method(data, tmp_path, settings):
    from mlflow.tracking import MlflowClient

    tracking = Tracking(enabled=True, uri=f"sqlite:///{tmp_path}/mlflow/mlflow.db", experiment="trial")
    train(data, tmp_path / "model.safetensors", tmp_path / "work", but(settings, snapshots=[1, 3]), tracking)
    during_training(
        tmp_path / snapshots.NAME,
        data,
        tmp_path / "during_training.csv",
        tmp_path / "during_training",
        study_of(settings),
        tracking,
    )
    client = MlflowClient(tracking_uri=tracking.uri)
    runs = client.search_runs([client.get_experiment_by_name(tracking.name_of(settings.experiment)).experiment_id])
    parents = {run.data.tags["mlflow.parentRunId"] for run in runs if "seed" in run.data.tags}
    assert len(parents) == 1, "the method's training and its study have one parent"
    found = {int(run.data.tags["seed"]): run for run in runs if run.data.tags.get("stage") == "during_training"}
    assert set(found) == {0, 1} and {run.info.status for run in found.values()} == {"FINISHED"}
    keys = ["seed", "set", "metric", "finetune_epochs", "epoch"]
    table = pd.read_csv(tmp_path / "during_training.csv").set_index(keys)["value"].sort_index()
    for seed, one in found.items():
        assert one.data.params["epochs"] == "[1, 3]" and one.data.params["finetune_epochs"] == "[1, 2]"
        assert {d.dataset.name for d in one.inputs.dataset_inputs} == {
            f"pendulum {name}" for name in ("train", "validation", "test")
        }
        assert [item.path for item in client.list_artifacts(one.info.run_id)] == ["during_training.csv"]
        for name in ("train", "validation", "test"):
            for count, end in {0: "", 1: "_finetuned_1", 2: "_finetuned_2"}.items():
                history = client.get_metric_history(one.info.run_id, f"{name}/log_mse_sum{end}")
                scores = table[seed, name, "log_mse_sum", count].to_dict()
                assert {metric.step: metric.value for metric in history} == pytest.approx(scores)


def test_the_study_is_a_call_in_memory(data, tmp_path, settings, monkeypatch):
    run(data, tmp_path, but(settings, snapshots=[1]))
    before = sorted(tmp_path.rglob("*"))
    monkeypatch.chdir(tmp_path)
    rows = in_memory(tmp_path / snapshots.NAME, data, but(study_of(settings), finetune_epochs=[1]))
    scores = {(row.set, row.seed, row.finetune_epochs): row.value for row in rows if row.metric == "log_mse_sum"}
    assert len(scores) == 3 * 2 * 2 == len(set(scores.values())) and {row.epoch for row in rows} == {1}
    assert sorted(tmp_path.rglob("*")) == before

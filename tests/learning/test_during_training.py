"""Snapshots of a training, and what is made of them."""

from expertaug.learning import snapshots
from studied_training import in_memory, run, study_of
from tiny import but


def test_the_study_is_a_call_in_memory(data, tmp_path, settings, monkeypatch):
    run(data, tmp_path, but(settings, snapshots=[1]))
    before = sorted(tmp_path.rglob("*"))
    monkeypatch.chdir(tmp_path)
    rows = in_memory(tmp_path / snapshots.NAME, data, but(study_of(settings), finetune_epochs=[1]))
    scores = {(row.set, row.seed, row.finetune_epochs): row.value for row in rows if row.metric == "log_mse_sum"}
    assert len(scores) == 3 * 2 * 2 == len(set(scores.values())) and {row.epoch for row in rows} == {1}
    assert sorted(tmp_path.rglob("*")) == before

"""Snapshots of a training are the states that it went through."""

from __future__ import annotations

import pytest
import torch

from expertaug.learning import snapshots
from expertaug.learning.trainer import Trainer
from expertaug.models import store
from studied_training import CPU, run
from tiny import but


def same(first, second):
    return all(torch.equal(first[k], second[k]) for k in first)


def test_snapshots_are_the_states_after_their_passes_and_change_nothing(data, trained, tmp_path, settings):
    plain = store.load(trained).model.state_dict()
    assert not (trained.parent / snapshots.NAME).exists()
    kept = run(data, tmp_path / "kept", but(settings, snapshots=[1, 3]))
    assert same(plain, kept)
    found = snapshots.load(tmp_path / "kept" / snapshots.NAME, CPU)
    assert list(found) == [1, 3] and found[1].seeds == [0, 1]
    assert not same(found[1].model.state_dict(), found[3].model.state_dict())
    last = store.load(tmp_path / "kept/model.safetensors")
    if last.card.best_epoch == [3, 3]:
        assert same(found[3].model.state_dict(), kept)
    assert found[1].card.carried is not None and found[1].card.wall_s > 0


def test_snapshots_survive_a_kill(data, tmp_path, settings, monkeypatch):
    settings = but(settings, snapshots=[1, 2, 3])
    run(data, tmp_path / "whole", settings)
    step, count = Trainer.step, iter(range(10**6))

    def dying(self, *args):
        if next(count) == 9:  # in the third pass
            raise KeyboardInterrupt
        return step(self, *args)

    monkeypatch.setattr(Trainer, "step", dying)
    with pytest.raises(KeyboardInterrupt):
        run(data, tmp_path / "killed", settings)
    monkeypatch.undo()
    run(data, tmp_path / "killed", settings)
    whole, killed = (snapshots.load(tmp_path / name / snapshots.NAME, CPU) for name in ("whole", "killed"))
    assert all(same(whole[k].model.state_dict(), killed[k].model.state_dict()) for k in (1, 2, 3))

"""Trainings as a stage: seeds that cannot be trained are left out, and what makes no sense is refused."""

from __future__ import annotations

import json
import math

import pytest
import torch

from expertaug.errors import InputError, SolveError
from expertaug.learning.augment import run_stage as augment
from expertaug.learning.finetune import run_stage as finetune
from expertaug.learning.objectives import Aphynity
from expertaug.learning.settings import AugmentJob, FinetuneJob
from expertaug.learning.train import run_stage as train
from expertaug.learning.trainer import Trainer
from expertaug.models import store
from tiny import PRIOR, but, of_kind


def test_a_first_training_has_nothing_to_bound_z_a_by(data, tmp_path, settings):
    bounding = but(settings, training=but(settings.training, bound_z_a=True))
    with pytest.raises(InputError, match=r"training\.bound_z_a: found true; say it of fine-tuning"):
        train(data, tmp_path / "m.st", tmp_path / "w", bounding, None)


@pytest.fixture
def failing(monkeypatch):
    """Call it: from then on the second seed's gradient is not finite from its 2nd step on."""

    def break_it(factor=(1.0, math.nan)):
        loss, steps = Aphynity.loss, iter(range(10**6))
        monkeypatch.setattr("expertaug.learning.trainer.SKIPPED_LIMIT", 3)

        def broken(self, *args):
            value, parts = loss(self, *args)
            return (value * torch.tensor(factor) if next(steps) >= 1 else value), parts

        monkeypatch.setattr(Aphynity, "loss", broken)

    return break_it


def events(folder):
    lines = [json.loads(line) for line in (folder / "log.jsonl").open()]
    return [(x["seed"], x["reason"]) for x in lines if x.get("event") == "seed_failed"]


def test_a_seed_that_cannot_be_trained_is_left_out_and_the_others_go_on(
    data, trained, tmp_path, settings, caplog, failing
):
    failing()
    train(data, tmp_path / "m.st", tmp_path / "work", settings, None)
    whole, left = store.load(trained), store.load(tmp_path / "m.st")
    assert (whole.failed, left.failed) == ([], [1])
    for name, value in left.model.state_dict().items():
        assert torch.equal(value[0], whole.model.state_dict()[name][0]), "the other seed's bits"
        assert torch.isfinite(value).all()
    assert caplog.text.count("seed 1 cannot be trained and is left out: the gradient was not finite") == 1
    assert events(trained.parent) == []
    ((seed, reason),) = events(tmp_path)
    assert seed == 1 and "3 steps in a row" in reason


def test_a_seed_that_failed_is_left_alone_by_finetuning(data, tmp_path, settings, failing):
    failing()
    train(data, tmp_path / "m.st", tmp_path / "work", settings, None)
    augment(tmp_path / "m.st", data, tmp_path / "p.st", of_kind(AugmentJob, settings, prior=PRIOR, noise=0.0))
    job = of_kind(FinetuneJob, settings)
    finetune(tmp_path / "m.st", tmp_path / "p.st", data, tmp_path / "plus/m.st", tmp_path / "w", job, None)
    before, after = store.load(tmp_path / "m.st"), store.load(tmp_path / "plus/m.st")
    assert after.failed == [1] and [seed for seed, _ in events(tmp_path / "plus")] == [1]
    same = {
        k: [torch.equal(v[s], after.model.state_dict()[k][s]) for s in (0, 1)]
        for k, v in before.model.state_dict().items()
    }
    assert all(second for _, second in same.values()) and not all(first for first, _ in same.values())


def test_a_seed_without_a_finite_validation_score_is_left_out(data, tmp_path, settings, monkeypatch):
    monkeypatch.setattr(Trainer, "score", lambda self: torch.tensor([math.inf, 1.0]))
    train(data, tmp_path / "m.st", tmp_path / "work", settings, None)
    stored = store.load(tmp_path / "m.st")
    assert stored.failed == [0] and stored.card.best_score == [None, 1.0]
    assert "no validation forecast" in events(tmp_path)[0][1]


def test_a_killed_training_remembers_who_failed(data, tmp_path, settings, failing, monkeypatch):
    failing()
    train(data, tmp_path / "whole/m.st", tmp_path / "whole/work", settings, None)
    monkeypatch.undo()
    failing()
    steps, count = Trainer.step, iter(range(10**6))

    def dying(self, *args):
        if next(count) == 11:  # in the last pass; the failure was in the one before
            raise KeyboardInterrupt
        return steps(self, *args)

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(Trainer, "step", dying)
        train(data, tmp_path / "m.st", tmp_path / "work", settings, None)
    train(data, tmp_path / "m.st", tmp_path / "work", settings, None)
    whole, again = (store.load(tmp_path / name) for name in ("whole/m.st", "m.st"))
    assert whole.failed == again.failed == [1]
    assert len(events(tmp_path)) == 1


def test_when_all_seeds_fail_the_training_ends(data, tmp_path, settings, failing):
    failing((math.nan, math.nan))
    with pytest.raises(SolveError, match=r"seeds 0, 1: the gradient was not finite"):
        train(data, tmp_path / "m.st", tmp_path / "work", settings, None)

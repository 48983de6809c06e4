"""Seeds that are behind the best of their group are begun anew."""

from __future__ import annotations

import json

import pytest
import torch

from expertaug.learning.train import FURTHER
from expertaug.learning.train import run_stage as train
from expertaug.learning.trainer import Trainer
from expertaug.models import store
from nightly import others_slow
from tiny import SETTINGS, but

RESTARTED = {"restarts": 2, "restart_gap": 1e-6}  # whatever is not the best


def run(data, folder, settings, **training):
    job = but(settings, training=but(settings.training, **training))
    train(data, folder / "model.safetensors", folder / "work", job, None)
    return store.load(folder / "model.safetensors")


def lines(folder):
    return [json.loads(line) for line in (folder / "log.jsonl").open()]


@pytest.fixture(scope="module")
def three():
    return but(SETTINGS, seeds=[0, 1, 2])


@pytest.fixture(scope="module")
def folder(data, three, tmp_path_factory):
    """Of a training of three seeds in which two are begun anew."""
    folder = tmp_path_factory.mktemp("restarted")
    run(data, folder, three, **RESTARTED)
    return folder


def test_a_seed_behind_is_begun_anew_and_its_better_state_kept(data, three, folder, tmp_path):
    plain, restarted = run(data, tmp_path, three), store.load(folder / "model.safetensors")
    before, after = plain.card.best_score, restarted.card.best_score
    best = before.index(min(before))
    assert plain.card.restarts is None and restarted.card.restarts[best] in (0, 2)
    assert max(restarted.card.restarts) == 2
    assert all(new <= old for new, old in zip(after, before, strict=True)) and after != before
    for name, value in plain.model.state_dict().items():
        for place in range(3):
            same = torch.equal(value[place], restarted.model.state_dict()[name][place])
            assert same or after[place] < before[place]
    events = [line for line in lines(folder) if line.get("event") == "seed_restarted"]
    assert events and all({"seed", "before", "after", "kept"} <= line.keys() for line in events)
    assert any(line.get("restarts") == [float(n) for n in restarted.card.restarts] for line in lines(folder))


@pytest.mark.slow
def test_a_restart_is_the_training_of_another_seed(data, tmp_path, settings):
    restarted = run(data, tmp_path / "restarted", settings, restarts=3, restart_gap=1e-6)
    events = [line for line in lines(tmp_path / "restarted") if line.get("event") == "seed_restarted"]
    last = {event["seed"]: number for number, event in enumerate(events, 1) if event["kept"]}
    assert last, "one of three is better"
    for seed, number in last.items():  # a seed of two is alone where it is begun anew
        other = run(data, tmp_path / f"other{seed}", but(settings, seeds=[seed + number * FURTHER]))
        assert restarted.card.best_score[seed] == other.card.best_score[0]
        assert restarted.card.carried["lambda0"][seed] == other.card.carried["lambda0"][0]
        for name, value in other.model.state_dict().items():
            assert torch.equal(value[0], restarted.model.state_dict()[name][seed])


@pytest.mark.parametrize("last", others_slow([14, 9, 26]), ids=["first restart", "first training", "second restart"])
def test_a_restart_that_is_killed_goes_on_to_the_same_bits(data, three, folder, tmp_path, monkeypatch, last):
    whole = store.load(folder / "model.safetensors")
    step, taken = Trainer.step, []

    def counted(self, *arguments):
        if len(taken) == last:
            raise KeyboardInterrupt
        taken.append(1)
        return step(self, *arguments)

    monkeypatch.setattr(Trainer, "step", counted)
    with pytest.raises(KeyboardInterrupt):
        run(data, tmp_path, three, **RESTARTED)
    taken.clear()
    monkeypatch.setattr(Trainer, "step", lambda self, *arguments: taken.append(1) or step(self, *arguments))
    again = run(data, tmp_path, three, **RESTARTED)
    assert len(taken) <= 36 - last + 4, "what was done before the kill is not done again"
    assert again.card.but(wall_s=0) == whole.card.but(wall_s=0)
    for name, value in whole.model.state_dict().items():
        assert torch.equal(value, again.model.state_dict()[name])


def test_seeds_that_agree_are_left_alone(data, tmp_path, settings):
    card = run(data, tmp_path, settings, restarts=2, restart_gap=50.0).card
    assert card.restarts == [0, 0]

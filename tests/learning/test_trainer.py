"""Blocks of seeds, resuming, selection: the promises that the trainer makes."""

import json
import re

import pytest
import torch

from expertaug.errors import InputError, SolveError
from expertaug.learning import objectives
from expertaug.learning.job import Checkpoint, fingerprint, lock_job
from expertaug.learning.objectives import finite_forecast
from expertaug.learning.train import run_stage as train
from expertaug.learning.trainer import Trainer
from expertaug.models import store
from expertaug.trajectories import Trajectories
from tiny import but


def run(data, folder, settings):
    train(data, folder / "model.safetensors", folder / "work", settings, None)
    return (folder / "model.safetensors").read_bytes()


def test_same_seed_same_bits_apart_from_the_time_it_took(data, trained, tmp_path, settings):
    run(data, tmp_path, settings)
    first, second = (store.load(path).model.state_dict() for path in (trained, tmp_path / "model.safetensors"))
    assert all(torch.equal(first[k], second[k]) for k in first)


def test_one_step_of_a_seed_is_the_same_alone_and_in_a_block(data, tmp_path, settings):
    """To rounding: batched products sum in another order."""
    settings = but(settings, seeds=[5, 6, 7], training=but(settings.training, epochs=1, batch_size=40))
    run(data, tmp_path / "group", settings)
    group = store.load(tmp_path / "group/model.safetensors").model.state_dict()
    for place, seed in enumerate(settings.seeds):
        run(data, tmp_path / str(seed), but(settings, seeds=[seed]))
        alone = store.load(tmp_path / str(seed) / "model.safetensors").model.state_dict()
        for name, value in alone.items():
            torch.testing.assert_close(group[name][place], value[0], rtol=1e-3, atol=1e-5)


def test_a_killed_training_resumes_to_the_same_bits(data, trained, tmp_path, settings, killed):
    whole = store.load(trained).model.state_dict()
    taken = killed(run, data, tmp_path / "killed", settings)
    assert (tmp_path / "killed/work/checkpoint.pt").exists()
    assert not (tmp_path / "killed/model.safetensors").exists()
    run(data, tmp_path / "killed", settings)
    resumed = store.load(tmp_path / "killed/model.safetensors").model.state_dict()
    assert len(taken) == 4, "only the last pass is left"
    assert all(torch.equal(whole[k], resumed[k]) for k in whole)
    assert not (tmp_path / "killed/work").exists()
    folders = trained.parent, tmp_path / "killed"
    logs = [[json.loads(line) for line in (folder / "log.jsonl").open()] for folder in folders]
    losses = [[(line["step"], line["loss"]) for line in log if "loss" in line] for log in logs]
    assert losses[0] == losses[1] and len(losses[0]) == 3, "no line lost, none twice"


def test_a_killed_training_begins_again_under_a_changed_own_module(data, tmp_path, settings, killed, monkeypatch):
    (tmp_path / "own_lab").mkdir()
    own = tmp_path / "own_lab" / "system.py"
    own.write_text("from expertaug.systems.pendulum import DampedPendulum\n\n\nclass Own(DampedPendulum):\n    pass\n")
    monkeypatch.syspath_prepend(tmp_path)
    settings = but(settings, system={"name": "own_lab.system"})
    taken = killed(run, data, tmp_path, settings)
    assert (tmp_path / "work/checkpoint.pt").exists()
    own.write_text(own.read_text() + "# changed\n")
    run(data, tmp_path, settings)
    assert len(taken) == 12, "all three passes"


def test_a_changed_setting_starts_afresh(tmp_path):
    first, other = (fingerprint({"rate": rate}, [], ["expertaug.learning.train"]) for rate in (1, 2))
    Checkpoint(tmp_path / "work", first).save({"epoch": 1})
    assert Checkpoint(tmp_path / "work", first).load() == {"epoch": 1}
    assert Checkpoint(tmp_path / "work", other).load() is None


def test_a_folder_in_a_checkpoints_place_is_told_before_anything_runs(tmp_path):
    (tmp_path / "work" / "checkpoint.pt").mkdir(parents=True)
    with pytest.raises(InputError, match=r"checkpoint\.pt: is a folder; remove it"):
        Checkpoint(tmp_path / "work", "x").load()


def test_two_processes_do_not_run_one_job(tmp_path):
    with lock_job(tmp_path / "work"), pytest.raises(InputError, match="another process"), lock_job(tmp_path / "work"):
        pass


def test_the_best_model_by_validation_is_kept(data, tmp_path, settings, monkeypatch):
    scores = iter([[1.0, 3.0], [2.0, 2.0], [3.0, 4.0]])
    states = []

    def score(self):
        states.append({k: v.clone() for k, v in self.model.state_dict().items()})
        return torch.tensor(next(scores))

    monkeypatch.setattr(Trainer, "score", score)
    run(data, tmp_path, settings)
    stored = store.load(tmp_path / "model.safetensors")
    assert stored.card.best_epoch == [1, 2]
    for name, value in stored.model.state_dict().items():
        assert torch.equal(value[0], states[0][name][0])
        assert torch.equal(value[1], states[1][name][1])


def test_a_seed_that_never_has_a_gradient_is_named(data, tmp_path, settings, monkeypatch):
    monkeypatch.setattr("expertaug.learning.trainer.SKIPPED_LIMIT", 3)
    broken = Trajectories.load(data / "train.npz")
    for name in ("train", "validation"):
        Trajectories(broken.t, broken.y * 1e18, broken.z_e).save(tmp_path / f"{name}.npz")
    with pytest.raises(SolveError, match=r"pendulum/APHYNITY.*seeds 0, 1.*learning_rate"):
        run(tmp_path, tmp_path, settings)


@pytest.mark.parametrize(("window", "longest"), [("observed", 11), ("half_batch", 21)])
def test_the_loss_window_grows_to_that_of_the_preset(data, tmp_path, settings, monkeypatch, window, longest):
    solved, points = [], finite_forecast
    monkeypatch.setattr(objectives, "finite_forecast", lambda *a, **k: solved.append(a[5]) or points(*a, **k))
    choices, growing = but(settings.choices, loss_window=window), but(settings.training, horizon_warmup=0.5)
    run(data, tmp_path, but(settings, choices=choices, training=growing))
    assert solved == sorted(solved) and solved[0] < longest / 2 and solved[len(solved) // 2] == solved[-1] == longest


def test_the_expert_is_alone_first(data, tmp_path, settings, monkeypatch):
    """And F_a stays as it was meanwhile; its first size is the configuration's."""
    sizes, loss = [], objectives.Aphynity.loss

    def watched(self, model, batch, task):
        sizes.append(
            0.0 if model.interaction is None else float(model.interaction.rest.layers[-1].weight.detach().abs().max())
        )
        return loss(self, model, batch, task)

    monkeypatch.setattr(objectives.Aphynity, "loss", watched)
    model = but(settings.model, interaction={**settings.model.interaction, "start": 0.01})
    run(data, tmp_path, but(settings, model=model, training=but(settings.training, expert_first=0.5)))
    first, rest = sizes[:6], sizes[6:]
    assert set(first) == {0.0} and len(rest) == 6
    assert 0 < rest[0] <= 0.01 / 6**0.5 and rest[-1] != rest[0]


@pytest.mark.parametrize(
    ("over", "says"),
    [
        ({"start": {"omga": [0.0, 1.0]}}, "start.omga: 'omga' is no component of the state; did you mean 'omega'?"),
        ({"prior": {"omga0": [0.5, 3.5]}}, "prior.omga0: 'omga0' is no expert parameter; did you mean 'omega0'?"),
        ({"build": {"kind": "hybrid", "system": {"frictn": 1.0}}}, "build.system.frictn: unknown key; did you mean"),
    ],
)
def test_a_name_that_the_system_has_not_is_refused_before_a_training(data, tmp_path, settings, over, says):
    with pytest.raises(InputError, match=re.escape(says)):
        run(data, tmp_path, but(settings, **over))
    assert not (tmp_path / "model.safetensors").exists()

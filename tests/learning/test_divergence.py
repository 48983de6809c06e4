"""Runaways: the bound, and that loss, multiplier, selection and augmentation obey it; seeds that cannot be trained."""

import json
import logging
import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from cards import card
from expertaug import systems
from expertaug.errors import SolveError
from expertaug.learning import augment as augmentation
from expertaug.learning.augment import run_stage as augment
from expertaug.learning.divergence import clamp_to_bound, divergence_bound, forecast_or_fallback, within_bound
from expertaug.learning.finetune import run_stage as finetune
from expertaug.learning.objectives import Aphynity, finite_forecast
from expertaug.learning.residuals import mean_squared_error
from expertaug.learning.settings import AugmentJob, FinetuneJob, TrainSettings
from expertaug.learning.train import run_stage as train
from expertaug.learning.trainer import Trainer
from expertaug.learning.training_data import StackedSet, task_of
from expertaug.models import store
from expertaug.models.estimators import Hybrid
from expertaug.presets import resolve
from expertaug.systems.solvers.solver import Solver
from expertaug.trajectories import Trajectories
from seen import seen
from tiny import PRIOR, but, of_kind

CPU = torch.device("cpu")


@pytest.fixture
def trained(data, tmp_path, settings):
    job = but(settings, training=but(settings.training, epochs=1))
    train(data, tmp_path / "model.safetensors", tmp_path / "work", job, None)
    return store.load(tmp_path / "model.safetensors")


def batch_of(data, seeds=2):
    return StackedSet.of(Trajectories.load(data / "train.npz"), CPU).whole(seeds)


def test_ten_times_the_largest_value_of_each_component():
    y = np.zeros((2, 3, 2, 4))
    y[1, 2, 0, 3], y[0, 1, 1, 0] = -7.0, 0.5
    assert divergence_bound(y) == [70.0, 5.0]
    y[:, :, 1] = 0
    assert divergence_bound(y[..., 0]) == [10.0, 10.0], "all zero"
    assert divergence_bound(y) == [70.0, 0.07], "a component that is zero in the training set may move a little"


def test_what_lies_beyond_is_moved_to_the_bound_and_the_rest_is_not_touched():
    y = torch.tensor([[1.0, -3.0], [math.nan, 2.0], [-math.inf, 9.0], [0.1, -0.2]]).view(1, 1, 4, 2)
    bound = torch.tensor([2.0, 4.0])
    assert within_bound(y, bound).tolist() == [[True, False, False, True]]
    assert within_bound(y, None).tolist() == [[True, False, False, True]]
    assert clamp_to_bound(y, bound).view(4, 2).tolist() == [[1.0, -3.0], [2.0, 2.0], [-2.0, 4.0], y[0, 0, 3].tolist()]
    field = y.view(1, 2, 1, 2, 2)
    assert clamp_to_bound(field, bound)[0, 0, 0].tolist() == [[1.0, -2.0], [4.0, 2.0]], (
        "the first axis has the components"
    )


def test_the_model_file_has_the_bound_and_finetuning_keeps_it(data, tmp_path, settings, trained):
    y = Trajectories.load(data / "train.npz").y
    assert trained.card.bound == pytest.approx((10 * np.abs(y).max((0, 1))).tolist())
    drawing = of_kind(AugmentJob, settings, prior=PRIOR, noise=0.0)
    augment(tmp_path / "model.safetensors", data, tmp_path / "p", drawing)
    args = tmp_path / "model.safetensors", tmp_path / "p", data, tmp_path / "plus", tmp_path / "w"
    finetune(*args, of_kind(FinetuneJob, settings, training=but(settings.training, epochs=1)), None)
    tuned = store.load(tmp_path / "plus")
    assert tuned.card.bound == trained.card.bound and tuned.card.failed == []
    assert task_of(TrainSettings(), tuned.card.but(bound=None), CPU).bound is None


def double_pendulum(latent=2):
    description = {"system": {"name": "double_pendulum", "expert": "point_mass"}, "seeds": [0, 1], "observed": 11}
    encoder = {"kind": "window", "windows": {"theta1": [0.0, 0.1]}, "angles": ["theta1"], "layers": [5]}
    description |= {"t": [0.01 * k for k in range(20)], "expert": True, "interaction": True}
    description["model"] = {"encoder": encoder | {"latent": latent}, "interaction": {"kind": "mlp", "layers": [4]}}
    description["bound"] = [30.0, 30.0, 500.0, 500.0]
    model = Hybrid.network(systems.load(description["system"]), card(description))
    return model, task_of(TrainSettings(horizon_s=0.19), card(description), CPU)


def test_a_finite_forecast_beyond_the_bound_is_left_out_of_the_loss():
    model, task = double_pendulum()
    task = replace(task, bound=torch.tensor([30.0, 30.0, 20.0, 20.0]))
    y0, z_a = torch.rand(2, 3, 4), torch.rand(2, 3, 2)
    z_e = torch.tensor([[[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]] * 2)
    z_e[0, 1] = 25.0
    assert torch.isfinite(model.forecast(y0, z_e, z_a, task.t, task.solver)).all()
    z_e.requires_grad_()
    prediction, good = finite_forecast(model, y0, z_e, z_a, task, 20)
    assert good.tolist() == [[True, False, True], [True, True, True]]
    loss = mean_squared_error(model.system, prediction[1:], torch.zeros(19, 2, 3, 4), good)
    loss.sum().backward()
    assert (z_e.grad[0, 1] == 0).all() and (z_e.grad[0, 0] != 0).all()
    free, every = finite_forecast(model, y0, z_e, z_a, replace(task, bound=None), 20)
    assert every is None and free.abs().max() >= 25


def test_where_the_mean_latents_run_away_too_another_sample_stands_in():
    """Its angle starts beyond the bound, whatever the latents are; and of the two parts the second has no z_a."""
    model, task = double_pendulum()
    y0, z_a = torch.rand(2, 6, 4), torch.rand(2, 3, 2, requires_grad=True)
    y0[0, 1, 0], y0[1, 5, 1] = 40.0, math.nan
    z_e = torch.rand(2, 6, 2)
    prediction, good = finite_forecast(model, y0, z_e, z_a, task, 20)
    assert (~good).nonzero().tolist() == [[0, 1], [1, 5]]
    assert torch.equal(prediction[:, 0, 1], prediction[:, 0, 0]), "the first good sample"
    assert torch.equal(prediction[:, 1, 5], prediction[:, 1, 3]), "the first good one that follows the expert alone"
    prediction.sum().backward()
    assert torch.isfinite(z_a.grad).all() and (z_a.grad[0, 1] == 0).all()


def test_a_runaway_does_not_feed_the_multiplier(data, trained):
    task, batch = task_of(TrainSettings(), trained.card, CPU), batch_of(data)
    wild = replace(batch, trajectories=seen(batch.y.clone()))
    wild.y[:, :, 3] = 1e18  # the squared error of a forecast from there is infinite
    found = []
    for one in (batch, wild):
        objective = Aphynity([0, 1], resolve("corrected"))
        _, parts = objective.loss(trained.model, one, task)
        objective.end_of_pass()
        found.append((objective.multiplier, parts["runaway_share"]))
    assert found[0][1].tolist() == [0, 0] and found[1][1].tolist() == pytest.approx([1 / 40] * 2)
    torch.testing.assert_close(found[1][0], found[0][0], rtol=0.2, atol=0)


def test_validation_counts_a_runaway_at_the_bound(data, trained):
    batch = StackedSet.of(Trajectories.load(data / "validation.npz"), CPU)
    whole, points = batch.whole(2), range(1, 11)
    task = task_of(TrainSettings(), trained.card, CPU)
    z_e, z_a = trained.model.encode(seen(whole.y[: task.observed])).mean
    free = trained.model.forecast(whole.y[0], z_e, z_a, task.t[:11], task.solver)[1:].detach()
    for bound in (torch.tensor([0.1, 0.2]), task.bound):
        one = replace(task, bound=bound)
        objective, options = Aphynity([0, 1], resolve("corrected")), TrainSettings()
        trainer = Trainer(trained.model, objective, one, batch, [(batch, points)], [0, 1], options, "x")
        cut = torch.minimum(torch.maximum(free, -bound), bound)
        expected = (cut - whole.y[1:11]).square().mean((0, 2, 3)).log()
        torch.testing.assert_close(trainer.score(), expected)


def test_a_solver_that_gives_up_is_followed_by_a_fixed_grid(trained, data):
    class Stiff(Solver):
        def __call__(self, *args, **options):
            if self.method == "dopri5":
                raise SolveError("underflow")
            return super().__call__(*args, **options)

    y, t = batch_of(data).y, torch.arange(21) * 0.1
    z_e, z_a = trained.model.encode(seen(y[:11])).mean
    expected = trained.model.forecast(y[0], z_e, z_a, t, Solver("rk4"))
    assert torch.equal(forecast_or_fallback(trained.model, y[0], z_e, z_a, t, Stiff("dopri5")), expected)


def test_draws_that_run_away_are_drawn_again(trained, data):
    """Faster than 20 rad/s the pendulum turns over in steps of .1 s; about half of p⁺ is slower."""
    real = StackedSet.of(Trajectories.load(data / "train.npz"), CPU)
    task = task_of(TrainSettings(), trained.card, CPU)
    plus = augmentation.generate(
        trained.model, real, task, augmentation.Drawing({"omega0": [1.0, 40.0]}, 0.0, [0, 1]), 0
    )
    free = replace(task, bound=None)
    before = augmentation.generate(
        trained.model, real, free, augmentation.Drawing({"omega0": [1.0, 40.0]}, 0.0, [0, 1]), 0
    )
    assert not within_bound(before.y, task.bound).all()
    assert within_bound(plus.y, task.bound).all()
    kept = within_bound(before.y, task.bound)
    assert torch.equal(plus.y[:, kept], before.y[:, kept]), "the others are as they were drawn"


def test_a_prior_that_always_runs_away_ends_in_bounded_samples_and_a_warning(trained, data, caplog):
    real = StackedSet.of(Trajectories.load(data / "train.npz"), CPU)
    task = task_of(TrainSettings(), trained.card, CPU)
    with caplog.at_level(logging.WARNING):
        plus = augmentation.generate(
            trained.model, real, task, augmentation.Drawing({"omega0": [1e5, 1e6]}, 0.0, [0, 1]), 0
        )
    assert within_bound(plus.y, task.bound).all() and len(plus) == 40
    assert "seed 1: 40 of 40 samples (100.0 %) ran away" in caplog.text


def test_samples_that_run_away_for_ever_are_replaced_by_the_next_good_one_of_their_seed():
    y = torch.arange(10.0).view(1, 2, 5, 1)
    good = torch.tensor([[True, False, False, True, False], [False] * 5])
    _, task = double_pendulum()
    task = replace(task, bound=torch.tensor([7.5]))
    inputs = y + 100
    y, z_e, z_a, u = augmentation._replace_diverged(y, y[0].clone(), y[0].clone(), inputs, good, task)
    assert torch.equal(z_a, z_e)
    assert torch.equal(u[0, 0], z_e[0] + 100) and torch.equal(inputs, torch.arange(100.0, 110.0).view(1, 2, 5, 1))
    assert y[0, 0, :, 0].tolist() == z_e[0, :, 0].tolist() == [0, 3, 3, 3, 0]
    assert y[0, 1, :, 0].tolist() == [5, 6, 7, 7.5, 7.5] and z_e[1, :, 0].tolist() == [5, 6, 7, 8, 9]


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


def test_a_seed_that_cannot_be_trained_is_left_out_and_the_others_go_on(data, tmp_path, settings, caplog, failing):
    for name in ("whole", "one_less"):
        train(data, tmp_path / name / "m.st", tmp_path / name / "work", settings, None)
        failing()
    whole, left = (store.load(tmp_path / name / "m.st") for name in ("whole", "one_less"))
    assert (whole.failed, left.failed) == ([], [1])
    for name, value in left.model.state_dict().items():
        assert torch.equal(value[0], whole.model.state_dict()[name][0]), "the other seed's bits"
        assert torch.isfinite(value).all()
    assert caplog.text.count("seed 1 cannot be trained and is left out: the gradient was not finite") == 1
    assert events(tmp_path / "whole") == []
    ((seed, reason),) = events(tmp_path / "one_less")
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

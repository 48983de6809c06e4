"""Runaways: the bound, and that loss, multiplier, selection and augmentation obey it."""

import logging
import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from expertaug.errors import SolveError
from expertaug.learning import augment as augmentation
from expertaug.learning.augment import run_stage as augment
from expertaug.learning.divergence import (
    clamp_to_bound,
    divergence_bound,
    forecast_or_fallback,
    largest_sizes,
    within_bound,
)
from expertaug.learning.finetune import run_stage as finetune
from expertaug.learning.objectives import Aphynity
from expertaug.learning.settings import AugmentJob, FinetuneJob, TrainSettings
from expertaug.learning.train import run_stage as train
from expertaug.learning.trainer import Trainer
from expertaug.learning.training_data import StackedSet, task_of
from expertaug.models import store
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


def test_sizes_of_many_samples_are_found_in_parts():
    y = torch.randn(4, 600, 2, 3, generator=torch.Generator().manual_seed(0))
    y[1, 300, 0] = torch.nan
    assert torch.equal(largest_sizes(y), y.nan_to_num().abs().amax((0, 3)))


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

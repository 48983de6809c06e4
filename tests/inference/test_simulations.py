"""Draws of a trained model: pools of them, and windows of its own making."""

from __future__ import annotations

import torch
from fitted_pendulum import NOISE, PRIOR
from flow_pendulum import PENDULUM

from expertaug.inference import simulations as own_windows_of
from expertaug.inference.flow_training import prepare
from expertaug.inference.settings import OwnWindows
from expertaug.inference.simulations import Pool, draw_simulations
from expertaug.models import store as models
from expertaug.trajectories import Trajectories
from expertaug.windows import Windows


def test_a_pool_is_renewed_by_parts_and_follows_from_the_pass_alone(pendulum):
    data = Trajectories.load(pendulum / "train.npz")
    made = prepare(models.load(pendulum / "both.safetensors"), data, PENDULUM).trainer.pool
    first, second = made(3), made(4)
    assert len(first) == 80 and torch.equal(first.theta[:, 40:], second.theta[:, :40])
    assert not torch.equal(first.theta[:, :40], second.theta[:, 40:])
    assert torch.equal(Pool(made.simulator, 40, 2)(4).x, second.x)


def test_own_windows_take_z_a_from_so_many_training_windows_at_most(fitted, monkeypatch):
    stored, data = fitted
    asked, counts = own_windows_of.latents_of, []
    monkeypatch.setattr(own_windows_of, "WINDOWS", 7)
    monkeypatch.setattr(own_windows_of, "latents_of", lambda *told: counts.append(told[2].y.shape[2]) or asked(*told))
    made, _ = draw_simulations(stored, Windows.of(data), OwnWindows(prior=PRIOR), NOISE, 20)
    assert len(data) > 7 and counts == [7] and made.y.shape[2] == 20

"""What a loss sees of forecasts: those that run away are left out of it."""

from __future__ import annotations

import math
from dataclasses import replace

import torch

from cards import card
from expertaug import systems
from expertaug.learning.objectives import finite_forecast
from expertaug.learning.residuals import mean_squared_error
from expertaug.learning.settings import TrainSettings
from expertaug.learning.training_data import task_of
from expertaug.models.estimators import Hybrid


def double_pendulum(latent=2):
    description = {"system": {"name": "double_pendulum", "expert": "point_mass"}, "seeds": [0, 1], "observed": 11}
    encoder = {"kind": "window", "windows": {"theta1": [0.0, 0.1]}, "angles": ["theta1"], "layers": [5]}
    description |= {"t": [0.01 * k for k in range(20)], "expert": True, "interaction": True}
    description["model"] = {"encoder": encoder | {"latent": latent}, "interaction": {"kind": "mlp", "layers": [4]}}
    description["bound"] = [30.0, 30.0, 500.0, 500.0]
    model = Hybrid.network(systems.load(description["system"]), card(description))
    return model, task_of(TrainSettings(horizon_s=0.19), card(description), torch.device("cpu"))


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


def test_a_sample_that_runs_away_is_left_out():
    """The double pendulum at 1e5 rad/s overflows in steps of 10 ms; the other samples' gradient is as without it."""
    description = {"system": {"name": "double_pendulum", "expert": "point_mass"}, "seeds": [0, 1], "observed": 11}
    encoder = {"kind": "window", "windows": {"theta1": [0.0, 0.1]}, "angles": ["theta1"], "layers": [5], "latent": 2}
    description |= {"t": [0.01 * k for k in range(20)], "expert": True, "interaction": True}
    description["model"] = {"encoder": encoder, "interaction": {"kind": "mlp", "layers": [4]}}
    model = Hybrid.network(systems.load(description["system"]), card(description))
    task = task_of(TrainSettings(horizon_s=0.19), card(description), torch.device("cpu"))
    y0, z_a = torch.rand(2, 3, 4), torch.rand(2, 3, 2)
    z_e = torch.tensor([[[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]] * 2)
    z_e[0, 1] = 1e5
    z_e.requires_grad_()
    prediction, good = finite_forecast(model, y0, z_e, z_a, task, 20)
    assert good.tolist() == [[True, False, True], [True, True, True]]
    loss = mean_squared_error(model.system, prediction[1:], torch.zeros(19, 2, 3, 4), good)
    loss.sum().backward()
    assert torch.isfinite(z_e.grad).all() and (z_e.grad[0, 1] == 0).all() and (z_e.grad[0, 0] != 0).all()
    kept, _ = finite_forecast(model, y0[:, ::2], z_e[:, ::2], z_a[:, ::2], task, 20)
    expected = mean_squared_error(model.system, kept[1:], torch.zeros(19, 2, 2, 4))
    torch.testing.assert_close(loss[0], expected[0])

"""From a first point and latents to states; and the model that forecasts the mean."""

from __future__ import annotations

import pytest
import torch

from expertaug.models.decoder import Decoder, MeanModel
from expertaug.systems.double_pendulum import DoublePendulum
from expertaug.systems.pendulum import DampedPendulum
from expertaug.systems.solvers.solver import Solver
from seen import seen


def test_mean_model_predicts_the_mean():
    mean = torch.arange(8.0).reshape(4, 2)
    forecast, z_e = MeanModel(DampedPendulum(), mean).predict(
        seen(torch.zeros(2, 3, 5, 2), torch.arange(4.0)), Solver()
    )
    assert forecast.shape == (4, 3, 5, 2) and z_e is None
    assert torch.equal(forecast[:, 2, 4], mean)


@pytest.mark.parametrize(
    ("system", "without_expert"),
    [(DampedPendulum(), False), (DoublePendulum(constants={"B1": 0.103, "G1": 69.4, "B2": 1.35, "G2": 93.5}), True)],
)
def test_z_e_means_something_without_the_expert_where_the_forecast_starts_from_it(system, without_expert):
    assert Decoder(system).knows_z_e
    assert Decoder(system, expert=False).knows_z_e is without_expert


def test_the_mean_goes_on_with_the_last_one():
    model = MeanModel(None, torch.arange(3.0)[:, None].expand(3, 2))
    found = model.forecast(torch.zeros(4, 2), None, None, torch.arange(5.0), None)
    assert found[:, 0, 0].tolist() == [0.0, 1.0, 2.0, 2.0, 2.0] and found.shape == (5, 4, 2)

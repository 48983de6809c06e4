"""Metrics against hand-computed values."""

import math

import pytest
import torch

from expertaug import systems
from expertaug.evaluation.metrics import log_mse, log_of_median, parameter_errors

PENDULUM = systems.load({"name": "pendulum"})
DOUBLE = systems.load({"name": "double_pendulum", "expert": "point_mass"})


def test_sum_convention_adds_the_dimensions_and_dim_divides():
    truth = torch.zeros(4, 2, 5, 2)
    prediction = truth.clone()
    prediction[..., 0] = 0.1
    prediction[:, 1, :, 1] = 0.2
    found = log_mse(PENDULUM, prediction, truth)
    assert found["log_mse_sum"].tolist() == pytest.approx([math.log(0.01), math.log(0.05)])
    assert found["log_mse_dim"].tolist() == pytest.approx([math.log(0.005), math.log(0.025)])


def test_angles_are_compared_by_sine_and_cosine_and_speeds_are_not():
    truth = torch.zeros(3, 1, 4, 4)
    prediction = truth.clone()
    prediction[..., 0] = 2 * math.pi  # a whole turn is no error
    prediction[..., 1] = math.pi  # opposite: (1 − (−1))² = 4
    prediction[..., 2:] = 100.0
    found = log_mse(DOUBLE, prediction, truth)
    assert found["log_mse_sum"].item() == pytest.approx(math.log(4.0), abs=1e-5)
    assert found["log_mse_dim"].item() == pytest.approx(math.log(2.0), abs=1e-5)


def test_relative_error_is_the_mean_over_samples_and_parameters():
    truth = torch.tensor([[[2.0, -4.0], [1.0, 10.0]]])
    estimate = torch.tensor([[[1.0, -4.0], [1.5, 9.0]]])
    found = parameter_errors(DOUBLE, estimate, truth)
    assert found["relative_error_omega1"].item() == pytest.approx(50.0)
    assert found["relative_error_omega2"].item() == pytest.approx(5.0)
    assert found["relative_error"].item() == pytest.approx(27.5)
    assert found["rmse_omega2"].item() == pytest.approx(math.sqrt(0.5))


def test_the_median_over_samples_in_both_conventions():
    errors = torch.tensor([[1.0, 3.0, 1e12], [2.0, 4.0, 4.0]], dtype=torch.float64)
    found = log_of_median(PENDULUM, errors)
    assert found["log_mse_median"].tolist() == pytest.approx([math.log(3), math.log(4)])
    assert found["log_mse_median_dim"].tolist() == pytest.approx([math.log(1.5), math.log(2)])
    even = log_of_median(PENDULUM, torch.tensor([[1.0, 3.0]], dtype=torch.float64))
    assert even["log_mse_median"].item() == pytest.approx(math.log(2))

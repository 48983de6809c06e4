"""Metrics against hand-computed values."""

import math

import pytest
import torch

from expertaug.evaluation import metrics
from expertaug.evaluation.metrics import Metric, Outcome, log_mse, metric_of, parameter_errors, register, values_of
from expertaug.systems.double_pendulum import DoublePendulum
from expertaug.systems.pendulum import DampedPendulum

PENDULUM = DampedPendulum()
DOUBLE = DoublePendulum(expert="point_mass")


def outcome(errors):
    return Outcome(PENDULUM, errors, errors, None, errors > 1e9)


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
    found = values_of(outcome(errors))
    assert found["log_mse_median"].tolist() == pytest.approx([math.log(3), math.log(4)])
    assert found["log_mse_median_dim"].tolist() == pytest.approx([math.log(1.5), math.log(2)])
    even = values_of(outcome(torch.tensor([[1.0, 3.0]], dtype=torch.float64)))
    assert even["log_mse_median"].item() == pytest.approx(math.log(2))


def test_a_registered_metric_is_computed_and_printed(monkeypatch):
    """CONTRIBUTING's recipe: a call of register, this test, and a line of documentation."""
    monkeypatch.setattr(metrics, "METRICS", list(metrics.METRICS))
    register(Metric("worst", "worst error", compute=lambda o: o.errors.amax(1), better="lower", not_negative=True))
    found = values_of(outcome(torch.tensor([[1.0, 3.0], [5.0, 4.0]])))
    assert found["worst"].tolist() == [3.0, 5.0]
    assert metric_of("worst").heading() == "worst error" and metric_of("worst").format(5.0)(4.5) == "4.50"
    with pytest.raises(ValueError, match="already"):
        register(Metric("worst", "again"))
    metric_of.cache_clear()


def test_a_member_of_a_family_is_known_by_its_name():
    rmse = metric_of("rmse_omega_0")
    assert (rmse.family, rmse.of) == (metrics.RMSE_OF, "omega_0")
    assert rmse.heading({"omega_0": "1/s"}) == "omega_0 RMSE [1/s]"
    assert rmse.heading() == "omega_0 RMSE [unit of omega_0]"
    assert metric_of("relative_error_z").heading() == "z error [%]" and metric_of("relative_error").family is None
    assert metric_of("forecast_coverage_90").heading() == "forecasts in the 90 % band [%]"
    assert metric_of("runaway_share").format(0.125)(0.125) == "12.5"
    assert metric_of("anything").heading() == "anything", "one that nobody registered is printed as it is called"

"""Metrics of arrays are those of the tables."""

from __future__ import annotations

import numpy as np
import pytest

import expertaug as ea
from expertaug.api import metrics


def test_metrics_of_arrays_are_those_of_the_tables(fit, sets):
    test, system = sets["test"], fit.system
    table = fit.evaluate(test).set_index(["seed", "metric"])["value"]
    found = fit.forecast(test.y[:, :11], test.t)
    score = metrics.log_mse(system, found.y[:, :, 11:], test.y[:, 11:])
    np.testing.assert_allclose(score, [table[seed, "log_mse_sum"] for seed in (0, 1)], rtol=1e-6)
    errors = metrics.parameter_errors(system, fit[1].estimate(test.y[:, :11], test.t), test.z_e)
    assert errors["rmse_omega0"] == pytest.approx(table[1, "rmse_omega0"], rel=1e-5)
    assert metrics.log_mse(system, test.y + 1.0, test.y) == pytest.approx(np.log(2.0), abs=1e-6)


def test_errors_are_summed_over_dimensions_or_shared_among_them():
    random = np.random.default_rng(0)
    truth, error = random.standard_normal((4, 6, 2)), random.standard_normal((3, 4, 6, 2))
    system, squares = ea.DampedPendulum(), (error**2).sum(-1).mean((1, 2))
    np.testing.assert_allclose(metrics.log_mse(system, truth + error, truth), np.log(squares))
    np.testing.assert_allclose(metrics.log_mse(system, truth + error, truth, "dim"), np.log(squares / 2))
    found = metrics.parameter_errors(system, {"omega0": np.array([1.1, 2.0])}, np.array([[1.0], [2.5]]))
    assert found["relative_error_omega0"] == pytest.approx(100 * (0.1 / 1.0 + 0.5 / 2.5) / 2)
    assert found["rmse_omega0"] == pytest.approx(np.sqrt((0.1**2 + 0.5**2) / 2))


@pytest.mark.parametrize(
    ("call", "expected"),
    [
        (lambda s, y: metrics.log_mse(s, y, y, "mean"), "convention: 'mean'; sum or dim"),
        (lambda s, y: metrics.log_mse(s, y[:, :3], y), r"log_mse: prediction \(2, 3, 2\), truth \(2, 4, 2\)"),
        (lambda s, y: metrics.parameter_errors(s, {}, y), "estimate: of nothing; give omega0"),
        (lambda s, y: metrics.parameter_errors(s, {"omega0": y[0, 0]}, y[0]), "parameter_errors"),
    ],
)
def test_arrays_that_do_not_fit_are_one_line(call, expected):
    with pytest.raises(ea.InputError, match=expected):
        call(ea.DampedPendulum(), np.ones((2, 4, 2)))

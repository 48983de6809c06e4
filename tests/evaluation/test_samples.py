"""Errors of single samples, resampled alike for all versions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fake_windows import forecasts

from expertaug.errors import InputError
from expertaug.evaluation.samples import Samples


def with_errors(of, factor):
    sets = {name: replace(each, errors=factor * each.errors) for name, each in of.sets.items()}
    return replace(of, sets=sets)


def test_a_metric_is_that_of_the_errors_and_of_what_is_not_kept_there_is_none():
    of = forecasts()
    samples, key = Samples([of]), of.identified()
    for name, each in of.sets.items():
        found = samples.resampled(key, name, "log_mse_sum")
        np.testing.assert_allclose(found.value, np.log(each.errors.mean(1)))
        wrong = 100 * np.abs(each.z_e_hat / each.z_e - 1)
        np.testing.assert_allclose(samples.resampled(key, name, "relative_error").value, wrong.mean((1, 2)))
    assert samples.resampled(key, "nowhere", "log_mse_sum") is None
    assert not samples.by_recording("e") and not samples.estimates_unknown(key, "test")


def test_half_of_every_error_is_a_gain_that_the_spread_over_samples_does_not_blur():
    worse, better = forecasts("b"), with_errors(forecasts("a"), 0.5)
    samples = Samples([worse, better])
    gain = samples.difference(better.identified(), worse.identified(), "test", "log_mse_sum")
    assert (gain.mean, gain.low, gain.high) == pytest.approx([np.log(2)] * 3, rel=1e-6)
    behind, error = samples.behind(worse.identified(), better.identified(), "test", "log_mse_sum")
    assert behind == pytest.approx(np.log(2)) and error == pytest.approx(0, abs=1e-6)
    assert samples.difference(better.identified(), ("e", "corrected", "c"), "test", "log_mse_sum") is None


def test_a_seed_without_a_finite_error_is_left_out():
    of = forecasts()
    failed = with_errors(of, np.array([[np.nan], [1.0]]))
    found = Samples([failed]).resampled(of.identified(), "test", "log_mse_sum")
    np.testing.assert_allclose(found.value, np.log(of.sets["test"].errors[1:].mean(1)))


def test_groups_of_seeds_have_the_same_samples():
    of = forecasts()
    fewer = {name: replace(each, errors=each.errors[:, :5]) for name, each in of.sets.items()}
    fewer = {name: replace(each, z_e=each.z_e[:5], z_e_hat=each.z_e_hat[:, :5]) for name, each in fewer.items()}
    with pytest.raises(InputError, match=r"other samples than .*; make both again with evaluate"):
        Samples([of, replace(of, seeds=[2, 3], sets=fewer)])

"""Expected coverage: counted by hand, exact under calibration, and of the right sign where a posterior is wrong."""

from __future__ import annotations

import numpy as np
import pytest
from gaussian import posterior
from scipy.stats import binomtest

from expertaug.errors import InputError
from expertaug.inference.diagnostics.calibration import (
    area_to_curve,
    density_ranks,
    expected_coverage,
    interval_coverage,
    ranks,
    tarp_ranks,
)


def test_every_rank_once_covers_each_level_exactly():
    """What calibration means: of K + 1 windows with the ranks 0 … K, level · (K + 1) are covered."""
    every = np.arange(20)
    for found in (interval_coverage(every, 19, [0.1, 0.5, 0.9]), expected_coverage(every, 19, [0.1, 0.5, 0.9])):
        assert found.share == pytest.approx([0.1, 0.5, 0.9])
    assert area_to_curve(every, 19) == pytest.approx(0, abs=1e-12)
    levels = np.arange(1, 100) / 100  # 0.55 · 100 is more than 55 in floating point
    assert expected_coverage(np.arange(100), 99, levels).share == pytest.approx(levels)
    assert expected_coverage(np.arange(5), 4, [0.5]).share == [0.6]  # at least the level


def test_central_intervals_leave_out_both_ends_and_regions_the_far_one():
    found = np.array([0, 10, 19])
    assert interval_coverage(found, 19, [0.9]).share == pytest.approx([1 / 3])
    assert expected_coverage(found, 19, [0.9]).share == pytest.approx([2 / 3])


def test_intervals_are_those_between_quantiles():
    samples, truth, _ = posterior(300, 39)
    found = interval_coverage(ranks(samples, truth), 39, [0.5, 0.8])
    for level, share in zip(found.level, found.share, strict=True):
        low, high = np.quantile(samples, [(1 - level) / 2, (1 + level) / 2], axis=0, method="weibull")
        np.testing.assert_allclose(share, ((truth > low) & (truth < high)).mean(0))


def test_the_binomial_interval_is_exact():
    found = interval_coverage(np.array([[0, 5], [5, 5], [5, 5]]), 9, [0.6])
    for k, count in enumerate((2, 3)):
        expected = binomtest(count, 3).proportion_ci(0.95, method="exact")
        assert (found.lower[0, k], found.upper[0, k]) == pytest.approx((expected.low, expected.high))


def test_of_forecasts_there_is_one_for_each_time():
    """Bands of twice the width from the second time on; at the first the state is known, and nothing is wrong."""
    rng = np.random.default_rng(0)
    samples, truth = rng.normal(size=(99, 500, 3, 1)), rng.normal(size=(500, 3, 1))
    samples[:, :, 2] *= 2
    samples[:, :, 0], truth[:, 0] = 1.0, 1.0
    found = interval_coverage(ranks(samples, truth), 99, [0.5])
    assert found.share.shape == (1, 3, 1)
    assert found.share[0, :2, 0] == pytest.approx(0.5, abs=0.07) and found.share[0, 2, 0] > 0.7


@pytest.mark.parametrize(("width", "sign"), [(0.5, -1), (1.0, 0), (2.0, 1)])
def test_too_narrow_covers_less_and_too_wide_more(width, sign):
    samples, truth, log_prob = posterior(500, 99, width=width)
    by_rank = {
        "interval": interval_coverage(ranks(samples, truth), 99, [0.8]).share,
        "density": expected_coverage(density_ranks(log_prob(samples), log_prob(truth)), 99, [0.8]).share,
        "tarp": expected_coverage(tarp_ranks(samples, truth), 99, [0.8]).share,
    }
    for name, share in by_rank.items():
        if sign:
            assert (sign * (share - 0.8) > 0.05).all(), name
        else:
            assert share == pytest.approx(0.8, abs=0.06), name
    area = area_to_curve(tarp_ranks(samples, truth), 99)
    assert sign * area > 0.02 if sign else abs(area) < 0.01


def test_an_exact_posterior_lies_near_tarps_diagonal():
    samples, truth, _ = posterior(2000, 99, parameters=3, seed=4)
    found = expected_coverage(tarp_ranks(samples, truth), 99)
    assert found.share == pytest.approx(found.level, abs=0.03)  # Kolmogorov's bound at 5 %: 1.36 / √2000


def test_the_area_is_that_between_the_curve_and_the_diagonal():
    found = tarp_ranks(*posterior(400, 199, width=0.5)[:2])
    levels = np.arange(1001, 2000, 2) / 2000
    curve = expected_coverage(found, 199, levels)
    assert area_to_curve(found, 199) == pytest.approx(np.mean(curve.share - curve.level) / 2, abs=2e-3)
    assert area_to_curve(np.zeros(5), 199) == pytest.approx(1 / 8)
    assert area_to_curve(np.full(5, 10**6), 10**6) == pytest.approx(-3 / 8, abs=1e-5)


@pytest.mark.parametrize("levels", [[], [90], [0.0, 0.5], 0.9])
def test_levels_lie_between_0_and_1(levels):
    with pytest.raises(InputError, match="levels: found"):
        interval_coverage(np.array([0, 1]), 3, levels)

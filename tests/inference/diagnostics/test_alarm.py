"""The alarm: thresholds, ROC and risk against counts by hand and by brute force."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from expertaug.errors import InputError
from expertaug.inference.diagnostics.alarm import (
    assess,
    auroc,
    caught,
    ensemble_spread,
    failing,
    forecast_distance,
    risk_coverage,
    roc,
    threshold,
)


def scored(n: int, apart: float, seed: int = 0, decimals: int | None = None):
    """Scores of n windows, a third of which fail and score higher by ``apart``."""
    rng = np.random.default_rng(seed)
    bad = np.arange(n) % 3 == 0
    scores = rng.normal(size=n) + apart * bad
    return (scores if decimals is None else scores.round(decimals)), bad


class TestThreshold:
    def test_is_a_score_of_the_validation_set(self):
        assert threshold(np.arange(19.0), 0.05) == 18  # 19 of 20 new windows lie below the highest of 19
        assert threshold(np.arange(99.0), 0.05) == 94
        assert threshold(torch.arange(99.0), 0.2) == 79

    def test_keeps_the_rate_of_false_alarms(self):
        rng = np.random.default_rng(0)
        rates = [(rng.exponential(size=200) > threshold(rng.exponential(size=39), 0.1)).mean() for _ in range(400)]
        assert np.mean(rates) == pytest.approx(0.1, abs=0.01)

    def test_too_few_windows_are_told(self):
        with pytest.raises(InputError, match=r"of 18 windows; 0\.05 needs at least 19"):
            threshold(np.arange(18.0), 0.05)
        with pytest.raises(InputError, match="false_alarms: found 5"):
            threshold(np.arange(18.0), 5)


class TestAuroc:
    @pytest.mark.parametrize("decimals", [None, 0])
    def test_is_the_share_of_pairs_in_order_ties_counting_half(self, decimals):
        scores, bad = scored(60, 1.0, decimals=decimals)
        pairs = [(a > b) + (a == b) / 2 for a in scores[bad] for b in scores[~bad]]
        found = auroc(scores, bad)
        assert found.value == pytest.approx(np.mean(pairs))
        assert (found.failing, found.others) == (20, 40)
        assert found.lower < found.value < found.upper
        below, above = roc(scores, bad)
        assert np.trapezoid(above, below) == pytest.approx(found.value)

    def test_the_interval_holds_the_truth_as_often_as_it_says(self):
        """Of N(1, 1) against N(0, 1): Φ(1/√2) = 0.760."""
        found = [auroc(*scored(90, 1.0, seed)) for seed in range(400)]
        assert np.mean([area.lower < 0.7602 < area.upper for area in found]) == pytest.approx(0.95, abs=0.033)

    def test_of_perfect_scores_is_1_and_surer_with_more_windows(self):
        few, many = auroc([1, 2, 3, 4], [0, 0, 1, 1]), auroc(np.arange(500), np.arange(500) > 399)
        assert few.value == many.value == many.upper == 1.0
        assert few.lower == pytest.approx(0.025**0.5) and many.lower == pytest.approx(0.025**0.01)
        assert auroc([4, 3, 2, 1], [0, 0, 1, 1]).value == 0.0

    def test_of_equal_scores_says_nothing(self):
        assert auroc(np.zeros(6), np.arange(6) > 2).value == 0.5

    def test_is_undefined_where_no_window_fails(self):
        found = auroc(np.arange(5), np.zeros(5, bool))
        assert np.isnan([found.value, found.lower, found.upper]).all() and found.failing == 0
        assert np.isnan(auroc(np.arange(5), np.arange(5) == 4).lower)

    def test_infinite_scores_are_the_highest(self):
        assert auroc([0.0, 1.0, np.inf], [0, 0, 1]).value == 1.0

    @pytest.mark.parametrize(
        ("scores", "bad", "expected"),
        [
            ([1, 2], [0, 1, 1], "have shapes"),
            ([np.nan, 2], [0, 1], "scores: is nan"),
            ([1, 2], [0, 2], "failing: has the value 2"),
        ],
    )
    def test_bad_input_is_told(self, scores, bad, expected):
        with pytest.raises(InputError, match=expected):
            auroc(scores, bad)


class TestRisk:
    def test_is_the_mean_error_of_those_kept(self):
        found = risk_coverage([3, 1, 2, 4], [10.0, 1.0, 4.0, 5.0])
        assert found.kept == pytest.approx([0.25, 0.5, 0.75, 1])
        assert found.risk == pytest.approx([1, 2.5, 5, 5]) and found.best == pytest.approx([1, 2.5, 10 / 3, 5])
        assert (found.area, found.best_area) == pytest.approx((13.5 / 4, (1 + 2.5 + 10 / 3 + 5) / 4))

    def test_equal_scores_are_refused_in_no_order(self):
        errors = np.array([10.0, 1.0, 4.0, 5.0])
        for order in (np.arange(4), np.array([3, 1, 0, 2])):
            assert risk_coverage(np.zeros(4), errors[order]).risk == pytest.approx(np.full(4, 5.0))


class TestAssess:
    def test_counts_by_hand(self):
        validation = np.arange(1.0, 101.0)
        found = assess(scores=[96.5, 50, 97, 96, 2], errors=[1e3, 1e4, 5, 6, 7], **as_validation(validation))
        assert found.threshold == 96 and found.failing.tolist() == [True, True, False, False, False]
        assert found.alarms.tolist() == [True, False, True, False, False]
        assert (found.caught, found.false_alarms, found.area.value) == pytest.approx((0.5, 1 / 3, 0.5))
        assert found.caught_interval == pytest.approx((0.0126, 0.9874), abs=1e-4)
        assert found.risk.risk[-1] == pytest.approx(np.mean([1e3, 1e4, 5, 6, 7]))

    def test_where_nothing_fails_only_false_alarms_are_known(self):
        validation = np.arange(1.0, 101.0)
        found = assess(scores=[1, 2, 99], errors=[5, 6, 7], **as_validation(validation))
        assert np.isnan(found.caught) and np.isnan(found.area.value) and found.false_alarms == pytest.approx(1 / 3)
        assert np.isnan(assess([1, 2], [500, np.inf], **as_validation(validation)).false_alarms)

    def test_failing_is_beyond_the_validation_errors_quantile(self):
        assert failing([98, 100, np.inf], np.arange(1.0, 101.0)).tolist() == [False, False, True]
        assert failing([98, 100], np.arange(1.0, 101.0), quantile=0.9).tolist() == [True, True]
        with pytest.raises(InputError, match="quantile: found 99"):
            failing([1], [1], quantile=99)

    def test_caught_is_above_the_threshold(self):
        assert caught([1, 2, 3, 9], [1, 1, 1, 0], 1)[0] == pytest.approx(2 / 3)


def as_validation(values: np.ndarray) -> dict[str, np.ndarray]:
    return {"validation_scores": values, "validation_errors": values}


class TestForecastDistance:
    def test_is_the_mean_square_over_times_and_components(self):
        one, other = np.zeros((2, 2, 2)), np.array([[[2.0, 0.0], [0.0, 0.0]], [[1.0, 1.0], [1.0, 10.0]]])
        assert forecast_distance(one, other) == pytest.approx([1.0, 103 / 4])
        assert forecast_distance(one, other, scale=[1.0, 10.0]) == pytest.approx([1.0, 3.01 / 4])
        assert forecast_distance(one[:1], np.full((1, 2, 2), np.inf)) == [np.inf]

    def test_needs_two_forecasts_of_the_same_windows(self):
        with pytest.raises(InputError, match=r"refined: has shape \(2, 3, 2\)"):
            forecast_distance(np.zeros((2, 2, 2)), np.zeros((2, 3, 2)))
        with pytest.raises(InputError, match="scale: found 0"):
            forecast_distance(np.zeros((1, 2)), np.zeros((1, 2)), scale=0.0)


class TestEnsembleSpread:
    def test_is_the_standard_deviation_over_seeds(self):
        estimates = np.array([[[1.0, 10.0], [0.0, 0.0]], [[3.0, 10.0], [0.0, 40.0]]])  # (2, 2, 2)
        assert ensemble_spread(estimates) == pytest.approx([1.0, 20.0])
        assert ensemble_spread(estimates, scale=[1.0, 10.0]) == pytest.approx([1.0, 2.0])

    def test_needs_two_seeds_and_a_positive_scale(self):
        with pytest.raises(InputError, match="at least two seeds"):
            ensemble_spread(np.zeros((1, 4, 2)))
        with pytest.raises(InputError, match="scale: found 0"):
            ensemble_spread(np.zeros((2, 4, 2)), scale=[1.0, 0.0])

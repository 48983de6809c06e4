"""Intervals of two sources of spread: how often they hold the truth, what differences they find and do not find."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import t as student_t

from expertaug.evaluation.intervals import (
    RESAMPLES,
    Resampled,
    against,
    interval,
    log_mean,
    log_median,
    mean,
    units_of,
)

RUNS = 200


def toy(rng, seeds, samples, of_seeds=0.3, of_samples=0.7, of_both=0.3, shift=0.0):
    """Squared errors whose logs are a sum of what seed, sample and the two together contribute; their mean is known."""
    far = of_seeds * rng.normal(size=(seeds, 1)), of_samples * rng.normal(size=(1, samples))
    return np.exp(shift - 6 + far[0] + far[1] + of_both * rng.normal(size=(seeds, samples)))


@pytest.mark.parametrize(
    ("seeds", "samples", "of_seeds", "of_samples"),
    [(3, 100, 0.3, 0.7), (3, 100, 0.05, 0.7), (3, 100, 0.3, 0.1), (10, 100, 0.3, 0.7), (5, 30, 0.2, 0.5)],
)
def test_95_of_100_intervals_hold_the_truth(seeds, samples, of_seeds, of_samples):
    """Whichever of the two sources of spread is the larger; two standard errors of 200 runs are 3 %."""
    rng, truth, units = np.random.default_rng(1), -6 + (of_samples**2 + 0.3**2) / 2, np.arange(samples)
    found = [interval(log_mean(toy(rng, seeds, samples, of_seeds, of_samples), units)) for _ in range(RUNS)]
    held = np.mean([one.low <= truth <= one.high for one in found])
    assert 0.91 <= held <= 0.995


def test_an_interval_over_one_source_alone_would_not_hold_it():
    """The toy tells right from wrong: without the spread over samples, or over seeds, the same check fails."""
    rng, truth, units = np.random.default_rng(1), -6 + (0.7**2 + 0.3**2) / 2, np.arange(100)
    held = {"seeds": 0, "samples": 0}
    for _ in range(RUNS):
        one = log_mean(toy(rng, 3, 100, 0.15), units)
        alone = Resampled(one.value, np.broadcast_to(one.value, (RESAMPLES, 3)), one.units)
        together = Resampled(one.value[:1], one.drawn[:, :1], one.units)
        for name, part in (("seeds", alone), ("samples", together)):
            held[name] += interval(part).low <= truth <= interval(part).high
    assert held["seeds"] < 0.93 * RUNS and held["samples"] < 0.8 * RUNS


def test_the_median_of_heavy_tails():
    rng = np.random.default_rng(2)
    found = [interval(log_median(toy(rng, 3, 60, 0.3, 1.5), np.arange(60))) for _ in range(60)]
    assert np.mean([one.low <= -6 <= one.high for one in found]) >= 0.9
    errors = toy(rng, 2, 7)
    assert interval(log_median(errors, np.arange(7))).mean == pytest.approx(np.log(np.median(errors, axis=1)).mean())


def test_pairs_of_the_same_seeds_and_samples_find_a_shift_that_means_hide():
    rng, units = np.random.default_rng(3), np.arange(100)
    base = toy(rng, 3, 100)
    other = base * np.exp(-0.2 + 0.1 * rng.normal(size=base.shape))
    one, two = log_mean(base, units), log_mean(other, units)
    difference = interval(one - two)
    assert difference.told_apart and 0.1 < difference.low < 0.2 < difference.high < 0.3
    assert interval(two).high > interval(one).mean, "the means' own intervals overlap"


def test_a_shift_that_is_not_there_is_found_in_one_of_twenty():
    rng, units = np.random.default_rng(4), np.arange(50)
    found = 0
    for _ in range(RUNS):
        shared = toy(rng, 1, 50, 0, 0.7, 0)
        pair = [log_mean(shared * toy(rng, 3, 50, 0.3, 0.05, 0.3), units) for _ in range(2)]
        found += interval(pair[0] - pair[1]).told_apart
    assert found <= 0.08 * RUNS


def test_verdicts_beside_published_numbers_weigh_both_sides():
    rng = np.random.default_rng(5)
    own = mean(3 + 0.1 * rng.normal(size=(5, 200)) + 0.05 * rng.normal(size=(5, 1)), np.arange(200))
    assert against(own, 3.0, 0.3, 10).p > 0.2
    assert against(own, 4.0, 0.3, 10).told_apart and against(own, 4.0, 0.3, 10).high < 0
    assert against(own, 2.0, 0.3, 10).told_apart and against(own, 2.0, 0.3, 10).low > 0
    assert not against(own, 3.3, 2.0, 10).told_apart, "their runs are too different"
    assert against(own, 3.3, 0.01, 10).told_apart
    assert not against(own, 3.3, 0.01, 10, rounded=1.0).told_apart, "printed without a decimal, 3.3 may be 3"


def test_one_seed_says_nothing_of_others_and_one_sample_nothing_at_all():
    rng = np.random.default_rng(6)
    one = interval(log_mean(toy(rng, 1, 40), np.arange(40)))
    assert one.low < one.mean < one.high and np.isnan(one.p) and not one.told_apart
    alone = interval(log_mean(toy(rng, 3, 1), np.zeros(1, dtype=int)))
    assert np.isnan(alone.low) and not alone.told_apart


def test_an_interval_of_what_cannot_be_negative_is_one_of_its_logarithm():
    """Of seeds alone, the closed form: the mean times exp(± t s / (mean √S)), Student's t by the delta method."""
    rng, seeds = np.random.default_rng(8), 8
    value = 5 + 0.5 * rng.normal(size=seeds)
    found = interval(Resampled(value, np.broadcast_to(value, (RESAMPLES, seeds)), 1000), not_negative=True)
    half = student_t.ppf(0.975, seeds - 1) * value.std(ddof=1) / (value.mean() * np.sqrt(seeds))
    assert found.mean == value.mean() and np.isnan(found.p)
    np.testing.assert_allclose(np.log([found.low, found.high]) - np.log(found.mean), [-half, half], rtol=0.1)
    # Of samples alone, of one seed: a log-normal mean.
    errors = np.exp(0.3 * rng.normal(size=(1, 400)))
    found = interval(mean(errors, np.arange(400)), not_negative=True)
    half = 1.96 * errors.std(ddof=1) / (errors.mean() * np.sqrt(400))
    np.testing.assert_allclose(np.log([found.low, found.high]) - np.log(found.mean), [-half, half], rtol=0.1)


def test_no_interval_of_what_cannot_be_negative_goes_below_zero():
    value = np.array([0.1, 0.2, 9.0])
    one = Resampled(value, np.broadcast_to(value, (RESAMPLES, 3)), 1000)
    assert interval(one).low < 0 < interval(one, not_negative=True).low < interval(one).mean
    with_zeros = Resampled(np.array([0.0, 0.0, 9.0]), np.broadcast_to([0.0, 0.0, 9.0], (RESAMPLES, 3)), 1000)
    cut, plain = interval(with_zeros, not_negative=True), interval(with_zeros)
    assert cut.low == 0 > plain.low and cut.high == plain.high, "a mean of 0 has no logarithm"
    nothing = Resampled(np.zeros(3), np.zeros((RESAMPLES, 3)), 1000)
    assert interval(nothing, not_negative=True).low == interval(nothing, not_negative=True).high == 0
    alone = interval(mean(np.ones((3, 1)), np.zeros(1, dtype=int)), not_negative=True)
    assert np.isnan(alone.low) and np.isnan(alone.high), "a single sample says nothing"


def test_the_same_numbers_give_the_same_bits():
    errors = toy(np.random.default_rng(7), 3, 20)
    first, second = (interval(log_mean(errors, np.arange(20))) for _ in range(2))
    assert first == second


def test_chunks_of_a_recording_are_drawn_together():
    ids = np.array([f"a/b{k % 6}/{10 * k}" for k in range(60)])
    units = units_of(ids, 60)
    assert len(set(units)) == 6 and (units == np.arange(60) % 6).all()
    few = np.array([f"r{k % 2}/{7 * (59 - k)}" for k in range(60)])
    units = units_of(few, 60)
    assert len(set(units)) == 10 and np.bincount(units).tolist() == [6] * 10
    assert (units[few == "r0/7"] != units[few == "r1/0"]).all(), "of two recordings"
    late = [units[few == f"r0/{7 * k}"][0] for k in range(1, 60, 2)]
    assert sorted(late) == late, "consecutive chunks"
    assert (units_of(None, 5) == np.arange(5)).all()


def test_overlapping_chunks_do_not_make_an_interval_narrow():
    """Ten recordings, each of a hundred chunks that are all alike: no more than ten samples."""
    rng = np.random.default_rng(8)
    errors = np.repeat(toy(rng, 3, 10, 0.02, 0.7, 0.02), 100, axis=1)
    ids = np.array([f"r{k // 100}/{k}" for k in range(1000)])
    wide, narrow = (interval(log_mean(errors, units_of(names, 1000))) for names in (ids, None))
    alone = interval(log_mean(errors[:, ::100], np.arange(10)))
    assert (wide.low, wide.high) == pytest.approx((alone.low, alone.high))
    assert wide.high - wide.low > 5 * (narrow.high - narrow.low)

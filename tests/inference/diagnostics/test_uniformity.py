"""Ranks counted by hand, and their uniformity: at the stated rate where it holds, found out where it does not."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from gaussian import posterior
from scipy.stats import binom

from expertaug.errors import InputError
from expertaug.inference.diagnostics.calibration import calibration, density_ranks, ranks, tarp_ranks
from expertaug.inference.diagnostics.uniformity import uniformity

DRAWS = np.array([[[1.0, 5.0]], [[2.0, 6.0]], [[3.0, 7.0]]])  # (3, 1, 2)


class TestRanks:
    @pytest.mark.parametrize(("truth", "expected"), [([0.0, 8.0], [0, 3]), ([1.5, 6.5], [1, 2])])
    def test_count_the_draws_below(self, truth, expected):
        assert ranks(DRAWS, np.array([truth])).tolist() == [expected]
        assert ranks(torch.tensor(DRAWS), torch.tensor([truth])).tolist() == [expected]

    def test_of_any_shape(self):
        found = ranks(np.arange(4.0).reshape(4, 1, 1, 1) + np.zeros((4, 2, 3, 5)), np.full((2, 3, 5), 1.5))
        assert found.shape == (2, 3, 5) and (found == 2).all()

    def test_ties_are_broken_evenly_and_by_the_seed(self):
        samples, truth = np.zeros((3, 4000)), np.zeros(4000)
        found = ranks(samples, truth, seed=1)
        assert np.bincount(found, minlength=4) / 4000 == pytest.approx(np.full(4, 0.25), abs=0.03)
        np.testing.assert_array_equal(found, ranks(samples, truth, seed=1))
        assert (found != ranks(samples, truth, seed=2)).any()
        # One draw below and one tie: the rank is 1 or 2.
        assert set(ranks(np.array([[0.0], [1.0], [2.0]]) + np.zeros(200), np.ones(200))) == {1, 2}

    def test_of_density_count_what_is_likelier(self):
        assert density_ranks(np.array([[-1.0, -9.0], [-3.0, -9.0]]), np.array([-2.0, -1.0])).tolist() == [1, 0]

    def test_of_tarp_count_what_is_nearer_to_the_reference(self):
        truth = np.array([[0.0, 0.0], [10.0, 1.0]])  # the second component counts ten times as much
        samples = np.array([[[3.0, 0.0], [8.0, 1.0]], [[0.0, 0.5], [9.0, 0.4]]])
        found = tarp_ranks(samples, truth, references=np.array([[0.0, 0.4], [0.0, 1.0]]))
        assert found.tolist() == [1, 1]  # distances .5, .1 against .4; .8, 1.08 against 1
        assert (tarp_ranks(samples, truth, seed=3) == tarp_ranks(samples, truth, seed=3)).all()

    def test_a_parameter_that_never_varies_changes_nothing(self):
        samples, truth, _ = posterior(50, 9, parameters=1)
        given = samples, truth, np.zeros((50, 1))
        constant = [np.concatenate([value, np.full_like(value, 2.0)], axis=-1) for value in given]
        np.testing.assert_array_equal(tarp_ranks(*constant), tarp_ranks(*given))

    @pytest.mark.parametrize(
        ("samples", "truth", "expected"),
        [
            (DRAWS, np.zeros((2, 2)), r"samples: have shape \(3, 1, 2\), the truth \(2, 2\)"),
            (np.full((3, 1, 2), np.nan), np.zeros((1, 2)), r"samples: is nan at index \(0, 0, 0\)"),
            (DRAWS, np.array([[0.0, np.inf]]), r"truth: is inf at index \(0, 1\)"),
            (np.zeros((0, 1, 2)), np.zeros((1, 2)), "samples: is empty"),
            ("abc", np.zeros((1, 2)), "samples: no array of numbers"),
        ],
    )
    def test_bad_input_is_told(self, samples, truth, expected):
        with pytest.raises(InputError, match=expected):
            ranks(samples, truth)

    def test_more_bad_input_is_told(self):
        with pytest.raises(InputError, match="references: have shape"):
            tarp_ranks(DRAWS, np.zeros((1, 2)), references=np.zeros((1, 3)))
        with pytest.raises(InputError, match="calibration: log density of one"):
            calibration(DRAWS, np.zeros((1, 2)), log_prob_samples=np.zeros((3, 1)))
        with pytest.raises(InputError, match="ranks: from 0 to 4; give whole numbers from 0 to 3"):
            uniformity(np.array([0, 4]), 3)
        with pytest.raises(InputError, match=r"confidence: found 95"):
            uniformity(np.array([0, 3]), 3, confidence=95)


class TestUniformity:
    def test_of_one_point_is_the_binomial_test(self):
        """With a single draw ranks are 0 or 1, and the band is the binomial's own."""
        n, zeros = 30, 8
        found = uniformity(np.arange(n) >= zeros, draws=1)
        assert found.level.tolist() == [0.5] and found.share.tolist() == [zeros / n]
        assert float(found.p_value) == pytest.approx(2 * binom.cdf(zeros, n, 0.5))
        inside = np.arange(n + 1)[2 * binom.cdf(np.arange(n + 1), n, 0.5) > 0.05]
        assert found.lower == pytest.approx(inside.min() / n) and found.upper == pytest.approx(1 - inside.min() / n)

    @pytest.mark.parametrize(("n", "draws"), [(40, 19), (40, 100)])
    def test_uniform_ranks_are_refused_at_the_stated_rate(self, n, draws):
        """Also with more draws than points.  400 tests at 10 %: the rate lies within 3 standard deviations."""
        found = uniformity(np.random.default_rng(0).integers(0, draws + 1, (n, 400)), draws, confidence=0.9)
        assert np.mean(~found.uniform) == pytest.approx(0.1, abs=0.045)
        assert np.mean(found.p_value <= 0.5) == pytest.approx(0.5, abs=0.075)

    def test_very_wrong_ranks_and_many_draws_are_no_trouble(self):
        found = uniformity(np.zeros(5000), 1000)
        assert found.p_value < 1e-9 and len(found.level) == 200
        assert found.level[0] == 1 / 1001 and found.level[-1] == 1000 / 1001

    def test_the_flag_says_whether_the_curve_leaves_the_band(self):
        found = uniformity(np.random.default_rng(1).integers(0, 20, (60, 300)), 19, confidence=0.8)
        share = found.share
        inside = (share >= found.lower[:, None] - 1e-12) & (share <= found.upper[:, None] + 1e-12)
        np.testing.assert_array_equal(inside.all(0), found.uniform)
        assert 0 < found.uniform.sum() < 300

    @pytest.mark.parametrize(("width", "shift"), [(0.6, 0.0), (1.7, 0.0), (1.0, 0.35)])
    def test_wrong_posteriors_are_found_and_the_right_one_is_not(self, width, shift):
        def p_values(**wrong):
            samples, truth, log_prob = posterior(200, 99, **wrong)
            found = calibration(samples, truth, log_prob(samples), log_prob(truth))
            return [uniformity(r, found.draws).p_value for r in (found.marginal, found.density, found.tarp)]

        marginal, density, tarp = p_values(width=width, shift=shift)
        assert marginal.shape == (2,) and (marginal < 1e-3).all() and density < 1e-3
        if shift == 0:  # TARP with reference points that ignore the data hardly sees a shift
            assert tarp < 1e-2
        assert min(map(np.min, p_values())) > 0.05

    def test_a_shift_tilts_the_ranks(self):
        """Draws that lie too high leave the truth below them: small ranks, a curve above the band."""
        samples, truth, _ = posterior(200, 99, shift=0.5)
        found = uniformity(ranks(samples, truth), 99)
        middle = len(found.level) // 2
        assert (found.share[middle] > found.upper[middle]).all()

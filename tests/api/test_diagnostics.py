"""Whether a posterior is right, by draws and truths of one's own: what the front door offers, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from expertaug.api import diagnostics


@pytest.mark.parametrize("kind", [np.asarray, torch.as_tensor])
def test_ranks_count_draws_below_the_truth(kind):
    random = np.random.default_rng(0)
    draws, truth = random.standard_normal((19, 6, 2)), random.standard_normal((6, 2))
    np.testing.assert_array_equal(diagnostics.ranks(kind(draws), kind(truth)), (draws < truth).sum(0))


def test_the_score_of_two_draws_is_their_mean_distance_less_half_of_that_between_them():
    draws, truth = np.array([[1.0, -2.0], [3.0, 5.0]]), np.array([2.5, 0.0])
    expected = np.abs(draws - truth).mean(0) - np.abs(draws[0] - draws[1]) / 2
    np.testing.assert_allclose(diagnostics.crps(draws, truth), expected)


def test_draws_of_the_truths_own_distribution_are_uniform_in_rank_and_narrower_ones_are_not():
    random = np.random.default_rng(1)
    draws, truth = random.standard_normal((99, 400)), random.standard_normal(400)
    right, narrow = (diagnostics.ranks(scale * draws, truth) for scale in (1.0, 0.4))
    assert diagnostics.uniformity(right, 99).p_value > 0.01 > diagnostics.uniformity(narrow, 99).p_value

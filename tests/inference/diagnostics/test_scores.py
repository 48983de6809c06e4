"""CRPS, energy score and error of the mean, against closed forms and plain loops."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from scipy.stats import norm

from expertaug.errors import InputError
from expertaug.inference.diagnostics.scores import crps, energy_score, log_mse_of_mean


def test_crps_of_a_gaussian_is_the_closed_form():
    """σ (z (2Φ(z) − 1) + 2φ(z) − 1/√π), of Gneiting & Raftery 2007, section 4.2."""
    mean, sd, truth = np.array([0.0, 1.0, -2.0]), np.array([1.0, 0.5, 3.0]), np.array([0.3, -1.0, -2.0])
    samples = mean + sd * norm.ppf((np.arange(20_000) + 0.5) / 20_000)[:, None]
    z = (truth - mean) / sd
    expected = sd * (z * (2 * norm.cdf(z) - 1) + 2 * norm.pdf(z) - 1 / math.sqrt(math.pi))
    assert crps(samples, truth) == pytest.approx(expected, rel=1e-3)
    assert crps(torch.tensor(samples), torch.tensor(truth)) == pytest.approx(expected, rel=1e-3)


def test_crps_is_the_pairwise_formula():
    rng = np.random.default_rng(0)
    samples, truth = rng.normal(size=(7, 4, 2)), rng.normal(size=(4, 2))
    pairs = sum(np.abs(samples[i] - samples[j]) for i in range(7) for j in range(7)) / (7 * 6)
    np.testing.assert_allclose(crps(samples, truth), np.abs(samples - truth).mean(0) - pairs / 2, rtol=1e-12)


def test_crps_is_fair():
    """Its mean does not depend on the number of draws; with 1/K² two draws would come out at 0.85 rather than 0.56."""
    rng = np.random.default_rng(1)
    truth = rng.normal(size=40_000)
    for draws in (2, 10):
        found = crps(rng.normal(size=(draws, 40_000)), truth).mean()
        assert found == pytest.approx(1 / math.sqrt(math.pi), abs=0.015)


def test_energy_score_is_the_crps_of_vectors():
    rng = np.random.default_rng(2)
    samples, truth = rng.normal(size=(6, 5, 3, 2)), rng.normal(size=(5, 3, 2))
    found = energy_score(samples, truth)
    assert found.shape == (5, 3)
    pairs = sum(np.linalg.norm(samples[i] - samples[j], axis=-1) for i in range(6) for j in range(6)) / (6 * 5)
    np.testing.assert_allclose(found, np.linalg.norm(samples - truth, axis=-1).mean(0) - pairs / 2, rtol=1e-12)
    np.testing.assert_allclose(energy_score(samples[..., :1], truth[..., :1]), crps(samples, truth)[..., 0])


def test_scores_are_best_for_the_true_distribution():
    rng = np.random.default_rng(3)
    truth = rng.normal(size=(2000, 2))
    for score in (lambda s: crps(s, truth).mean(), lambda s: energy_score(s, truth).mean()):
        right, narrow, wide = (score(width * rng.normal(size=(50, 2000, 2))) for width in (1.0, 0.4, 2.5))
        assert right < narrow and right < wide


def test_error_of_the_mean_sums_dimensions_and_averages_the_rest():
    truth = np.zeros((2, 3, 2))
    samples = np.stack([truth + 0.1, truth + 0.3])  # the mean is off by 0.2 in both dimensions
    assert log_mse_of_mean(samples, truth) == pytest.approx(math.log(2 * 0.04))


@pytest.mark.parametrize(
    ("score", "shape", "expected"),
    [
        (crps, (1, 4), "1 draw a window; give at least 2"),
        (energy_score, (3, 4), "truth of shape"),
        (log_mse_of_mean, (3, 4), "truth of shape"),
    ],
)
def test_bad_input_is_told(score, shape, expected):
    with pytest.raises(InputError, match=expected):
        score(np.zeros(shape), np.zeros(shape[1:]))

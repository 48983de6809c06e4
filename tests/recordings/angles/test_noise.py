"""The markers' noise, from the lengths of the arms: its size, its correlation, and without what is no noise."""

from __future__ import annotations

import numpy as np
import pytest

from expertaug_recordings.angles.noise import Noise, fit_trimmed, marker_noise, measure_noise


def test_size_and_correlation_are_those_of_the_lengths():
    white = np.random.default_rng(0).normal(size=(20001, 2))
    off = np.stack((0.1 * white[1:, 0], 0.2 * (white[1:, 1] + white[:-1, 1]) / np.sqrt(2)), axis=1)
    lengths = np.array([118.0, 90.0]) + off
    lengths[500] += 30.0  # a fault
    noise, px = measure_noise(lengths, np.arange(20000) != 700, 3)
    assert px == pytest.approx([0.1, 0.2], rel=0.02) and noise.std == pytest.approx(px / [118, 90], rel=1e-3)
    assert noise.correlation == pytest.approx(np.array([[1, 1], [0, 0.5], [0, 0]]), abs=0.03)


def test_the_variance_of_a_sum_has_its_covariances():
    noise = Noise(np.array([0.1, 0.2]), np.array([[1.0, 1.0], [0.5, 0.0]]))
    both, difference = np.array([1.0, 1.0]), np.array([1.0, -1.0])
    assert noise.variance(both, 0) == pytest.approx(0.03) and noise.variance(difference, 0) == pytest.approx(0.01)
    assert noise.variance(both, 1) == noise.variance(difference, 1) == pytest.approx(0.08)
    assert noise.variance(np.array([1.0, 0.0, 1.0]), 0) == pytest.approx(0.02)


def test_a_fit_leaves_out_what_is_far_off():
    rng, x = np.random.default_rng(0), np.linspace(0, 1, 200)
    design, target = np.column_stack((np.ones(200), x)), 2 + 3 * x + 0.01 * rng.normal(size=200)
    target[::20] += 5
    found, _, used, noise, inverse = fit_trimmed(design, target, np.ones(200, bool))
    assert found == pytest.approx([2, 3], abs=0.01) and noise == pytest.approx(0.01, rel=0.2)
    assert not used[::20].any() and used.sum() == 190
    assert inverse == pytest.approx(np.linalg.inv(design[used].T @ design[used]))


def test_a_length_s_noise_is_that_of_its_two_ends():
    pivot = np.full((50, 2), 240.0)
    assert marker_noise(np.array([0.3, 0.5]), pivot, pivot) == pytest.approx([0.0, 0.3, 0.4])

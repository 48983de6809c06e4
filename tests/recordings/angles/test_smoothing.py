"""Local polynomials: exact where the motion is one, near it where it is noisy, and over gaps and outliers."""

from __future__ import annotations

import numpy as np
import pytest

from expertaug_recordings.angles.noise import Noise
from expertaug_recordings.angles.smoothing import Smoothing, Window, smooth_motion, speed_windows, window_frames

RATE = 100.0


@pytest.mark.parametrize("window", [Window(3, 5, -1), Window(6, 3, -1), Window(2, 4, -1)])
def test_a_polynomial_of_its_degree_is_told_exactly(window):
    polynomial = np.poly1d(np.random.default_rng(0).normal(size=window.degree + 1))
    t = np.arange(-window.half, window.half + 1) / RATE
    assert window.weights(0, RATE) @ polynomial(t) == pytest.approx(polynomial(0))
    assert window.weights(1, RATE) @ polynomial(t) == pytest.approx(polynomial.deriv()(0))


def test_windows_are_odd_and_long_enough_for_their_order():
    assert [window_frames(0.08, 5, rate) for rate in (400.0, 100.0, 30.0)] == [33, 9, 7]
    halves = [window.half for window in speed_windows(5, 400.0)]
    assert halves == sorted(set(halves)) and 2 * halves[-1] + 1 <= 0.08 * 400 + 1


def test_a_noisy_swing_is_smoothed_its_gap_filled_and_its_outlier_left_out():
    t, rng = np.arange(200) / RATE, np.random.default_rng(0)
    true = np.stack((2.5 * np.sin(4 * t), 1.5 * np.cos(5 * t), 10 * np.cos(4 * t), -7.5 * np.sin(5 * t)), axis=1)
    theta = true[:, :2] + 0.001 * rng.normal(size=(200, 2))
    theta[80:83] = np.nan
    theta[50, 0] += 0.3
    noise = Noise(np.full(2, 0.001), np.array([[1.0, 1.0], [0.0, 0.0]]))
    found = smooth_motion(theta, RATE, noise, Smoothing(5, None, 4, 12.0, np.deg2rad(0.5)))
    assert np.flatnonzero(found.outlier).tolist() == [50] and np.isfinite(found.y).all()
    inside = ~found.margin
    assert (np.abs(found.y - true)[inside].max(0) < [0.01, 0.01, 0.5, 0.5]).all()
    off = (found.y - true)[inside & np.isfinite(found.std).all(1)]
    assert np.sqrt(np.mean(off[:, :2] ** 2)) < 0.001 and np.isnan(found.std[[50, 80, 81, 82]]).all()
    longer = smooth_motion(theta, RATE, noise, Smoothing(5, None, 2, 12.0, np.deg2rad(0.5)))
    assert np.isnan(longer.y[80:83]).all() and np.isfinite(longer.y[[79, 83]]).all()

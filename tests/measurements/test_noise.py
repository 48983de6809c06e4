"""Noise of measured columns is told from how rough they are, whatever the motion."""

from __future__ import annotations

import numpy as np
import pytest
from swings import swing

from expertaug.measurements.noise import noise_of, noise_of_rows


def test_noise_is_estimated_from_roughness():
    rng = np.random.default_rng(0)
    y = swing(1.0, points=2000)
    for sigma in (0.003, 0.03):
        noisy = y + sigma * np.array([1.0, 2.0]) * rng.standard_normal(y.shape)
        noisy[100:110] = np.nan
        assert noise_of([noisy]) == pytest.approx([sigma, 2 * sigma], rel=0.1)
    assert noise_of([y]).max() < 1e-4  # a motion without noise
    assert np.isnan(noise_of([y[:5]])).all()


def test_of_rows_at_uneven_times_it_is_estimated_alike():
    rng = np.random.default_rng(0)
    t = np.cumsum(rng.uniform(0.5, 1.5, 3000))
    values = np.stack((t**3 / 1e6, np.cos(t / 50)), axis=1)
    noisy = values + [0.01, 0.02] * rng.standard_normal(values.shape)
    assert noise_of_rows([(t, noisy)]) == pytest.approx([0.01, 0.02], rel=0.1)
    assert np.isnan(noise_of_rows([(t[:6], noisy[:6])])).all()

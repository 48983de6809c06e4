"""What no pendulum's motion explains of measured angles: nothing beyond their noise where it is a pendulum's."""

from __future__ import annotations

import numpy as np
import pytest
from pendulum_motion import CONSTANTS, FRICTION

from expertaug_recordings.angles.noise import Noise
from expertaug_recordings.angles.pendulum_fit import Fit
from expertaug_recordings.angles.shooting import Misfit, misfit
from expertaug_recordings.rendering.motion import simulate

RATE, NOISE = 100.0, 0.002


def test_a_pendulum_s_motion_is_off_by_its_noise_alone():
    y = simulate(np.array([[1.9, 1.2, 0.0, 0.0]]), np.arange(120) / RATE, CONSTANTS, FRICTION)[0]
    angles = y[:, :2] + NOISE * np.random.default_rng(0).normal(size=(120, 2))
    std, fit = np.full((120, 2), NOISE), Fit(CONSTANTS, FRICTION, {}, (1.0, 1.0))
    found = misfit(angles, y, std, fit, RATE)
    assert found.rms == pytest.approx([NOISE] * 2, rel=0.25) and found.known == pytest.approx([NOISE] * 2)
    assert not found.beyond and found.every == 1
    assert misfit(angles[:20], y[:20], std[:20], fit, RATE) is None  # three windows


def test_what_is_beyond_the_noise_is_steady_or_grows_with_the_speed():
    found = Misfit(np.array([0.005, 0.001]), np.full(2, 0.002), np.array([9e-6, 0.0]), np.array([4e-6, 0.0]), 1)
    assert found.beyond
    np.testing.assert_allclose(found.error(np.array([[0.0, 5.0], [2.0, 5.0]])), [[0.003, 0], [0.005, 0]])
    alone, alike = (Noise(np.full(2, 0.002), np.array([[1.0, 1.0], [c, c]])) for c in (0.0, 0.5))
    assert found.share(alone) == pytest.approx([1, 0.5])  # the second angle errs by half of what its arm says
    assert found.share(alike) == pytest.approx([1, 1])

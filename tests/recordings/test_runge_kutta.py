"""A step of the classical Runge-Kutta method."""

from __future__ import annotations

import numpy as np
import torch

from expertaug_recordings.runge_kutta import step


def test_a_step_is_the_exponential_s_series_up_to_the_fourth_power():
    y, h = np.array([1.0, -2.0]), 0.3
    series = 1 - h + h**2 / 2 - h**3 / 6 + h**4 / 24
    np.testing.assert_allclose(step(lambda y: -y, y, h), series * y, rtol=1e-14)


def test_tensors_and_arrays_take_the_same_step():
    y = np.array([[0.3, 1.2], [-0.5, 2.0]])

    def slope(y):
        return -(y**3)

    np.testing.assert_allclose(step(slope, torch.from_numpy(y), 0.1).numpy(), step(slope, y, 0.1), rtol=1e-14)

"""The ball that bounces against parabolas, and where it stays on the ground."""

from __future__ import annotations

import numpy as np
import pytest
import torch

import expertaug as ea
from expertaug.errors import InputError
from expertaug.systems.bouncing_ball import BouncingBall


def test_without_drag_it_flies_along_parabolas_before_and_after_a_bounce():
    g, e, t = 9.81, 0.8, 0.1 * np.arange(7)
    data = ea.simulate(BouncingBall(), {"g": (g, g), "e": (e, e)}, {"k": (0.0, 0.0)}, n=8, t=t)
    h0, v0 = data.y[:, :1, 0].astype(float), data.y[:, :1, 1].astype(float)
    impact = np.sqrt(v0**2 + 2 * g * h0)
    after = t - (v0 + impact) / g
    h = np.where(after < 0, h0 + v0 * t - g / 2 * t**2, e * impact * after - g / 2 * after**2)
    v = np.where(after < 0, v0 - g * t, e * impact - g * after)
    np.testing.assert_allclose(data.y, np.stack((h, v), -1), atol=1e-5)
    assert 0 < (after > 0).sum() < after.size


def test_a_ball_that_leaves_the_ground_slowly_stays_there():
    y = torch.tensor([[0.0, -0.1], [0.0, -1.0]], dtype=torch.float64)
    z_e = y.new_tensor([9.81, 0.8])
    assert BouncingBall(rest_m_s=0.09).jump(y, z_e).tolist() == [[0.0, 0.0], [0.0, 0.8]]
    with pytest.raises(InputError, match=r"system\.rest_m_s: found -1; a speed in m/s, at least 0"):
        BouncingBall(rest_m_s=-1)


def test_a_height_measured_below_the_ground_is_the_ground_s_and_the_ball_leaves_it():
    y0 = torch.tensor([[-0.02, -1.5], [0.3, -1.5]])
    assert torch.equal(BouncingBall().initial_state(y0, torch.ones(2)), torch.tensor([[0.0, 1.5], [0.3, -1.5]]))

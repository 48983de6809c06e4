"""The double pendulum against its energy and the paper's equations."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from expertaug.systems.double_pendulum import Constants, accelerations, energy, point_masses
from expertaug.systems.solvers.solver import Solver

REAL = Constants(0.103, 69.4, 1.35, 93.5)


@pytest.mark.slow
def test_double_pendulum_energy_is_conserved_without_friction_and_lost_with_it():
    y0 = torch.tensor([[2.0, 1.5, 3.0, -5.0], [0.5, -2.0, 12.0, 20.0]], dtype=torch.float64)
    t = torch.linspace(0, 2, 5, dtype=torch.float64)
    solver = Solver("dopri8", 1e-10, 1e-10)
    for friction, kept in (((0.0, 0.0), True), ((0.02, 0.12), False)):
        y = solver(lambda s, y, f=friction: torch.cat((y[..., 2:], accelerations(y, REAL, f)), -1), y0, t)
        change = energy(y.numpy(), REAL)[-1] / energy(y.numpy(), REAL)[0] - 1
        assert (np.abs(change) < 1e-6).all() if kept else (change < -1e-3).all()


def test_point_masses_are_the_papers_equations():
    l1, l2, m, g = 0.091, 0.070, 1.0, 9.81
    t1, t2, w1, w2 = np.random.default_rng(0).uniform(-3, 3, (4, 20)) * np.array([[1], [1], [9], [15]])
    common = 2 * m + m - m * np.cos(2 * t1 - 2 * t2)
    a1 = -g * 3 * m * np.sin(t1) - m * g * np.sin(t1 - 2 * t2)
    a1 -= 2 * np.sin(t1 - t2) * m * (w2**2 * l2 + w1**2 * l1 * np.cos(t1 - t2))
    a2 = w1**2 * l1 * 2 * m + g * 2 * m * np.cos(t1) + w2**2 * l2 * m * np.cos(t1 - t2)
    expected = np.stack((a1 / (l1 * common), 2 * np.sin(t1 - t2) * a2 / (l2 * common)), -1)
    found = accelerations(torch.from_numpy(np.stack((t1, t2, w1, w2), -1)), point_masses(l1, l2))
    np.testing.assert_allclose(found.numpy(), expected, rtol=1e-9)

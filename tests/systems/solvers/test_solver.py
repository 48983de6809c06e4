"""Solving on the data's grid and to a tolerance, and what is said of what is not finite."""

from __future__ import annotations

import pytest
import torch

from expertaug.errors import SolveError
from expertaug.systems.pendulum import DampedPendulum
from expertaug.systems.solvers.solver import Solver, check_finite


def test_fixed_grid_agrees_with_tolerance():
    """One RK4 step a data interval: 3e-4 rad on the pendulum over the observed window."""
    system = DampedPendulum()
    z_e, y0 = torch.linspace(0.5, 3.5, 31).unsqueeze(-1), torch.tensor([[1.5, 0.0]]).expand(31, 2)
    t = torch.linspace(0, 5, 51)
    fixed, exact = (
        s(lambda q, y: system.expert(q, y, z_e), y0, t) for s in (Solver("rk4"), Solver("dopri5", 1e-7, 1e-7))
    )
    assert 1e-7 < (fixed - exact).abs().max() < 3e-3


def test_substeps_divide_the_datas_grid():
    t, y0 = torch.tensor([0.0, 0.1, 0.3], dtype=torch.float64), torch.ones(1, dtype=torch.float64)
    fine = torch.tensor([0.0, 0.05, 0.1, 0.2, 0.3], dtype=torch.float64)

    def decay(s, y):
        return -14.0 * y * (1 + s)

    found = Solver("rk4", substeps=2)(decay, y0, t)
    torch.testing.assert_close(found, Solver("rk4")(decay, y0, fine)[[0, 2, 4]])
    exact = torch.exp(-14.0 * (t + t**2 / 2))
    assert (found[:, 0] - exact).abs().max() < 0.2 * (Solver("rk4")(decay, y0, t)[:, 0] - exact).abs().max()


def test_non_finite_trajectory_names_system_and_parameters():
    y = torch.zeros(3, 2, 5, 2)
    y[1, 1, 4, 0] = float("nan")
    z_e = torch.arange(10.0).reshape(2, 5, 1)
    with pytest.raises(SolveError, match=r"pendulum.*index \(1, 4\).*\(9\)"):
        check_finite(y, z_e, "pendulum")

"""Solving on the data's grid and to a tolerance, and what is said of what is not finite."""

from __future__ import annotations

import pytest
import torch

from expertaug.errors import InputError, SolveError
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


@pytest.mark.parametrize("method", ["rk4", "ab5", "rodas3"])
def test_a_step_may_go_over_several_points(method):
    """As exact between the steps' ends as there, where the last one is shorter too, and with a gradient."""
    system, t = DampedPendulum(), torch.linspace(0, 5, 504, dtype=torch.float64)
    z_e = torch.linspace(0.5, 3.5, 31, dtype=torch.float64).unsqueeze(-1).requires_grad_()
    y0 = torch.tensor([[1.5, 0.0]], dtype=torch.float64).expand(31, 2)
    calls = []

    def field(s, y):
        calls.append(s)
        return system.expert(s, y, z_e)

    found, every = Solver(method, points_per_step=10)(field, y0, t), len(calls)
    exact = Solver(method)(field, y0, t)
    assert every < 0.25 * (len(calls) - every)
    assert 1e-9 < (found - exact).abs().max() < 4 * (found - exact)[::10].abs().max() + 1e-4
    ends = [*range(0, 503, 10), 503]
    alone = Solver(method)(field, y0, t[ends])
    torch.testing.assert_close(found[ends], alone)
    gradients = [torch.autograd.grad(y.sum(), z_e)[0] for y in (found[ends], alone)]
    torch.testing.assert_close(*gradients)
    few = Solver(method, points_per_step=10)(field, y0, t[:1])
    assert torch.equal(few, y0.unsqueeze(0))
    torch.testing.assert_close(Solver(method, points_per_step=10)(field, y0, t[:11])[10], found[10])


def test_what_steps_over_points_do_not_fit_is_refused():
    with pytest.raises(InputError, match=r"points_per_step: found 3.*one of the two"):
        Solver(substeps=2, points_per_step=3)
    t, y0 = torch.linspace(0, 1, 11), torch.ones(1, 1)
    with pytest.raises(InputError, match="solved exactly"):
        Solver("ab5", points_per_step=3)(lambda s, y: -y, y0, t, lambda h: lambda y: y)
    bent = Solver(points_per_step=5)(lambda s, y: -y, y0, t, kinks=True)  # measured inputs bend at each point
    assert torch.equal(bent, Solver()(lambda s, y: -y, y0, t))

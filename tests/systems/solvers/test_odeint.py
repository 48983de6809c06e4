"""torchdiffeq's solvers, without scipy's integrators and on a grid that nothing waits for."""

from __future__ import annotations

import math
import subprocess
import sys

import pytest
import torch

from expertaug.systems.solvers.odeint import STEPS, odeint, on_grid


@pytest.mark.slow
def test_torchdiffeq_comes_without_scipys_integrators_and_still_finds_them():
    code = """if True:
        import sys, torch
        from expertaug.systems.solvers.solver import odeint
        assert "scipy.integrate" not in sys.modules
        found = odeint(lambda t, y: -y, torch.ones(1), torch.tensor([0.0, 1.0]), method="scipy_solver")
        assert "scipy.integrate" in sys.modules
        print(float(found[-1]))
    """
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert float(done.stdout) == pytest.approx(math.exp(-1), rel=1e-4)


@pytest.mark.parametrize("method", STEPS)
def test_steps_on_a_grid_are_torchdiffeqs_own(method):
    t, y0 = torch.tensor([0.0, 0.1, 0.3, 0.4], dtype=torch.float64), torch.ones(2, 1, dtype=torch.float64)

    def field(s, y):
        return torch.cos(s) - y**2

    torch.testing.assert_close(on_grid(field, y0, t, method), odeint(field, y0, t, method=method), rtol=0, atol=0)

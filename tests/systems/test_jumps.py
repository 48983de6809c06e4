"""Rates that jump are named before a solver creeps through them for ever; those that merely bend are solved."""

import numpy as np
import pytest
import torch

import expertaug as ea
from expertaug.errors import InputError
from expertaug.systems import Parameter, System
from expertaug.systems.jumps import find_jump
from expertaug.systems.solvers.solver import Solver


class Rubbed(System):
    """A mass on a spring, rubbed as ``law`` says of its speed."""

    state = (Parameter("x", "m"), Parameter("v", "m/s"))
    expert_parameters = (Parameter("k", "1/s²"), Parameter("mu", "m/s²"))
    interaction_parameters = (Parameter("c", "1/s"),)
    law = staticmethod(torch.sign)

    def expert(self, t, y, z_e):
        (x, v), (k, mu) = y.unbind(-1), z_e.unbind(-1)
        return torch.stack((v, -k * x - mu * self.law(v)), dim=-1)

    def truth(self, t, y, z_e, z_a):
        return self.expert(t, y, z_e) - torch.stack((0 * y[..., 0], z_a[..., 0] * y[..., 1]), dim=-1)

    def sample_initial_state(self, n, generator):
        x = 1 + torch.rand(n, generator=generator, dtype=torch.float64)
        return torch.stack((x, 0 * x), dim=-1)


def rubbed(law, **attributes):
    return type("Rubbed", (Rubbed,), {"law": staticmethod(law), **attributes})()


RANGES = {"z_e": {"k": [1.0, 4.0], "mu": [0.1, 0.3]}, "z_a": {"c": [0.0, 0.1]}}
TIMES = [0.1 * k for k in range(100)]


def test_a_solver_that_creeps_through_a_jump_is_stopped_by_one_line_that_names_events():
    with pytest.raises(InputError, match=r"Rubbed, set train, .*jump near x = .*, v = .*dopri5.*event"):
        ea.simulate(Rubbed(), **RANGES, n=20, t=TIMES)


@pytest.mark.parametrize(
    ("law", "solver"),
    [
        (torch.sign, Solver("rk4", substeps=5)),
        (torch.tanh, Rubbed.simulation),
        (lambda v: (v > 2.7).to(v), Rubbed.simulation),  # a jump that is crossed now and then costs a few steps
    ],
)
def test_what_can_be_solved_is(law, solver):
    assert np.isfinite(ea.simulate(rubbed(law, simulation=solver), **RANGES, n=3, t=TIMES).y).all()


@pytest.mark.parametrize(
    "law",
    [torch.tanh, torch.relu, torch.abs, lambda v: torch.tanh(v / 1e-3), lambda v: v.abs() * v, lambda v: 1 / (v - 0.3)],
)
def test_what_bends_or_has_a_pole_does_not_jump(law):
    y = torch.randn(16, 2, generator=torch.Generator().manual_seed(3), dtype=torch.float64)
    assert find_jump(law, y) is None


@pytest.mark.parametrize("place", [-1.4, -0.3, 0.0, 0.123, 1.2])
@pytest.mark.parametrize("height", [0.05, 1.0, 10.0])
def test_a_jump_is_found_where_it_is(place, height):
    y = torch.linspace(-1, 1, 16, dtype=torch.float64).unsqueeze(-1)
    found = find_jump(lambda y: y + height * (y > place), y)
    assert found is not None and abs(float(found) - place) < 1e-6

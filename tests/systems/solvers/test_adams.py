"""Adams-Bashforth steps: their order, what they cost, and what they do where steps or rates are uneven."""

import math

import pytest
import torch

import expertaug as ea
from expertaug.models import store
from expertaug.systems.pendulum import DampedPendulum
from expertaug.systems.reaction_diffusion import SIZE, ReactionDiffusion
from expertaug.systems.solvers.adams import adams_bashforth
from expertaug.systems.solvers.solver import Solver
from nightly import others_slow

T = torch.linspace(0, 4, 41, dtype=torch.float64)


def spiral(s, y):
    """Turns at 1 rad/s, decays at .1 1/s and is driven."""
    u, v = y.unbind(-1)
    return torch.stack((v - 0.1 * u, -u - 0.1 * v + torch.cos(s)), -1)


def solved(solver, t=T, field=spiral):
    return solver(field, torch.tensor([[1.0, 0.0], [0.2, -0.7]], dtype=torch.float64), t)


def error(solver, t=T):
    return float((solved(solver, t) - solved(Solver("rk4", substeps=100), t)).abs().max())


@pytest.mark.slow
@pytest.mark.parametrize(("method", "order"), others_slow([("ab5", 5), ("ab4", 4)]))
def test_half_the_step_is_of_its_order_more_accurate(method, order):
    coarse, fine = (error(Solver(method, substeps=n)) for n in (2, 4))
    assert order - 0.6 < math.log2(coarse / fine) < order + 0.6


@pytest.mark.parametrize(("method", "start"), [("ab4", [4, 2, 2]), ("ab5", [4, 4, 2, 2])])
def test_a_step_is_one_evaluation_once_it_has_started(method, start):
    called = []

    def counted(s, y):
        called.append(float(s))
        return spiral(s, y)

    solved(Solver(method), field=counted)
    assert len(called) == sum(start) + len(T) - 1 - len(start)


@pytest.mark.slow
def test_after_a_change_of_the_steps_length_it_starts_again():
    uneven = torch.cat((T[:12], T[11] + 0.03 * torch.arange(1, 20)))
    whole, parts = solved(Solver("ab5"), uneven), solved(Solver("ab5"), uneven[:12])
    torch.testing.assert_close(whole[:12], parts)
    again = Solver("ab5")(spiral, parts[-1], uneven[11:])
    torch.testing.assert_close(whole[11:], again)
    assert error(Solver("ab5"), uneven) < 1e-5


def test_rounded_times_are_equal_steps():
    """float32 times at 100 s differ from multiples of .1 s by 1e-6."""
    t = (100 + torch.arange(41) / 10).float()
    called = []
    Solver("ab5")(lambda s, y: called.append(1) or -y, torch.ones(1, 1), t)
    assert len(called) == 12 + 36


def test_as_accurate_as_runge_kutta_on_the_pendulum_with_two_steps_for_one():
    system = DampedPendulum()
    z_e, y0 = torch.linspace(0.5, 3.5, 31).double().unsqueeze(-1), torch.tensor([[1.5, 0.0]]).double().expand(31, 2)
    t = torch.linspace(0, 20, 201).double()

    def forecast(solver):
        return solver(lambda s, y: system.expert(s, y, z_e), y0, t)

    exact = forecast(Solver("dopri8", 1e-10, 1e-10))
    rk4, ab5 = (float((forecast(s) - exact).square().mean()) for s in (Solver("rk4"), Solver("ab5", substeps=2)))
    assert ab5 < 4 * rk4


def reaction_diffusion(solver, flow=None):
    system = ReactionDiffusion(reaction="without_k")
    y0 = torch.rand(3, 2, SIZE, SIZE, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    z_e, t = torch.tensor([[0.002, 0.007]]).double().expand(3, 2), torch.arange(21).double() / 10
    part = system.nonlinear if solver.splits else system.expert
    known = flow or (lambda h: system.linear_flow(z_e, h))
    return solver(lambda s, y: part(s, y, z_e), y0, t, known)


def test_diffusion_is_exact():
    exact = reaction_diffusion(Solver("dopri5", 1e-9, 1e-9))
    largest = [float((reaction_diffusion(Solver(m)) - exact).abs().max()) for m in ("ab4", "ab5", "rk4")]
    assert largest[1] < largest[0] < 5e-3 < 1e-2 < largest[2]


def test_a_flow_without_a_basis_gives_the_same():
    system = ReactionDiffusion(reaction="without_k")
    z_e = torch.tensor([[0.002, 0.007]]).double().expand(3, 2)
    found = reaction_diffusion(Solver("ab5"), lambda h: lambda y: system.linear_flow(z_e, h)(y))
    torch.testing.assert_close(found, reaction_diffusion(Solver("ab5")), rtol=0, atol=1e-10)


def test_gradients_are_those_of_the_steps():
    w = torch.tensor(1.3, dtype=torch.float64, requires_grad=True)
    y0 = torch.ones(1, 1, dtype=torch.float64)

    def last(w):
        return Solver("ab4")(lambda s, y: -w * y.square(), y0, T)[-1].sum()

    torch.autograd.gradcheck(last, w)


def test_where_measured_inputs_bend_steps_are_runge_kuttas():
    def by(method):
        return Solver(method)(spiral, torch.ones(1, 2).double(), T, kinks=True)

    assert torch.equal(by("ab5"), by("lawson4")) and not torch.equal(by("ab5"), solved(Solver("ab5"))[:, :1])


def test_forecasts_are_not_solved_by_a_trainings_coarse_steps():
    coarse = Solver("ab5", substeps=2)
    assert store.forecast_solver(coarse, ea.DampedPendulum()) == store.ACCURATE
    assert store.forecast_solver(coarse, ea.ReactionDiffusion()) == Solver("lawson4")


@pytest.mark.parametrize("order", [4, 5])
def test_rates_that_are_polynomials_in_time_are_integrated_exactly(order):
    start, power = torch.zeros(1, 1, dtype=torch.float64), order - 1
    found = adams_bashforth(lambda s, y: power * s ** (power - 1) + 0 * y, start, T, None, order)
    torch.testing.assert_close(found[:, 0, 0], T**power)

"""Stiff systems: simulated, and solved with gradients."""

from functools import cache
from itertools import pairwise

import numpy as np
import pytest
import torch
from scipy.integrate import solve_ivp

from expertaug.errors import InputError, SolveError
from expertaug.systems import Parameter, System
from expertaug.systems.settings import SimulatedData, SimulatedSet
from expertaug.systems.simulate import sample
from expertaug.systems.solvers.implicit import by_scipy, rodas3
from expertaug.systems.solvers.solver import Solver

MU = 100.0


class VanDerPol(System):
    """x'' = μ (1 − x²) x' − k x, of which the expert knows the restoring force."""

    state = (Parameter("x"), Parameter("v"))
    expert_parameters = (Parameter("k"),)
    simulation = Solver("radau", rtol=1e-8, atol=1e-10)

    def expert(self, t, y, z_e):
        x, v = y.unbind(-1)
        return torch.stack((v, -z_e[..., 0] * x), dim=-1)

    def truth(self, t, y, z_e, z_a):
        x, v = y.unbind(-1)
        drive = MU * (1 - x**2) * v
        return self.expert(t, y, z_e) + torch.stack((torch.zeros_like(drive), drive), dim=-1)

    def sample_initial_state(self, n, generator):
        x = 1.5 + torch.rand(n, generator=generator, dtype=torch.float64)
        return torch.stack((x, torch.zeros_like(x)), dim=-1)


def robertson(t, y):
    a, b, c = y.unbind(-1)
    slow, fast, quadratic = 0.04 * a, 1e4 * b * c, 3e7 * b**2
    return torch.stack((fast - slow, slow - fast - quadratic, quadratic), dim=-1)


@cache  # the same for every method
def exact(k, start, times):
    """x of a van der Pol oscillator at these times."""

    def rate(t, y):
        return [y[1], MU * (1 - y[0] ** 2) * y[1] - k * y[0]]

    return solve_ivp(rate, (0, times[-1]), start, "Radau", times, rtol=1e-10, atol=1e-12).y[0]


@pytest.mark.slow
@pytest.mark.parametrize("method", ["bdf", "radau"])
def test_van_der_pol_is_simulated_over_its_relaxations(method, monkeypatch):
    monkeypatch.setattr(VanDerPol, "simulation", Solver(method, rtol=1e-8, atol=1e-10))
    sets = {"train": SimulatedSet(size=2, z_e={"k": (0.8, 1.2)})}
    found = sample(VanDerPol(), SimulatedData(seed=0, step_s=10.0, t2_s=200.0, noise=0.0, sets=sets), "train")
    for n in range(2):
        k = float(found.z_e[n, 0])
        reference = exact(k, tuple(found.y[n, 0].astype(float)), tuple(found.t))
        np.testing.assert_allclose(found.y[n, :, 0], reference, rtol=1e-3, atol=1e-3)
    assert np.abs(np.diff(np.sign(found.y[..., 0]), axis=1)).sum() > 0  # some have jumped to the other branch


def test_rodas3_has_third_order():
    """On y' = −(1 + t) y², which depends on time; each halving of the step divides the error by eight."""
    errors = []
    for steps in (20, 40, 80):
        t = torch.linspace(0, 2, steps + 1, dtype=torch.float64)
        y = Solver("rodas3")(lambda s, y: -(1 + s) * y**2, torch.ones(1, 1, dtype=torch.float64), t)
        errors.append(abs(float(y[-1]) - 1 / 5))
    assert all(6.5 < a / b < 9.5 for a, b in pairwise(errors))


@pytest.mark.slow
def test_rodas3_follows_robertsons_reaction():
    t = torch.cat((torch.zeros(1, dtype=torch.float64), torch.logspace(-5, 4, 200, dtype=torch.float64)))
    start = torch.tensor([[1.0, 0, 0]], dtype=torch.float64)
    found = Solver("rodas3")(robertson, start, t)[:, 0].numpy()
    reference = solve_ivp(
        lambda s, y: robertson(None, torch.from_numpy(y)).numpy(), (0, 1e4), [1, 0, 0], "Radau", t.numpy(),
        rtol=1e-10, atol=1e-14,
    ).y.T  # fmt: skip
    np.testing.assert_allclose(found[:, [0, 2]], reference[:, [0, 2]], atol=1e-4)
    np.testing.assert_allclose(found.sum(1), 1, atol=1e-10)


def test_where_rk4_explodes_rodas3_holds_in_single_precision():
    t, start = torch.linspace(0, 20, 41), torch.tensor([[[2.0, 0.0]]])

    def field(s, y):
        x, v = y.unbind(-1)
        return torch.stack((v, MU * (1 - x**2) * v - x), dim=-1)

    reference = solve_ivp(
        lambda s, y: [y[1], MU * (1 - y[0] ** 2) * y[1] - y[0]],
        (0, 20),
        [2, 0],
        "Radau",
        t.numpy(),
        rtol=1e-9,
        atol=1e-9,
    ).y[0]
    assert not Solver("rk4")(field, start, t).isfinite().all()
    np.testing.assert_allclose(Solver("rodas3")(field, start, t)[:, 0, 0, 0], reference, atol=1e-3)
    np.testing.assert_allclose(Solver("radau", rtol=1e-4)(field, start, t)[:, 0, 0, 0], reference, atol=1e-2)


@pytest.mark.slow
def test_gradients_through_rodas3_are_those_of_finite_differences():
    t = torch.linspace(0, 2, 9, dtype=torch.float64)
    start = torch.tensor([[2.0, 0.0], [1.5, 0.1]], dtype=torch.float64)

    def solved(mu, y0):
        def field(s, y):
            x, v = y.unbind(-1)
            return torch.stack((v, mu * (1 - x**2) * v - x + torch.sin(mu * s)), dim=-1)

        return Solver("rodas3", substeps=2)(field, y0, t)

    mu = torch.tensor([50.0, 80.0], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(solved, (mu, start.requires_grad_()), eps=1e-5, atol=1e-5, rtol=1e-3)


def test_no_gradient_and_gradient_give_the_same_states():
    t, start = torch.linspace(0, 1, 5), torch.rand(2, 3, 3)
    weight = torch.randn(3, 3, requires_grad=True)

    def field(s, y):
        return torch.tanh(y @ weight) - y

    with torch.no_grad():
        without = Solver("rodas3")(field, start, t)
    assert torch.equal(Solver("rodas3")(field, start, t).detach(), without) and not without.requires_grad
    with pytest.raises(InputError, match=r"solver\.method: radau gives no gradients; train with rodas3"):
        Solver("radau")(field, start, t)


def test_constant_rates_and_fields():
    t = torch.linspace(0, 1, 3)
    assert torch.allclose(Solver("rodas3")(lambda s, y: torch.ones_like(y), torch.zeros(2, 1), t)[-1], torch.ones(2, 1))
    grid = torch.rand(4, 1, 6)

    def diffusion(s, y):
        return y.roll(1, -1) + y.roll(-1, -1) - 2 * y

    for method in ("rodas3", "radau"):
        with torch.no_grad():
            states = Solver(method, rtol=1e-5, substeps=8)(diffusion, grid, t, rank=2)
        expected = Solver("dopri5")(diffusion, grid, t)
        torch.testing.assert_close(states, expected, atol=1e-4, rtol=0)


def test_too_large_a_state_is_refused():
    with pytest.raises(InputError, match=r"rodas3 for states of 2048 numbers; it takes at most 128; lawson4"):
        Solver("rodas3")(lambda s, y: y, torch.zeros(1, 2, 32, 32), torch.arange(2.0), rank=3)


def test_a_solver_that_gives_up_says_so():
    with pytest.raises(SolveError, match="radau failed"):
        Solver("radau")(lambda s, y: y**2, torch.ones(1, 1, dtype=torch.float64), torch.linspace(0, 2, 3))


def test_a_stiff_linear_system_goes_as_its_matrix_exponential_says():
    matrix = torch.tensor([[-1000.0, 999.0], [0.0, -1.0]], dtype=torch.float64)
    t, start = torch.linspace(0, 1, 51, dtype=torch.float64), torch.tensor([[3.0, 1.0]], dtype=torch.float64)
    exact = torch.stack([torch.linalg.matrix_exp(matrix * s) @ start[0] for s in t])

    def field(s, y):
        return y @ matrix.T

    found = by_scipy(field, start, t, "radau", 1e-7, 1e-9)[:, 0]
    torch.testing.assert_close(found, exact, rtol=0, atol=1e-5)
    torch.testing.assert_close(rodas3(field, start, t)[-1, 0], exact[-1], rtol=0, atol=1e-5)

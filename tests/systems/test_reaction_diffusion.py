"""Reaction–diffusion against closed forms and a finer solve."""

import math

import pytest
import torch

from expertaug import systems
from expertaug.errors import InputError
from expertaug.models.hybrid import HybridModel
from expertaug.systems import simulate
from expertaug.systems.pendulum import DampedPendulum
from expertaug.systems.reaction_diffusion import SIZE, WIDTH, ReactionDiffusion, laplacian
from expertaug.systems.settings import SimulatedData, SimulatedSet
from expertaug.systems.simulate import sample
from expertaug.systems.solvers.solver import Solver

TRAIN = SimulatedSet(size=6, z_e={"a": (0.001, 0.004), "b": (0.001, 0.01)}, z_a={"k": (0.003, 0.005)})
DATA = SimulatedData(seed=0, step_s=0.1, t2_s=5.0, noise=0.0, sets={"train": TRAIN})


def wave(p, q):
    """A Fourier mode and the factor by which the five-point Laplacian multiplies it."""
    x = torch.arange(SIZE, dtype=torch.float64)
    mode = torch.cos(2 * math.pi * (p * x[:, None] + q * x) / SIZE)
    return mode, (2 * math.cos(2 * math.pi * p / SIZE) + 2 * math.cos(2 * math.pi * q / SIZE) - 4) / WIDTH**2


@pytest.mark.parametrize("numbers", [(1, 0), (3, 5), (16, 16)])
def test_a_fourier_mode_decays_as_its_eigenvalue_says(numbers):
    mode, factor = wave(*numbers)
    torch.testing.assert_close(laplacian(mode), factor * mode)
    system, z_e = ReactionDiffusion(), torch.tensor([[0.002, 0.005]], dtype=torch.float64)
    t = torch.linspace(0, 1, 11, dtype=torch.float64)
    y = Solver("dopri5", 1e-9, 1e-9)(lambda s, y: system.expert(s, y, z_e), torch.stack((mode, mode))[None], t)
    for k in range(2):
        expected = torch.exp(z_e[0, k] * factor * t)[:, None, None] * mode
        torch.testing.assert_close(y[:, 0, k], expected, rtol=0, atol=1e-7)


def test_uniform_fields_react_as_the_local_equations():
    """Without gradients the field is one FitzHugh–Nagumo oscillator; (0, 0) is a fixed point for k = 0 alone."""
    system, z_e = ReactionDiffusion(), torch.ones(1, 2)
    u, v, k = 0.5, -0.3, 0.004
    y = torch.tensor([u, v]).view(1, 2, 1, 1).expand(1, 2, SIZE, SIZE)
    rate = system.truth(torch.tensor(0.0), y, z_e, torch.tensor([[k]]))
    expected = torch.tensor([u - u**3 - k - v, u - v]).view(1, 2, 1, 1).expand_as(y)
    torch.testing.assert_close(rate, expected, rtol=0, atol=1e-4)


def test_what_the_expert_knows():
    y, z_e, t = torch.rand(3, 2, SIZE, SIZE), torch.full((3, 2), 1e-3), torch.tensor(0.0)
    system = ReactionDiffusion()
    torch.testing.assert_close(system.expert(t, y, z_e), 1e-3 * laplacian(y))
    knowing = ReactionDiffusion(reaction="without_k")
    assert torch.equal(knowing.expert(t, y, z_e), knowing.truth(t, y, z_e, torch.zeros(3, 1)))
    with pytest.raises(InputError, match=r"system\.reaction: True; false or without_k"):
        systems.load({"name": "reaction_diffusion", "reaction": True})


def test_simulation_agrees_with_a_finer_one_and_with_other_chunks(monkeypatch):
    system = ReactionDiffusion()
    assert system.state_shape == (2, SIZE, SIZE)
    assert system.error_dims == 2048
    data = sample(system, DATA, "train")
    monkeypatch.setattr(type(system), "simulation", Solver("dopri5", 1e-8, 1e-8))
    monkeypatch.setattr(simulate, "CHUNK", 2 * 2048)
    finer = sample(system, DATA, "train")
    assert data.y.shape == (6, 51, 2, SIZE, SIZE)
    assert (data.z_e == finer.z_e).all()
    assert 0 < abs(data.y - finer.y).max() < 1e-4


def test_shifting_the_start_shifts_the_trajectory():
    system = ReactionDiffusion()
    y, z_e, z_a = torch.rand(2, 2, SIZE, SIZE), torch.rand(2, 2), torch.rand(2, 1)
    shifted = system.truth(torch.tensor(0.0), y.roll((3, 5), (-2, -1)), z_e, z_a)
    torch.testing.assert_close(shifted, system.truth(torch.tensor(0.0), y, z_e, z_a).roll((3, 5), (-2, -1)))


def test_lawson_steps_of_the_datas_grid_are_exact_where_runge_kutta_is_not():
    system = ReactionDiffusion(reaction="without_k")
    y0 = torch.rand(3, 2, SIZE, SIZE, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    z_e, t = torch.tensor([[0.002, 0.007]]).double().expand(3, 2), torch.arange(6).double() / 10

    def solve(solver):
        part = system.nonlinear if solver.splits else system.expert
        return solver(lambda s, y: part(s, y, z_e), y0, t, lambda h: system.linear_flow(z_e, h))

    exact = solve(Solver("dopri5", 1e-9, 1e-9))
    lawson, plain = (float((solve(Solver(method)) - exact).abs().max()) for method in ("lawson4", "rk4"))
    assert lawson < 1e-4 < 1e-2 < plain


def test_lawson_is_runge_kutta_where_nothing_is_linear():
    system = DampedPendulum()
    z_e, y0, t = torch.ones(2, 1), torch.tensor([[1.0, 0.0], [0.3, 0.1]]), torch.arange(5) / 10
    a, b = (Solver(m)(lambda s, y: system.expert(s, y, z_e), y0, t) for m in ("lawson4", "rk4"))
    torch.testing.assert_close(a, b)


def test_a_hybrid_forecast_is_the_same_by_lawson_steps():
    system = ReactionDiffusion()
    times = torch.arange(4) / 10
    model = HybridModel(system, {"kind": "moments"}, {"kind": "polynomial"}).build_one(times)
    y = torch.rand(4, 3, 2, SIZE, SIZE, generator=torch.Generator().manual_seed(0))
    z_e, z_a = torch.tensor([[0.002, 0.007]]).expand(3, 2), torch.zeros(3, 1)
    a, b = (model.forecast(y[0], z_e, z_a, times, s) for s in (Solver("lawson4"), Solver("rk4", substeps=8)))
    torch.testing.assert_close(a, b, rtol=0, atol=1e-4)

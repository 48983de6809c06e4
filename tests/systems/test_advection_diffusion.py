"""Advection and diffusion against closed forms, and what the expert lacks."""

import math

import numpy as np
import torch
from scipy.linalg import expm

import expertaug as ea
from expertaug.systems.advection_diffusion import CELLS, WIDTH

TIMES = np.arange(50) * 0.02
NONE = torch.zeros((), dtype=torch.float64)
D, SPEED = 0.03, 0.1


def solved(z_a):
    """A mode of the central differences at the times, and its exact course."""
    system, numbers = ea.AdvectionDiffusion(), torch.arange(1, CELLS + 1, dtype=torch.float64)
    before, after = D / WIDTH**2 + z_a / (2 * WIDTH), D / WIDTH**2 - z_a / (2 * WIDTH)
    shape = (before / after) ** (numbers / 2) * torch.sin(3 * math.pi * numbers / (CELLS + 1))
    factor = -2 * D / WIDTH**2 + 2 * math.sqrt(before * after) * math.cos(3 * math.pi / (CELLS + 1))
    z, t = torch.tensor([[D], [z_a]]).double(), torch.from_numpy(TIMES)
    y = system.simulation(lambda s, y: system.truth(s, y, z[:1], z[1:]), shape.view(1, 1, CELLS), t)
    return y[:, 0, 0], torch.exp(factor * t)[:, None] * shape


def test_modes_decay_as_their_eigenvalues_say():
    for z_a in (0.0, SPEED):
        y, exact = solved(z_a)
        torch.testing.assert_close(y, exact, rtol=0, atol=1e-7 * float(exact.abs().max()))


def test_simulations_are_those_of_the_matrix_exponential():
    data = ea.simulate(ea.AdvectionDiffusion(), {"D": (0.01, 0.1)}, {"c": (0.01, 0.1)}, n=4, t=TIMES, seed=0)
    one = np.ones(CELLS - 1)
    second, first = np.diag(one, 1) + np.diag(one, -1) - 2 * np.eye(CELLS), np.diag(one, 1) - np.diag(one, -1)
    for y, z_e, z_a in zip(data.y[:, :, 0].astype(float), data.z_e, data.z_a, strict=True):
        matrix = float(z_e[0]) * second / WIDTH**2 - float(z_a[0]) * first / (2 * WIDTH)
        exact = np.stack([expm(matrix * t) @ y[0] for t in TIMES])
        assert abs(y - exact).max() < 1e-6


def test_diffusion_has_an_exact_flow():
    system, t = ea.AdvectionDiffusion(), torch.arange(4, dtype=torch.float64)
    y0 = torch.rand(2, 3, 1, CELLS, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    z_e = torch.tensor([[0.01], [0.05], [0.2]]).double().expand(2, 3, 1)
    exact = system.simulation(lambda s, y: system.expert(s, y, z_e), y0, t)
    stepped = ea.Solver("lawson4")(
        lambda s, y: system.nonlinear(s, y, z_e), y0, t, lambda h: system.linear_flow(z_e, h)
    )
    torch.testing.assert_close(stepped, exact, rtol=0, atol=1e-7)


def test_the_expert_lacks_the_advection_alone():
    system, x = ea.AdvectionDiffusion(), WIDTH * torch.arange(CELLS, dtype=torch.float64)
    y, z_e, z_a = (2 * x + 1).view(1, 1, CELLS), torch.tensor([[D]]).double(), torch.tensor([[SPEED]]).double()
    missing = system.truth(NONE, y, z_e, z_a) - system.expert(NONE, y, z_e)
    torch.testing.assert_close(missing[..., 1:-1], torch.full((1, 1, CELLS - 2), -2 * SPEED).double())
    beyond = torch.stack((-y[0, 0, 1], y[0, 0, -2])) * SPEED / (2 * WIDTH)  # of zeros next to both ends
    torch.testing.assert_close(missing[0, 0, [0, -1]], beyond)


def test_simulations_begin_with_an_arch():
    y0 = ea.AdvectionDiffusion().sample_initial_state(500, torch.Generator().manual_seed(0))
    assert y0.shape == (500, 1, CELLS) and y0[..., [0, -1]].abs().max() < 1e-12
    height = y0.amax((1, 2)) / math.sin(math.pi * 9 / 19)
    assert 0.5 <= height.min() < 0.52 and 1.48 < height.max() <= 1.5

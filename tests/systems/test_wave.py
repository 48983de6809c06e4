"""The damped wave equation against closed forms, and what the expert lacks."""

import math

import numpy as np
import pytest
import torch
from scipy.linalg import expm

import expertaug as ea
from expertaug.systems.wave import DampedWave

TIMES = torch.arange(25, dtype=torch.float64) * 1e-3
NONE = torch.zeros((), dtype=torch.float64)


def mode(system, p, q):
    """An eigenfunction that is zero at the edges, and what the Laplacian multiplies it by."""
    x = torch.arange(system.cells, dtype=torch.float64) * math.pi / (system.cells - 1)
    factor = (2 * math.cos(x[p]) + 2 * math.cos(x[q]) - 4) / system.width**2
    return torch.sin(p * x)[:, None] * torch.sin(q * x), factor


@pytest.mark.parametrize("numbers", [(2, 2), (2, 5), (30, 30)])
def test_a_standing_wave_dies_away_as_its_eigenvalue_says(numbers):
    system = DampedWave(cells=32)
    shape, factor = mode(system, *numbers)
    torch.testing.assert_close(system.laplacian(shape), factor * shape)
    z_e, z_a = torch.tensor([[330.0]]).double(), torch.tensor([[50.0]]).double()
    y0 = torch.stack((shape, torch.zeros_like(shape)))[None]
    y = system.simulation(lambda t, y: system.truth(t, y, z_e, z_a), y0, TIMES)[:, 0]
    frequency = math.sqrt(-factor * 330.0**2 - 50.0**2 / 4)
    decay, phase = torch.exp(-25.0 * TIMES), frequency * TIMES
    w = decay * (torch.cos(phase) + 25.0 / frequency * torch.sin(phase))
    speed = -decay * (frequency + 25.0**2 / frequency) * torch.sin(phase)
    torch.testing.assert_close(y[:, 0], w[:, None, None] * shape, rtol=0, atol=1e-6)
    torch.testing.assert_close(y[:, 1], speed[:, None, None] * shape, rtol=0, atol=1e-6 * frequency)


def test_simulations_are_those_of_the_matrix_exponential():
    system, t = DampedWave(cells=8), TIMES.numpy()
    data = ea.simulate(system, {"c": (330.0, 330.0)}, {"k": (50.0, 50.0)}, n=3, t=t, seed=0)
    unit = torch.eye(128, dtype=torch.float64).view(128, 2, 8, 8)
    z_e, z_a = torch.tensor([[330.0]]).double(), torch.tensor([[50.0]]).double()
    step = expm(system.truth(NONE, unit, z_e, z_a).flatten(1).T.numpy() * 1e-3)
    y = [data.y[:, 0].reshape(3, 128).astype(float)]
    for _ in t[1:]:
        y.append(y[-1] @ step.T)
    off = (data.y.reshape(3, 25, 128) - np.stack(y, 1)).reshape(3, 25, 2, 64)
    assert abs(off[:, :, 0]).max() < 1e-6 and abs(off[:, :, 1]).max() < 1e-4


def test_nothing_bends_across_an_edge():
    system = DampedWave(cells=6)
    x = torch.arange(6, dtype=torch.float64)
    torch.testing.assert_close(system.laplacian(3 * x[:, None] - x), torch.zeros(6, 6).double())
    bent = system.laplacian((x**2)[:, None].expand(6, 6)) * system.width**2
    assert (bent[[0, -1]] == 0).all() and (bent[1:-1] == 2).all()


def test_the_expert_lacks_the_damping_alone():
    system, draw = DampedWave(cells=8), torch.Generator().manual_seed(0)
    y = torch.rand(2, 3, 2, 8, 8, generator=draw)  # seeds and samples before the state
    z_e, z_a = torch.full((2, 3, 1), 330.0), torch.full((2, 3, 1), 50.0)
    expert = system.expert(torch.zeros(()), y, z_e)
    missing = system.truth(torch.zeros(()), y, z_e, z_a) - expert
    assert (missing[..., 0, :, :] == 0).all()
    torch.testing.assert_close(missing[..., 1, :, :], -50.0 * y[..., 1, :, :], rtol=1e-3, atol=0.1)
    kept = system.kinematics(y)
    assert torch.equal(kept[..., 0, :, :], expert[..., 0, :, :]) and (kept[..., 1, :, :] == 0).all()


def test_simulations_begin_with_one_peak_at_rest_on_every_grid():
    coarse, fine = (
        DampedWave(cells).sample_initial_state(200, torch.Generator().manual_seed(0)) for cells in (64, 127)
    )
    assert coarse.shape == (200, 2, 64, 64) and (coarse[:, 1] == 0).all()
    torch.testing.assert_close(fine[..., ::2, ::2], coarse)
    rows, columns = np.divmod(coarse[:, 0].flatten(1).argmax(1).numpy(), 64)
    assert {rows.min(), columns.min()} == {20} and {rows.max(), columns.max()} == {39}
    assert (coarse[:, 0].amax((1, 2)) == 1).all()
    beside = -1 / torch.log(coarse[torch.arange(200), 0, rows + 1, columns])  # s, of exp(−1/s)
    assert beside.min() > 10 and beside.max() < 100 and np.ptp(beside.numpy()) > 80


@pytest.mark.parametrize("cells", [3, 32.0, True])
def test_too_few_points_are_refused(cells):
    with pytest.raises(ea.InputError, match=r"system\.cells"):
        DampedWave(cells)

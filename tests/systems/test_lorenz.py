"""Lorenz's system against its fixed points, and what the expert lacks."""

import torch

from expertaug.systems.lorenz import Lorenz


def test_it_rests_where_it_should_and_the_expert_lacks_the_drive():
    system = Lorenz()
    sigma, beta, rho = 10.0, 8 / 3, 28.0
    z_e, z_a = torch.tensor([[sigma, beta]], dtype=torch.float64), torch.tensor([[rho]], dtype=torch.float64)
    side = (beta * (rho - 1)) ** 0.5
    rest = torch.tensor([[side, side, rho - 1], [-side, -side, rho - 1], [0.0, 0.0, 0.0]], dtype=torch.float64)
    none = torch.zeros(3, 3, dtype=torch.float64)
    torch.testing.assert_close(system.truth(torch.zeros(()), rest, z_e, z_a), none, atol=1e-12, rtol=0.0)
    y = torch.tensor([[1.0, 2.0, 3.0]], dtype=torch.float64)
    missing = system.truth(torch.zeros(()), y, z_e, z_a) - system.expert(torch.zeros(()), y, z_e)
    torch.testing.assert_close(missing, torch.tensor([[0.0, 25.0, 0.0]], dtype=torch.float64))


def test_simulations_begin_about_nothing():
    y0 = Lorenz().sample_initial_state(4000, torch.Generator().manual_seed(0))
    assert y0.shape == (4000, 3) and abs(y0.std().item() - 0.5) < 0.02

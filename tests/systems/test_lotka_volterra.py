"""Predators and prey: what they conserve, and what the expert lacks."""

import numpy as np
import torch

import expertaug as ea
from expertaug.systems.lotka_volterra import LotkaVolterra


def test_the_invariant_of_lotka_and_volterra_is_kept():
    a, b, c, d = 0.5, 0.8, 0.4, 0.6
    fixed = {"a": (a, a), "c": (c, c)}, {"b": (b, b), "d": (d, d)}
    data = ea.simulate(LotkaVolterra(), *fixed, n=5, t=0.5 * np.arange(21), seed=0)
    u, v = data.y[..., 0].astype(float), data.y[..., 1].astype(float)
    assert (data.y[:, 0] >= 1).all() and (data.y[:, 0] <= 2).all() and np.ptp(u) > 1
    invariant = d * u - c * np.log(u) + b * v - a * np.log(v)
    np.testing.assert_allclose(invariant, invariant[:, :1].repeat(21, 1), atol=2e-6)


def test_without_eating_prey_grow_and_predators_die():
    system = LotkaVolterra()
    y = torch.tensor([[2.0, 3.0]], dtype=torch.float64)
    z_e, z_a = torch.tensor([[0.5, 0.4]], dtype=torch.float64), torch.tensor([[0.8, 0.6]], dtype=torch.float64)
    alone, both = system.expert(torch.zeros(()), y, z_e), system.truth(torch.zeros(()), y, z_e, z_a)
    torch.testing.assert_close(alone, torch.tensor([[1.0, -1.2]], dtype=torch.float64))
    torch.testing.assert_close(both - alone, torch.tensor([[-4.8, 3.6]], dtype=torch.float64))

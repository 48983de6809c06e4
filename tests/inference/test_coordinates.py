"""Coordinates in which estimators seek: back to what they stand for, and of which components."""

from __future__ import annotations

import torch

from expertaug.inference.coordinates import PriorTransform, given_components, seen_components
from expertaug.systems.double_pendulum import DoublePendulum
from expertaug.systems.pendulum import DampedPendulum
from expertaug.systems.reaction_diffusion import ReactionDiffusion


def test_which_components_are_seen_and_given():
    double = DoublePendulum(expert="point_mass")
    assert seen_components(double).tolist() == [True, True, False, False]
    assert given_components(double).tolist() == [True, True, False, False]
    assert given_components(DampedPendulum()).tolist() == [True, True]
    field = ReactionDiffusion()
    assert seen_components(field).tolist() == [True, True] and given_components(field).tolist() == [False, False]


def test_z_a_is_drawn_where_f_a_was_learned():
    system = DampedPendulum()
    latents = torch.linspace(-2, 4, 50)[:, None]
    unknowns = PriorTransform(system, torch.tensor([0.5]), torch.tensor([3.5]), latents, 1, 0.01, beyond=0.5)
    theta = torch.tensor([[0.0, 0.3, 0.0, 0.0], [0.0, -600.0, 0.0, 0.0], [0.0, 600.0, 0.0, 0.0]])
    z_e, z_a, y0 = unknowns.transform.unpack(theta, torch.zeros(3, 2))
    std = latents.std()
    torch.testing.assert_close((z_a[0, 0] - latents.mean()).abs(), 0.3 * std)
    torch.testing.assert_close(
        z_a[1:, 0].sort().values, torch.stack((latents.min() - 0.5 * std, latents.max() + 0.5 * std))
    )
    torch.testing.assert_close(z_e, torch.full((3, 1), 2.0))
    assert torch.equal(y0, torch.zeros(3, 2))

"""Events within a step: jumps at their own times, sample by sample, and gradients through these times."""

from __future__ import annotations

import torch

from expertaug.systems.solvers.events import Event, step_through

G, E = 9.81, 0.8
GROUND = Event(lambda y: y[..., 0], lambda y: torch.stack((0 * y[..., 0], E * y[..., 1].abs()), dim=-1))
WALL = Event(lambda y: y[..., 0], lambda y: 0 * y)
T = torch.linspace(0, 0.8, 9, dtype=torch.float64)


def fall(s, y, side):
    return torch.stack((y[..., 1], torch.full_like(y[..., 1], -G)), dim=-1)


def heights(h0, t):
    """Of balls let go at h0 (n,), at times t (T,) up to the second bounce: (T, n)."""
    impact = torch.sqrt(2 * h0 / G)
    after = t[:, None] - impact
    return torch.where(after < 0, h0 - G / 2 * t[:, None] ** 2, E * G * impact * after - G / 2 * after**2)


def test_each_ball_bounces_at_its_own_time():
    h0 = torch.tensor([1.0, 0.7, 0.5], dtype=torch.float64)
    found = step_through(fall, torch.stack((h0, 0 * h0), dim=-1), T, GROUND)
    torch.testing.assert_close(found[..., 0], heights(h0, T), rtol=0, atol=1e-9)


def test_gradients_know_that_a_higher_ball_bounces_later():
    h0 = torch.tensor([1.0, 0.5], dtype=torch.float64, requires_grad=True)
    found = step_through(fall, torch.stack((h0, torch.zeros_like(h0)), dim=-1), T, GROUND)[-1, :, 0]
    (gradient,) = torch.autograd.grad(found.sum(), h0)
    (expected,) = torch.autograd.grad(heights(h0, T)[-1].sum(), h0)
    torch.testing.assert_close(gradient, expected, rtol=1e-6, atol=0)


def test_what_rests_on_the_event_stays_there():
    """The law of neither side leads away: gravity above, and below what pushes up."""
    found = step_through(lambda s, y, side: -side.unsqueeze(-1) * torch.ones_like(y), torch.zeros(1, 1), T, WALL)
    assert torch.equal(found, torch.zeros(9, 1, 1))

"""How large F_a is and what it holds of the expert, against direct formulas."""

import pytest
import torch

from expertaug.learning.expert_share import decorrelate, expert_share, expert_tangents, squares
from expertaug.models.decoder import Decoder
from expertaug.systems.pendulum import DampedPendulum
from expertaug.systems.rlc import RLC
from expertaug.systems.solvers.solver import Solver


def test_a_mixture_takes_each_component_from_another_window():
    states = torch.arange(2 * 1 * 5).view(2, 1, 5, 1) + torch.tensor([0.0, 100.0])
    mixed = decorrelate(states)
    assert (mixed[..., 1] - mixed[..., 0] != 100).all()
    for k in range(2):
        assert torch.equal(mixed[..., k].flatten().sort().values, states[..., k].flatten().sort().values)


def test_a_mixture_has_independent_components_where_a_common_source_drives_all_windows():
    t = torch.arange(24) / 24 * 2 * torch.pi
    common = torch.stack((torch.sin(t), torch.sin(t)), -1).view(24, 1, 1, 2).expand(-1, -1, 48, -1)
    mixed = decorrelate(common)
    assert (common[..., 0] * common[..., 1]).mean() > 0.4
    assert (mixed[..., 0] * mixed[..., 1]).mean().abs() < 0.01
    assert (mixed[..., 0] * torch.sin(t).view(24, 1, 1)).mean().abs() < 0.01


def test_tangents_are_the_derivatives_of_the_expert():
    t, y = torch.tensor([0.0, 0.7]).double(), torch.randn(2, 1, 3, 2).double()
    found = expert_tangents(DampedPendulum(), t, y, torch.full((1, 1, 1), 2.0).double(), torch.ones(1).double())
    torch.testing.assert_close(found[0, ..., 1], -4 * torch.sin(y[..., 0]))
    assert (found[..., 0].abs() < 1e-9).all()
    z_e, scale = torch.tensor([[[2.0, 1.0]]]).double(), torch.tensor([2.0, 1.0]).double()
    by_l, by_c = expert_tangents(RLC(), t, y, z_e, scale)
    voltage = (2.5 * torch.sin(2 * t) + 1).view(2, 1, 1) - y[..., 0]
    torch.testing.assert_close(by_l[..., 1], -voltage / 4 * 2, rtol=1e-6, atol=1e-8)
    torch.testing.assert_close(by_c[..., 0], -y[..., 1], rtol=1e-6, atol=1e-8)


def test_the_share_is_the_part_along_the_tangents():
    generator = torch.Generator().manual_seed(0)
    tangents = torch.randn(2, 4, 1, 6, 2, dtype=torch.float64, generator=generator)
    along = (tangents[0] - 3 * tangents[1]).unsqueeze(0)
    whole, share = squares(along, tangents)
    torch.testing.assert_close(share, whole, rtol=1e-4, atol=0)
    flat = tangents.flatten(1)
    other = torch.randn(1, 4, 1, 6, 2, dtype=torch.float64, generator=generator)
    within = flat.T @ torch.linalg.lstsq(flat.T, other.flatten()).solution
    across = other - within.view_as(other)
    whole, share = squares(across, tangents)
    assert share < 1e-8 * whole
    torch.testing.assert_close(squares(across + along, tangents)[1], squares(along, tangents)[1], rtol=1e-4, atol=0)


@pytest.mark.parametrize("of", ["restoring force", "friction", "both"])
def test_how_much_of_f_a_another_z_e_would_say(of):
    """A part of sin θ is the pendulum's expert with another ω0; a friction is not, where angle and speed are
    independent, as they are not along a swing that dies away."""

    class Rates(torch.nn.Module):
        def context(self, z_a, z_e):
            return z_a

        def forward(self, y, context):
            force, friction = 0.3 * torch.sin(y[..., 0]), -context[..., 0] * y[..., 1]
            rate = {"restoring force": force, "friction": friction, "both": force + friction}[of]
            return torch.stack((torch.zeros_like(rate), rate), -1)

    t = torch.arange(80, dtype=torch.float64) * 0.1
    z_e, z_a = torch.full((1, 64, 1), 2.0), torch.full((1, 64, 1), 0.4)
    start = torch.stack((torch.linspace(-1.5, 1.5, 64), torch.zeros(64)), -1).unsqueeze(0)
    decoder = Decoder(DampedPendulum(), Rates())
    states = decoder.forecast(start.double(), z_e.double(), z_a.double(), t, Solver("rk4"))
    share = expert_share(decoder, states, z_e, z_a, t)
    low, high = {"restoring force": (0.999, 1.0), "friction": (0.0, 0.15), "both": (0.2, 0.95)}[of]
    assert low <= float(share) <= high


def test_an_expert_without_parameters_to_move_it_holds_nothing():
    rates = torch.ones(3, 4, 2, 6, 2, dtype=torch.float64)
    whole, share = squares(rates, torch.zeros(2, 4, 2, 6, 2, dtype=torch.float64))
    assert torch.equal(whole, torch.ones(2, dtype=torch.float64)) and (share == 0).all()

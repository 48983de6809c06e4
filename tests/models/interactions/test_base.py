"""What every F_a shares: on which rates it acts, and what it sees of the latents."""

from __future__ import annotations

import pytest
import torch

from expertaug.errors import InputError
from expertaug.models.interactions.base import Interaction, positions
from expertaug.systems import Parameter, System


class Scaled(System):
    """Two components and two parameters, whose sizes differ by a thousand."""

    state = (Parameter("x"), Parameter("v"))
    expert_parameters = (Parameter("a", scale=0.1), Parameter("b", scale=100.0))

    def expert(self, t, y, z_e):
        return y


def test_rates_are_placed_on_the_components_that_it_acts_on_and_the_others_are_zero():
    y, rates = torch.randn(4, 2), torch.randn(4, 1)
    placed = Interaction(Scaled(), 1, components=("v",)).placed(rates, y)
    assert torch.equal(placed, torch.cat((torch.zeros(4, 1), rates), -1))
    both = Interaction(Scaled(), 1, components=("v", "x"))
    assert both.acts_on == [1, 0] and torch.equal(both.placed(y, y), y)


def test_expert_parameters_are_seen_in_units_of_their_size_where_they_are_seen():
    z_a, z_e = torch.randn(3, 2), torch.tensor([[0.2, 50.0]] * 3)
    alone, told = Interaction(Scaled(), 2), Interaction(Scaled(), 2, expert_parameters=True)
    assert torch.equal(alone.context(z_a, z_e), z_a) and (alone.inputs, told.inputs) == (2, 4)
    torch.testing.assert_close(told.context(z_a, z_e)[:, 2:], torch.tensor([[2.0, 0.5]] * 3))


def test_a_component_that_there_is_not_is_named_with_those_that_there_are():
    with pytest.raises(InputError, match=r"model\.interaction\.reads: 'w'; components of the state: x, v"):
        Interaction(Scaled(), 1, reads=("w",))
    assert positions(Scaled(), ["v", "x"], "key") == [1, 0]

"""Noise of observations: as settings say it, of what is observed, and as it is learned."""

from __future__ import annotations

import pytest
import torch

from cards import card
from expertaug.errors import InputError
from expertaug.models.observation_noise import (
    ESTIMATED,
    GaussianLikelihood,
    is_some,
    noise_of,
    of_observed,
    shape_as_state,
)
from expertaug.systems import Parameter, System
from expertaug.systems.pendulum import DampedPendulum
from expertaug.systems.reaction_diffusion import ReactionDiffusion

CARD = card({"t": [0.0, 0.1], "observed": 1})


class Summed(System):
    """Of two components the first is observed alone, and once beside the other."""

    state = (Parameter("a"), Parameter("b"))

    def expert(self, t, y, z_e):
        return y

    def observe(self, y):
        return torch.stack((y[..., 0], y[..., 0] + y[..., 1]), -1)


def test_settings_give_one_number_or_one_of_each_component_or_what_the_training_set_told():
    pendulum = DampedPendulum()
    assert noise_of(0.1, pendulum, CARD) == 0.1
    assert noise_of({"omega": 0.2}, pendulum, CARD) == [0.0, 0.2], "a component that is not named has none"
    assert noise_of(ESTIMATED, pendulum, CARD.but(data_noise=[0.3, 0.4])) == [0.3, 0.4]
    with pytest.raises(InputError, match="did you mean 'omega'"):
        noise_of({"omga": 0.2}, pendulum, CARD)
    with pytest.raises(InputError, match="estimated, but the training set does not say it"):
        noise_of(ESTIMATED, pendulum, CARD)
    assert is_some([0.0, 0.1]) and not is_some([0.0, 0.0]) and not is_some(0.0)


def test_noise_of_components_is_a_factor_of_states_and_adds_in_squares_where_they_are_observed_together():
    assert of_observed([3.0, 4.0], Summed()).tolist() == pytest.approx([3.0, 5.0])
    fields = torch.ones(5, 2, 32, 32)
    scaled = fields * shape_as_state([3.0, 4.0], fields, ReactionDiffusion())
    assert scaled[:, 0].unique().item() == 3 and scaled[:, 1].unique().item() == 4


def test_the_likelihood_begins_as_a_normal_one_of_the_datas_standard_deviation():
    torch.manual_seed(0)
    likelihood, observed, errors = GaussianLikelihood(), 3 * torch.randn(7, 50, 2), torch.randn(5, 4)
    likelihood.fit(observed)
    normal = torch.distributions.Normal(0.0, observed.std((0, 1)).square().mean().sqrt())
    found = likelihood.log_prob(errors.square().sum(-1), 4)
    torch.testing.assert_close(found, normal.log_prob(errors).sum(-1), rtol=1e-3, atol=1e-3)

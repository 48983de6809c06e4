"""What F_a may see."""

import pytest
import torch

from expertaug.errors import InputError
from expertaug.models.interactions.convolutional import ConvInteraction
from expertaug.models.interactions.mlp import MLPInteraction
from expertaug.models.interactions.polynomial import PolynomialInteraction
from expertaug.systems.pendulum import DampedPendulum
from expertaug.systems.reaction_diffusion import SIZE, ReactionDiffusion
from expertaug.systems.rlc import RLC

CASES = {"mlp": (RLC, MLPInteraction, (5, 2)), "conv": (ReactionDiffusion, ConvInteraction, (5, 2, SIZE, SIZE))}


def with_random_weights(kind, system, **arguments):
    """An interaction model fitted to random states, all of its weights random."""
    torch.manual_seed(0)
    interaction = kind(system, 1, **arguments)
    interaction.fit(torch.randn(4, 50, *system.state_shape))
    for parameter in interaction.parameters():
        torch.nn.init.normal_(parameter)
    return interaction, interaction.context(torch.randn(6, 1), torch.ones(6, len(system.expert_parameters)))


@pytest.mark.parametrize("kind", CASES)
def test_expert_parameters_reach_the_interaction_on_request_only(kind):
    system_class, cls, shape = CASES[kind]
    system, y, z_a = system_class(), torch.rand(shape), torch.randn(5, 3)
    scales = torch.tensor([p.scale for p in system.expert_parameters])
    torch.manual_seed(0)
    default, seeing = cls(system, 3), cls(system, 3, expert_parameters=True)
    assert torch.equal(default.context(z_a, scales.expand(5, 2)), default.context(z_a, 3 * scales.expand(5, 2)))
    rates = [seeing(y, seeing.context(z_a, k * scales.expand(5, 2))) for k in (1, 3)]
    assert not torch.equal(*rates)
    # In units of their scales: the context moves by the weights themselves.
    steps = seeing.context(z_a, 2 * scales.expand(5, 2)) - seeing.context(z_a, scales.expand(5, 2))
    torch.testing.assert_close(steps, seeing.latent_layer.weight[3:].sum(0).expand_as(steps))


def test_the_default_draws_the_same_weights_as_without_the_option():
    system = RLC()
    drawn = []
    for arguments in ({}, {"expert_parameters": False}):
        torch.manual_seed(0)
        drawn.append(MLPInteraction(system, 3, **arguments))
    assert drawn[0].latent_layer.weight.shape == (3, 50)
    for a, b in zip(drawn[0].parameters(), drawn[1].parameters(), strict=True):
        assert torch.equal(a, b)


@pytest.mark.parametrize(
    ("kind", "system_class", "acts", "other"),
    [
        (MLPInteraction, RLC, "I", 0),
        (PolynomialInteraction, RLC, "U", 1),
        (PolynomialInteraction, ReactionDiffusion, "v", 0),
    ],
)
def test_components_are_those_on_which_the_interaction_acts(kind, system_class, acts, other):
    system = system_class()
    interaction, context = with_random_weights(kind, system, components=[acts])
    rates = interaction(torch.randn(6, *system.state_shape), context)
    assert not rates[:, other].any()
    assert (rates[:, 1 - other] != 0).all()
    with pytest.raises(InputError, match="'Q'; components of the state: " + ", ".join(c.name for c in system.state)):
        kind(system, 1, components=["Q"])


@pytest.mark.parametrize(
    ("kind", "system_class", "reads", "unseen"),
    [
        (MLPInteraction, RLC, "I", 0),
        (MLPInteraction, DampedPendulum, "theta", 1),
        (PolynomialInteraction, DampedPendulum, "omega", 0),
        (PolynomialInteraction, ReactionDiffusion, "u", 1),
    ],
)
def test_what_the_interaction_does_not_read_changes_nothing(kind, system_class, reads, unseen):
    system = system_class()
    interaction, context = with_random_weights(kind, system, reads=[reads])
    y = torch.randn(6, *system.state_shape)
    seen = [c.name for c in system.state].index(reads)
    rates = interaction(y, context)
    assert (rates != 0).all(), "it still acts on every component"
    for k, same in ((unseen, True), (seen, False)):
        moved = y.clone()
        moved[:, k] += 0.5
        assert torch.equal(interaction(moved, context), rates) == same
    with pytest.raises(InputError, match=r"model\.interaction\.reads: 'Q'; components of the state: "):
        kind(system, 1, reads=["Q"])


def test_harmonics_of_the_window_stand_for_the_time():
    """F_a is then periodic in the time, and knows where in the window it is."""
    system, times = RLC(), torch.linspace(0, 2.0, 5)
    torch.manual_seed(0)
    interaction = MLPInteraction(system, 1, times=times, layers=(8,), time=True, harmonics=3)
    assert interaction.state_layer.weight.shape[0] == 2 + 2 * 3
    y, context = torch.rand(5, 2), interaction.context(torch.randn(5, 1), torch.ones(5, 2))
    rates = {t: interaction(y, context, torch.full((5, 1), t)) for t in (0.3, 2.3, 1.3)}
    torch.testing.assert_close(rates[0.3], rates[2.3])
    assert (rates[0.3] - rates[1.3]).abs().max() > 1e-3
    with pytest.raises(InputError, match="time: true"):
        MLPInteraction(system, 1, times=times, harmonics=3)

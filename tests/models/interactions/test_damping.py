"""An F_a that only takes energy."""

import pytest
import torch

from expertaug.errors import InputError
from expertaug.models.interactions.damping import DampingInteraction
from expertaug.systems.pendulum import DampedPendulum
from expertaug.systems.reaction_diffusion import ReactionDiffusion
from expertaug.systems.rlc import RLC


@pytest.mark.parametrize(
    ("system_class", "component"), [(DampedPendulum, "omega"), (RLC, "I"), (ReactionDiffusion, "u")]
)
def test_each_component_is_damped_in_proportion_to_itself_for_every_z_a(system_class, component):
    system = system_class()
    torch.manual_seed(0)
    damping = DampingInteraction(system, 2, components=[component])
    at = [c.name for c in system.state].index(component)
    y, z_a = torch.randn(50, *system.state_shape), 100 * torch.randn(50, 2)
    z_e = torch.ones(50, len(system.expert_parameters))
    rates = damping(y, damping.context(z_a, z_e))
    assert rates.shape == y.shape
    factor = rates[:, at] / y[:, at]
    assert (factor <= 0).all() and (factor < -1).any(), "never a drive"
    others = [k for k in range(len(system.state)) if k != at]
    assert not rates[:, others].any()
    torch.testing.assert_close(damping(2 * y, damping.context(z_a, z_e)), 2 * rates)


def test_the_rate_is_monotone_in_z_a():
    torch.manual_seed(1)
    damping = DampingInteraction(DampedPendulum(), 1)
    z_a = torch.linspace(-5, 5, 200).unsqueeze(1)
    steps = damping.context(z_a, torch.ones(200, 1)).diff(dim=0)
    assert (steps > 0).all(0).logical_or((steps < 0).all(0)).all()


def test_stacked_seeds_agree_with_single_ones():
    system = ReactionDiffusion()
    y, z_a, z_e = torch.randn(3, 4, *system.state_shape), torch.randn(3, 4, 2), torch.ones(3, 4, 2)
    torch.manual_seed(0)
    single = [DampingInteraction(system, 2, expert_parameters=True) for _ in range(3)]
    stacked = DampingInteraction(system, 2, expert_parameters=True)
    for name in ("weight", "bias"):
        getattr(stacked.rate, name).data = torch.stack([getattr(one.rate, name).data for one in single])
    found = stacked(y, stacked.context(z_a, z_e))
    for k, one in enumerate(single):
        torch.testing.assert_close(found[k], one(y[k], one.context(z_a[k], z_e[k])))


def test_an_unknown_component_is_refused():
    with pytest.raises(InputError, match="'omga'"):
        DampingInteraction(DampedPendulum(), 1, components=["omga"])

"""The polynomial interaction model against the polynomials it must be able to be."""

import numpy as np
import pytest
import torch

from cards import card
from expertaug.models.estimators import Hybrid
from expertaug.models.interactions.polynomial import PolynomialInteraction
from expertaug.systems.reaction_diffusion import ReactionDiffusion, local_reaction
from expertaug.systems.rlc import RLC
from expertaug.systems.solvers.solver import Solver
from seen import seen

CASES = {
    RLC: {"encoder": {"kind": "recurrent", "hidden": 4, "layers": [3]}, "interaction": {"latent_degree": 1}},
    ReactionDiffusion: {
        "encoder": {"kind": "conv", "channels": [3], "strides": [1], "layers": [4], "latent": 2},
        "interaction": {"layers": [5], "expert_parameters": True},
    },
}


def make(system_class, seeds):
    case = CASES[system_class]
    model = case | {"interaction": {"kind": "polynomial"} | case["interaction"]}
    description = {"t": (np.arange(5) * 0.1).tolist(), "observed": 4, "seeds": seeds, "model": model}
    system = system_class()
    y = torch.rand(5, 1, 6, *system.state_shape, generator=torch.Generator().manual_seed(0))
    made = Hybrid.network(system, card(description | {"expert": True, "interaction": True}))
    made.interaction.fit(y[:, 0])
    return made, y.expand(-1, len(seeds), *y.shape[2:]), torch.tensor(description["t"])


@pytest.mark.parametrize("system_class", CASES)
def test_terms_are_orthonormal_over_the_training_set(system_class):
    system = system_class()
    model = PolynomialInteraction(system, 3)
    observed = torch.rand(4, 500, *system.state_shape) * 0.2 + 0.7
    model.fit(observed)
    y = observed.reshape(-1, 2, model.cells)
    x = (y - model.mean) / model.std
    terms = (model.mix @ model._monomials(x)).transpose(0, 1).flatten(1).double()
    torch.testing.assert_close(terms @ terms.T / terms.shape[1], torch.eye(10, dtype=torch.float64), rtol=0, atol=1e-3)


@pytest.mark.parametrize("system_class", CASES)
def test_the_first_forecasts_are_almost_the_experts(system_class):
    model, y, t = make(system_class, [0, 1])
    z_e, z_a = model.encode(seen(y[:4])).mean
    wild = torch.randn(z_a.shape, generator=torch.Generator().manual_seed(1))
    hybrid = model.forecast(y[0], z_e, wild, t, Solver("rk4"))
    expert = model.forecast(y[0], z_e, wild[..., :0, :], t, Solver("rk4"))
    assert 0 < (hybrid - expert).abs().max() < 0.03


def test_it_becomes_the_local_reaction_and_goes_on_as_it():
    """Least squares on states in [0, 1] gives the cubic everywhere."""
    system = ReactionDiffusion()
    model = PolynomialInteraction(system, 3).double()
    y = torch.rand(40, 2, 32, 32, dtype=torch.float64)
    model.fit(y.unsqueeze(0))
    terms = (model.mix @ model._monomials((y.flatten(2) - model.mean) / model.std)).transpose(0, 1).flatten(1)
    wanted = local_reaction(y).transpose(0, 1).flatten(1)
    coefficients = torch.linalg.lstsq(terms.T, wanted.T).solution.T  # (components, terms)
    with torch.no_grad():
        model.varying.layers[0].weight.zero_()
        model.varying.layers[0].bias.copy_(coefficients[:, :1].reshape(1, -1))
        model.fixed.copy_(coefficients[:, 1:].reshape(1, -1))
    beyond = 3 * torch.rand(2, 2, 32, 32, dtype=torch.float64) - 2
    found = model(beyond, model.context(torch.randn(2, 3, dtype=torch.float64), torch.zeros(2, 2)))
    torch.testing.assert_close(found, local_reaction(beyond), rtol=0, atol=1e-4)


@pytest.mark.parametrize("system_class", CASES)
def test_gradient_reaches_every_parameter(system_class):
    model, y, t = make(system_class, [0, 1])
    forecast, z_e = model.predict(seen(y[:4], t), Solver("rk4"))
    (forecast.square().sum() + z_e.sum()).backward()
    for parameter_name, parameter in model.named_parameters():
        assert parameter.grad is not None and parameter.grad.abs().sum() > 0, parameter_name


@pytest.mark.parametrize("system_class", CASES)
def test_a_block_computes_what_each_seed_does_alone(system_class):
    group, y, t = make(system_class, [3, 4])
    together, _ = group.predict(seen(y[:4], t), Solver("rk4"))
    for k, seed in enumerate([3, 4]):
        alone, _ = make(system_class, [seed])[0].predict(seen(y[:4, :1], t), Solver("rk4"))
        torch.testing.assert_close(together[:, k], alone[:, 0], rtol=1e-4, atol=1e-5)


def test_one_seed_needs_no_seed_axis():
    system = RLC()
    model, y = PolynomialInteraction(system, 3, degree=2), torch.randn(5, 2)
    model.fit(torch.randn(4, 9, 2))
    rate = model(y, model.context(torch.randn(5, 3), torch.rand(5, 2)))
    assert rate.shape == (5, 2)


def test_latent_degree_says_which_terms_vary():
    """With degree 0 the samples' rates differ by a constant; with 1 by a linear function of the state."""
    system, z_a, z_e = RLC(), torch.randn(1, 3), torch.ones(1, 2)
    y = torch.linspace(-1, 1, 5)[:, None] * torch.tensor([1.0, 2.0])
    for degree in (0, 1):
        model = PolynomialInteraction(system, 3, degree=3, latent_degree=degree)
        rates = [model(y, model.context(z, z_e).expand(5, -1)) for z in (z_a, -z_a)]
        change = (rates[0] - rates[1]).detach()
        assert (change.diff(dim=0).abs().max() < 1e-5) == (degree == 0)
        torch.testing.assert_close(change.diff(dim=0).diff(dim=0), torch.zeros(3, 2), rtol=0, atol=1e-5)


def test_far_beyond_the_training_set_the_terms_stay_constant():
    system = ReactionDiffusion()
    interaction = PolynomialInteraction(system, 1)
    interaction.fit(torch.rand(3, 8, 2, 32, 32))
    context = interaction.context(torch.ones(1, 1), torch.ones(1, 2))
    far = torch.full((1, 2, 32, 32), 1e30)
    assert torch.isfinite(interaction(far, context)).all()
    assert torch.equal(interaction(far, context), interaction(2 * far, context))

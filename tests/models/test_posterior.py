"""The posteriors against closed forms."""

import math

import pytest
import torch
from torch.distributions import Normal, kl_divergence

from expertaug.models.posterior import Delta, Gaussian, constrain, log_slope, unconstrain
from expertaug.systems import Parameter

PARAMETERS = (Parameter("a", "s", scale=1e-3), Parameter("b", "rad/s", positive=False, scale=10.0))


@pytest.fixture
def gaussian():
    generator = torch.Generator().manual_seed(0)
    loc, log_std = torch.randn(2, 4, 2, generator=generator, dtype=torch.float64), torch.full((2, 4, 2), -1.0)
    return Gaussian(loc, log_std.double(), PARAMETERS)


def test_constraining_can_be_undone():
    raw = torch.tensor([[-30.0, -3.0], [0.0, 0.0], [80.0, 5.0]], dtype=torch.float64)
    value = constrain(raw, PARAMETERS)
    assert (value[:, 0] > 0).all() and value[0, 1] == -30.0
    torch.testing.assert_close(unconstrain(value, PARAMETERS), raw)


def test_slope_is_the_derivative():
    raw = torch.tensor([[-2.0, 1.0], [3.0, -4.0]], dtype=torch.float64, requires_grad=True)
    (slope,) = torch.autograd.grad(constrain(raw, PARAMETERS).sum(), raw)
    torch.testing.assert_close(log_slope(raw, PARAMETERS).exp(), slope)


def test_samples_are_positive_and_have_the_given_quantiles(gaussian):
    noise = torch.randn(2, 40_000, 2, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    wide = Gaussian(gaussian.loc[:, :1].expand(-1, 40_000, -1), torch.zeros(2, 40_000, 2).double(), PARAMETERS)
    samples = wide.draw(lambda k: noise[..., :k])
    assert (samples[..., 0] > 0).all() and (samples[..., 1] < 0).any()
    torch.testing.assert_close(samples.median(1)[0], wide.mean[:, 0], rtol=0.05, atol=0.1)
    assert (gaussian.rsample(torch.Size([3]))[..., 0] > 0).all()


def test_density_integrates_to_one_and_matches_the_transformed_normal():
    one = Gaussian(torch.tensor([[0.3]]).double(), torch.tensor([[-0.5]]).double(), PARAMETERS[:1])
    z = (torch.arange(1, 40_000, dtype=torch.float64) * 2.5e-7).unsqueeze(-1)
    density = one.log_prob(z).exp()
    assert torch.trapezoid(density, z[:, 0]).item() == pytest.approx(1.0, abs=1e-3)
    plain = Gaussian(torch.tensor([[3.0]]), torch.tensor([[0.7]]), PARAMETERS[1:])
    expected = Normal(30.0, 10.0 * math.exp(0.7)).log_prob(torch.tensor([12.0]))
    torch.testing.assert_close(plain.log_prob(torch.tensor([[12.0]])), expected)


def test_density_in_units_of_a_prior_does_not_depend_on_the_parameters_unit(gaussian):
    unit = torch.tensor([1e-4, 3.0], dtype=torch.float64)
    value = gaussian.mean * torch.tensor([1.3, 0.9], dtype=torch.float64)
    millis = (Parameter("a", "ms", scale=1.0), PARAMETERS[1])
    other = Gaussian(gaussian.loc, gaussian.log_std, millis)
    factor = torch.tensor([1e3, 1.0], dtype=torch.float64)
    torch.testing.assert_close(gaussian.log_prob_in(value, unit), other.log_prob_in(value * factor, unit * factor))
    point = Delta(gaussian.mean).log_prob_in(value, unit)
    torch.testing.assert_close(point, -0.5 * ((value - gaussian.mean) / unit).square().sum(-1))


def test_divergence_is_torchs(gaussian):
    mean, std = torch.tensor([0.2, -1.0], dtype=torch.float64), torch.tensor([0.5, 2.0], dtype=torch.float64)
    expected = kl_divergence(Normal(gaussian.loc, gaussian.log_std.exp()), Normal(mean, std)).sum(-1)
    torch.testing.assert_close(gaussian.divergence(mean, std), expected)
    standard = kl_divergence(Normal(gaussian.loc, gaussian.log_std.exp()), Normal(0.0, 1.0)).sum(-1)
    torch.testing.assert_close(gaussian.divergence(), standard)


def test_a_point_takes_no_random_numbers():
    point = Delta(torch.ones(3, 2))
    assert point.draw(lambda k: pytest.fail("drawn")) is point.loc


def test_delta_is_a_gaussian_up_to_a_constant():
    loc, value, scale = torch.randn(5, 2), torch.randn(5, 2), torch.tensor([0.5, 3.0])
    gaussian = torch.distributions.Normal(loc, scale).log_prob(value).sum(-1)
    constant = torch.distributions.Normal(loc, scale).log_prob(loc).sum(-1)
    torch.testing.assert_close(Delta(loc, scale).log_prob(value), gaussian - constant)

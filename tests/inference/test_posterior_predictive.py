"""Draws of what an estimator says of a window."""

from __future__ import annotations

from dataclasses import replace

import torch
from fitted_pendulum import OBSERVED

from expertaug.inference.posterior_predictive import joint_draws
from expertaug.learning.random_streams import RandomStreams
from expertaug.models.decoder import Decoder
from expertaug.models.posterior import Delta, Estimates, Gaussian, Posterior
from expertaug.systems.pendulum import DampedPendulum
from seen import seen


def test_the_joint_draws_keep_what_the_fit_knows_of_start_and_parameter_together(fitted):
    """A window's own forecast is known far better than the marginals of omega0 and of the start would tell."""
    stored, data = fitted
    y = torch.from_numpy(data.y[:, :OBSERVED]).movedim(1, 0).unsqueeze(1).expand(-1, 2, -1, -1)
    found = stored.model.estimate(seen(y))
    z_e, z_a, y0 = joint_draws(stored.model, found, seen(y), 400, RandomStreams([0, 1], 9))
    assert z_e.shape == (400, 2, 80, 1) and z_a.shape == (400, 2, 80, 0) and y0.shape == (400, 2, 80, 2)
    assert not torch.equal(z_e[:, 0], z_e[:, 1])
    spread = found.posterior.z_e.log_std.exp().squeeze(-1)  # in the unbounded space; nearly the same above 1 rad/s
    assert ((z_e.std(0).squeeze(-1) / spread)[:, data.z_e[:, 0] > 2] - 1).abs().mean() < 0.25
    lowered = z_e.squeeze(-1) - z_e.squeeze(-1).mean(0)
    moved = y0[..., 0] - y0[..., 0].mean(0)
    correlation = (lowered * moved).mean(0) / (lowered.std(0) * moved.std(0))
    assert correlation.abs().mean() > 0.1


def test_a_point_has_no_draws(fitted):
    stored, data = fitted
    point = torch.ones(2, 4, 1)
    y = torch.from_numpy(data.y[:4, :OBSERVED]).movedim(1, 0).unsqueeze(1).expand(-1, 2, -1, -1)
    found = stored.model.estimate(seen(y))
    q = Posterior(Delta(point), Delta(point[..., :0]))
    assert (
        joint_draws(
            stored.model.decoder, replace(found, posterior=q), seen(torch.ones(3, 2, 4, 2)), 5, RandomStreams([0], 1)
        )
        is None
    )


def test_an_encoders_gaussian_is_drawn_from_as_it_is():
    shape, parameters = (2, 4, 1), DampedPendulum().expert_parameters
    z_e = Gaussian(torch.ones(shape), torch.full(shape, -2.0), parameters)
    q = Posterior(z_e, Gaussian(torch.zeros(2, 4, 3), torch.zeros(2, 4, 3)))
    y = torch.ones(OBSERVED, 2, 4, 2)
    drawn = joint_draws(Decoder(DampedPendulum()), Estimates(y[0], *q.mean, q), seen(y), 500, RandomStreams([0, 1], 1))
    assert [d.shape for d in drawn] == [(500, 2, 4, 1), (500, 2, 4, 3), (500, 2, 4, 2)]
    assert ((drawn[0].median(0).values - z_e.mean) / z_e.mean).abs().max() < 0.05 and (drawn[0] > 0).all()
    assert (drawn[1].std(0) - 1).abs().max() < 0.2 and torch.equal(drawn[2][7], y[0])

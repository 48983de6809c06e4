"""A convolutional F_a: what it sees at the ends of fields, and that parts of them are as good as the whole."""

from __future__ import annotations

import torch

from expertaug.models.interactions.convolutional import IN_CACHE, ConvInteraction
from expertaug.models.networks.convolutional import convolve, wrap
from expertaug.systems.advection_diffusion import AdvectionDiffusion
from expertaug.systems.reaction_diffusion import ReactionDiffusion


def test_without_a_ring_a_network_sees_zeros_beyond_the_ends():
    line = AdvectionDiffusion()
    model = ConvInteraction(line, 1, channels=[4], kernels=[3, 1])
    y, z_a = torch.rand(1, 1, 20), torch.rand(1, 1)
    other = y.clone()
    other[..., -1] += 1.0
    change = (model(other, model.context(z_a, z_a)) - model(y, model.context(z_a, z_a)))[0, 0]
    assert (change[:18] == 0).all() and (change[18:] != 0).all()
    inner = model(torch.nn.functional.pad(y, (2, 2))[..., 1:-1], model.context(z_a, z_a))[..., 1:-1]
    torch.testing.assert_close(model(y, model.context(z_a, z_a)), inner)


def test_padding_once_is_padding_before_every_layer():
    system = ReactionDiffusion()
    model, y, z_a = ConvInteraction(system, 3), torch.rand(2, 2, 32, 32), torch.randn(2, 3)
    hidden = torch.cat((y, z_a[..., None, None].expand(2, 3, 32, 32)), dim=1)
    first = torch.cat((model.state_layer.weight, torch.zeros(16, 3, 3, 3)), dim=1)
    first[:, 2:, 1, 1] = model.latent_layer.weight.T  # a constant channel, seen by the kernel's middle
    hidden = convolve(wrap(hidden, 1), first, model.latent_layer.bias[0])
    for layer in model.rest:
        hidden = convolve(wrap(torch.relu(hidden), 1), *layer.seeds()[0])
    found = model(y, model.context(z_a, torch.empty(2, 0)))
    torch.testing.assert_close(found, hidden, rtol=1e-4, atol=1e-6)


def test_fields_in_parts_are_fields_at_once():
    model = ConvInteraction(ReactionDiffusion(), 1).double()
    y = torch.rand(2 * IN_CACHE + 1, 2, 32, 32, dtype=torch.float64)
    context = model.context(torch.rand(len(y), 1, dtype=torch.float64), torch.rand(len(y), 2, dtype=torch.float64))
    with torch.no_grad():
        at_once = model.float()(y.float(), context.float())
        torch.testing.assert_close(model.double()(y, context), at_once.double(), rtol=1e-4, atol=1e-5)

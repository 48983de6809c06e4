"""The conditional U-Net and the convolutional two-step encoder."""

import pytest
import torch

from expertaug.errors import InputError
from expertaug.models.encoders.two_step import ConvTwoStep
from expertaug.models.hybrid import HybridModel
from expertaug.models.networks.convolutional import UNet
from expertaug.models.stacking import stack
from expertaug.systems.reaction_diffusion import ReactionDiffusion
from seen import seen

SMALL = {"channels": [3, 4], "strides": [1, 2], "layers": [6], "filter_channels": [3, 4, 5], "latent": 2}
MODEL = {"encoder": {"kind": "conv_two_step", **SMALL}, "interaction": {"kind": "conv", "channels": [3, 3]}}


def make(seed):
    torch.manual_seed(seed)
    return HybridModel(ReactionDiffusion(), **MODEL).build_one(torch.arange(3) * 0.1, likelihood=True)


def observed(samples=4):
    return torch.rand(3, samples, 2, 32, 32, generator=torch.Generator().manual_seed(1))


def noise(*lead):
    return lambda k: torch.randn(1, 4, k, generator=torch.Generator().manual_seed(k)).expand(*lead, -1, -1).squeeze(0)


def test_unet_is_periodic_and_conditional():
    torch.manual_seed(0)
    net, x, z = UNet(2, 3, (4, 5, 6)), torch.randn(2, 2, 16, 16), torch.randn(2, 3)
    out = net(x, z)
    assert out.shape == x.shape
    torch.testing.assert_close(net(x.roll((4, 8), (-2, -1)), z), out.roll((4, 8), (-2, -1)))
    assert not torch.allclose(net(x, z + 1), out)
    out.square().sum().backward()
    assert all(p.grad.abs().sum() > 0 for p in net.parameters())


def test_a_block_computes_what_each_seed_does_alone():
    models = [make(seed) for seed in (0, 1)]
    for model in models:
        model.fit(seen(observed()))
    alone = [model.encoder(observed(), noise(1)) for model in models]
    group = stack(models).encoder(observed().unsqueeze(1).expand(-1, 2, -1, -1, -1, -1), noise(2))
    for k in range(2):
        torch.testing.assert_close(group.filtered[k], alone[k].filtered, rtol=1e-4, atol=1e-5)
        torch.testing.assert_close(group.z_e.mean[k], alone[k].z_e.mean, rtol=1e-4, atol=1e-7)
        torch.testing.assert_close(group.z_a_used[k], alone[k].z_a_used, rtol=1e-4, atol=1e-5)


def test_posterior_is_positive_and_does_not_move_with_the_fields():
    model = make(0)
    model.fit(seen(observed()))
    posterior = model.encode(seen(observed()))
    assert posterior.filtered.shape == (4, 6, 32, 32) and (posterior.z_e.mean > 0).all()
    shifted = model.encode(seen(observed().roll((4, 8), (-2, -1))))
    torch.testing.assert_close(shifted.z_e.mean, posterior.z_e.mean, rtol=1e-4, atol=1e-7)


def test_a_grid_that_cannot_be_halved_is_named():
    with pytest.raises(InputError, match=r"filter_channels.*halved"):
        ConvTwoStep(ReactionDiffusion(), torch.arange(3) * 0.1, filter_channels=[2] * 7)

"""Convolutional networks: periodicity, one seed or a group, precision."""

import numpy as np
import pytest
import torch

from cards import card
from expertaug.errors import InputError
from expertaug.models import store
from expertaug.models.encoders.fields import ConvEncoder
from expertaug.models.estimators import Hybrid
from expertaug.models.hybrid import HybridModel
from expertaug.models.interactions.convolutional import ConvInteraction
from expertaug.models.networks.convolutional import CONVOLUTIONS, Conv, convolve, differences, wrap
from expertaug.systems.reaction_diffusion import ReactionDiffusion
from expertaug.systems.solvers.solver import Solver
from seen import seen

SYSTEM = {"name": "reaction_diffusion"}
MODEL = {
    "encoder": {"kind": "conv", "channels": [4, 6], "strides": [1, 2], "layers": [7], "latent": 3},
    "interaction": {"kind": "conv", "channels": [5, 4]},
}
T = (np.arange(6) * 0.1).tolist()


def make(seeds, **interaction):
    model = MODEL | {"interaction": MODEL["interaction"] | interaction}
    description = {"kind": "hybrid", "t": T, "observed": 4, "seeds": seeds, "expert": True, "interaction": True}
    description |= {"system": SYSTEM, "model": model}
    return Hybrid.network(ReactionDiffusion(), card(description)), description


def fields(seeds, samples=3):
    y = torch.rand(6, 1, samples, 2, 32, 32, generator=torch.Generator().manual_seed(1))
    return y.expand(-1, seeds, -1, -1, -1, -1)


def test_a_padded_convolution_is_torchs_circular_one():
    ours, theirs = Conv(2, 3, 4, 3, stride=2), torch.nn.Conv2d(3, 4, 3, 2, 1, padding_mode="circular")
    theirs.load_state_dict(ours.state_dict())
    x = torch.randn(5, 3, 8, 8)
    torch.testing.assert_close(convolve(wrap(x, 1), *ours.seeds()[0], ours.stride), theirs(x))


@pytest.mark.parametrize("rank", [1, 2, 3])
def test_differences_end_where_fields_do(rank):
    x, kernel = torch.rand(2, *[5] * rank), torch.zeros([3] * rank)
    for axis in range(rank):
        for end in (0, 2):
            kernel[tuple(end if k == axis else 1 for k in range(rank))] = 1
    kernel[(1,) * rank] = -2 * rank
    for periodic in (True, False):
        exact = convolve(wrap(x[:, None], 1, periodic), kernel[None, None], None)[:, 0]
        torch.testing.assert_close(differences(x, rank, periodic), exact)


def test_gradient_reaches_every_parameter():
    model, description = make([0, 1])
    y = fields(2)
    forecast, z_e = model.predict(seen(y[:4], torch.tensor(description["t"])), Solver("rk4"))
    (forecast.square().sum() + z_e.sum()).backward()
    for name, parameter in model.named_parameters():
        assert parameter.grad is not None and parameter.grad.abs().sum() > 0, name


@pytest.mark.parametrize("interaction", [{}, {"expert_parameters": True, "kernels": [3, 1, 1]}])
def test_a_block_computes_what_each_seed_does_alone(interaction):
    group, description = make([3, 4], **interaction)
    y, t = fields(2), torch.tensor(description["t"])
    together, _ = group.predict(seen(y[:4], t), Solver("rk4"))
    for k, seed in enumerate([3, 4]):
        alone, _ = make([seed], **interaction)[0].predict(seen(y[:4, :1], t), Solver("rk4"))
        torch.testing.assert_close(together[:, k], alone[:, 0], rtol=1e-4, atol=1e-5)


def test_one_seed_needs_no_seed_axis():
    y, t = fields(1), torch.tensor(T)
    stacked, plain = make([0])[0], make([0])[0]
    for parameter in list(plain.parameters()) + list(plain.buffers()):
        parameter.data = parameter.data[0]
    expected, _ = stacked.predict(seen(y[:4], t), Solver("rk4"))
    found, _ = plain.predict(seen(y[:4, 0], t), Solver("rk4"))
    torch.testing.assert_close(found, expected[:, 0], rtol=1e-4, atol=1e-5)


def test_saves_and_loads_to_the_same_bits(tmp_path):
    model, description = make([0, 1])
    store.save(tmp_path / "m.safetensors", model, card(description))
    again, y, t = store.load(tmp_path / "m.safetensors").model, fields(2), torch.tensor(T)
    assert torch.equal(model.predict(seen(y[:4], t), Solver("rk4"))[0], again.predict(seen(y[:4], t), Solver("rk4"))[0])


def test_shifted_fields_have_the_same_posterior_and_a_shifted_rate():
    model, _ = make([0])
    y = fields(1)[:4]
    shifted = y.roll((4, -6), (-2, -1))
    for a, b in zip(model.encode(seen(y)).mean, model.encode(seen(shifted)).mean, strict=True):
        torch.testing.assert_close(a, b, rtol=1e-4, atol=1e-6)
    context = model.interaction.context(*reversed(model.encode(seen(y)).mean))
    rate = model.interaction(y[0], context)
    torch.testing.assert_close(model.interaction(shifted[0], context), rate.roll((4, -6), (-2, -1)))


def test_estimates_start_at_the_parameters_size_and_are_positive():
    model, _ = make([0, 1, 2])
    z_e = model.encode(seen(fields(3)[:4])).z_e.mean
    assert (z_e / torch.tensor([1e-3, 5e-3]) > 0.2).all() and (z_e / torch.tensor([1e-3, 5e-3]) < 2).all()


def test_inputs_are_standardised_by_the_training_set():
    encoder = HybridModel(ReactionDiffusion(), **MODEL).build_one(torch.arange(4) * 0.1).encoder
    observed = fields(1, 40)[:4, 0] * torch.tensor([1.0, 3.0]).view(2, 1, 1)
    encoder.fit(observed)
    x = encoder.scale(encoder.inputs(observed))
    torch.testing.assert_close(x.mean((0, 2, 3)), torch.zeros(16), rtol=0, atol=1e-4)
    torch.testing.assert_close(x.std((0, 2, 3)), torch.ones(16), rtol=1e-3, atol=0)


def test_bfloat16_agrees_to_its_precision():
    y, t = fields(1), torch.tensor(T)
    exact, _ = make([0])[0].predict(seen(y[:4], t), Solver("rk4"))
    rough, _ = make([0], precision="bfloat16")[0].predict(seen(y[:4], t), Solver("rk4"))
    assert rough.dtype == torch.float32
    assert 0 < (rough - exact).abs().max() < 3e-3


def test_bad_settings_are_named():
    system, times = ReactionDiffusion(), torch.arange(4) * 0.1
    with pytest.raises(InputError, match=r"interaction\.kernels: found \[3, 3\]; give 3 odd sizes"):
        ConvInteraction(system, 3, kernels=(3, 3))
    with pytest.raises(InputError, match=r"interaction\.precision: found 'half'; known: float32, bfloat16"):
        ConvInteraction(system, 3, precision="half")
    with pytest.raises(InputError, match=r"encoder\.strides: found \[1\]; give 3 of them"):
        ConvEncoder(system, times, strides=(1,))


@pytest.mark.parametrize("rank", [1, 2, 3])
@pytest.mark.parametrize(("kernel", "stride"), [(1, 1), (3, 1), (3, 2), (1, 2)])
def test_double_precision_computes_what_torch_computes(rank, kernel, stride):
    generator = torch.Generator().manual_seed(0)
    sizes = (9, 7, 8)[:rank]  # no two alike
    x = torch.rand(3, 2, *sizes, generator=generator, dtype=torch.float64)
    weight = torch.rand(4, 2, *[kernel] * rank, generator=generator, dtype=torch.float64)
    bias = torch.rand(4, generator=generator, dtype=torch.float64)
    torch.testing.assert_close(
        convolve(x, weight, bias, stride), CONVOLUTIONS[rank](x, weight, bias, stride), rtol=1e-13, atol=0
    )

"""The hybrid-VAE's encoder and the model around it."""

import pytest
import torch

from cards import card
from expertaug import systems
from expertaug.models import store
from expertaug.models.encoders.two_step import TwoStep
from expertaug.models.estimators import Hybrid
from expertaug.models.posterior import LOG_STD, SPREAD
from expertaug.systems.solvers.solver import Solver
from seen import seen

SMALL = {"latent_layers": [7, 6], "filter_layers": [6, 5], "expert_layers": [8, 5]}
CONSTANTS = {"B1": 0.103, "G1": 69.4, "B2": 1.35, "G2": 93.5}
WINDOWS = {"theta1": [0.0, 0.1], "theta2": [0.05, 0.1]}
PENDULUM = {"system": {"name": "pendulum"}, "encoder": {"kind": "two_step", **SMALL}, "step": 0.1}
DOUBLE = {
    "system": {"name": "double_pendulum", "constants": CONSTANTS},
    "encoder": {"kind": "two_step", "windows": WINDOWS, "angles": list(WINDOWS), "latent": 3, "skip": True, **SMALL},
    "step": 0.01,
}
CASES = pytest.mark.parametrize("case", [PENDULUM, DOUBLE], ids=["pendulum", "double_pendulum"])


def make(case, seeds):
    model = {"encoder": case["encoder"], "interaction": {"kind": "mlp", "layers": [5, 5]}}
    parts = {"expert": True, "interaction": True, "likelihood": True}
    t = [case["step"] * k for k in range(20)]
    description = {"kind": "hybrid", "t": t, "observed": 11, "seeds": seeds, "model": model, **parts}
    description["system"] = case["system"]
    model = Hybrid.network(systems.load(case["system"]), card(description))
    model.fit(seen(data_for(case, 1)[:11, 0]))
    return model, description


def data_for(case, seeds, samples=6):
    size = len(systems.load(case["system"]).state)
    return torch.randn(20, 1, samples, size, generator=torch.Generator().manual_seed(1)).expand(-1, seeds, -1, -1)


def noise(seeds):
    """The same for every seed, alone or in a group."""
    return lambda k: torch.randn(1, 6, k, generator=torch.Generator().manual_seed(k)).expand(seeds, -1, -1)


@CASES
def test_a_block_computes_what_each_seed_does_alone(case):
    group, y = make(case, [3, 4, 5])[0], data_for(case, 3)
    together = group.encoder(y[:11], noise(3))
    for k, seed in enumerate([3, 4, 5]):
        alone = make(case, [seed])[0].encoder(y[:11, :1], noise(1))
        for name in ("filtered", "z_a_used"):
            torch.testing.assert_close(getattr(together, name)[k], getattr(alone, name)[0], rtol=1e-4, atol=1e-5)
        for one, other in zip(together.mean, alone.mean, strict=True):
            torch.testing.assert_close(one[k], other[0], rtol=1e-4, atol=1e-5)


@CASES
def test_unstacked_models_compute_the_same(case):
    from expertaug.models.hybrid import HybridModel

    y = data_for(case, 1)
    times = torch.arange(11, dtype=torch.float64) * case["step"]
    single = HybridModel(systems.load(case["system"]), case["encoder"]).build_one(times)
    stacked, _ = make(case, [0])
    single.load_state_dict({k: v[0] for k, v in stacked.state_dict().items() if k.startswith("encoder.")})
    torch.testing.assert_close(single.encode(seen(y[:11, 0])).mean[0], stacked.encode(seen(y[:11])).mean[0][0])


@CASES
def test_the_filtered_observation_is_what_g_p2_reads(case):
    model, _ = make(case, [0])
    posterior = model.encode(seen(data_for(case, 1)[:11]))
    assert posterior.filtered.shape == model.encoder.view(data_for(case, 1)[:11]).shape
    torch.testing.assert_close(model.encoder.infer(posterior.filtered).mean, posterior.z_e.mean)
    assert torch.equal(posterior.z_a_used, posterior.z_a.mean)


def test_filtering_depends_on_z_a_and_hardly_changes_anything_at_first():
    model, _ = make(PENDULUM, [0])
    seen = model.encoder.view(data_for(PENDULUM, 1)[:11])
    filtered = model.encoder.filter_network(seen, torch.zeros(1, 6, 1))
    assert (filtered - seen).abs().max() < 1.5 * seen.std()
    assert not torch.equal(filtered, model.encoder.filter_network(seen, torch.ones(1, 6, 1)))


def test_spread_of_the_posterior_is_bounded():
    model, _ = make(PENDULUM, [0])
    assert isinstance(model.encoder, TwoStep)
    for sign in (-1e6, 1e6):
        log_std = model.encode(seen(data_for(PENDULUM, 1)[:11] * sign)).z_e.log_std
        assert torch.isfinite(log_std).all() and (log_std - LOG_STD).abs().max() <= SPREAD


def test_windowed_encoder_sees_its_windows_only():
    model, _ = make(DOUBLE, [0])
    y = data_for(DOUBLE, 1).clone()
    before = model.encode(seen(y[:11]))
    y[1:5, ..., 1] += 1.0  # θ2 before 50 ms
    y[..., 2:] += 1.0  # speeds
    for one, other in zip(model.encode(seen(y[:11])).mean, before.mean, strict=True):
        assert torch.equal(one, other)
    y[5, ..., 1] += 1.0
    assert not torch.equal(model.encode(seen(y[:11])).mean[0], before.mean[0])


@CASES
def test_inputs_are_standardised_by_the_training_set(case):
    model, _ = make(case, [0])
    seen = model.encoder.view(data_for(case, 1)[:11])
    network = model.encoder.expert_network
    x = network.scale(network.features(seen))[0]
    torch.testing.assert_close(x.mean(0), torch.zeros(x.shape[1]), rtol=0, atol=1e-4)
    torch.testing.assert_close(x.std(0), torch.ones(x.shape[1]), rtol=1e-3, atol=0)


@CASES
def test_samples_beyond_those_of_z_a_follow_the_expert_alone(case):
    model, description = make(case, [0, 1])
    y0, t = data_for(case, 2)[0], torch.tensor(description["t"])
    z_e, z_a = model.encode(seen(data_for(case, 2)[:11])).mean
    both = model.forecast(torch.cat((y0, y0), 1), torch.cat((z_e, z_e), 1), z_a, t, Solver("rk4"))
    torch.testing.assert_close(both[:, :, :6], model.forecast(y0, z_e, z_a, t, Solver("rk4")))
    start = model.system.initial_state(y0, z_e)
    expert = Solver("rk4")(lambda s, y: model.system.expert(s, y, z_e), start, t)
    torch.testing.assert_close(both[:, :, 6:], expert)


@CASES
def test_saves_and_loads_to_the_same_bits(case, tmp_path):
    model, description = make(case, [0, 1])
    with torch.no_grad():
        model.likelihood.log_scale.sub_(0.3)
    store.save(tmp_path / "m.safetensors", model, card(description))
    again = store.load(tmp_path / "m.safetensors").model
    y = data_for(case, 2)
    assert torch.equal(model.encode(seen(y[:11])).mean[0], again.encode(seen(y[:11])).mean[0])
    assert torch.equal(model.likelihood.scale, again.likelihood.scale)


def test_likelihood_is_gaussian_with_the_datas_scale_at_first():
    model, _ = make(PENDULUM, [0, 1])
    observed = data_for(PENDULUM, 1)[:11, 0]
    scale = model.likelihood.scale
    assert scale.shape == (2, 1)
    assert scale[0].item() == pytest.approx(observed.var((0, 1)).mean().sqrt().item(), rel=1e-3)
    errors = torch.randn(2, 6, 40)
    expected = torch.distributions.Normal(0.0, scale.detach().unsqueeze(-1)).log_prob(errors).sum(-1)
    torch.testing.assert_close(model.likelihood.log_prob(errors.square().sum(-1), 40), expected)

"""Parts that are ordinary PyTorch modules: one seed or a group, and what the wrapping promises."""

from functools import partial

import pytest
import torch
from torch import nn

import plain_parts as parts
from cards import card
from expertaug.errors import InputError
from expertaug.models import store
from expertaug.models.describe import describe
from expertaug.models.encoders.window import WindowEncoder
from expertaug.models.hybrid import HybridModel
from expertaug.models.interactions.mlp import MLPInteraction
from expertaug.models.posterior import Gaussian, constrain
from expertaug.models.user_modules import UserEncoder, encoder_of
from expertaug.systems.rlc import RLC
from expertaug.systems.solvers.solver import Solver
from seen import seen

TIMES = torch.arange(5) * 0.1
SYSTEM = RLC()
ENCODERS = [
    parts.LinearEncoder,
    parts.InheritedEncoder,
    partial(parts.KeywordEncoder, gain=2.0, width=5),
    parts.GRUEncoder,
    parts.GaussianEncoder,
]
INTERACTIONS = [parts.LinearInteraction, parts.SpectralInteraction, parts.OwnInteraction]


def windows(seeds: int | None, samples: int = 6) -> torch.Tensor:
    y = torch.randn(5, samples, 2, generator=torch.Generator().manual_seed(0))
    return y if seeds is None else y.unsqueeze(1).expand(-1, seeds, -1, -1)


def recipe(encoder=parts.LinearEncoder, interaction=parts.LinearInteraction) -> HybridModel:
    return HybridModel(SYSTEM, encoder, interaction)


@pytest.mark.parametrize("interaction", INTERACTIONS)
@pytest.mark.parametrize("encoder", ENCODERS)
def test_a_group_computes_what_each_seed_does_alone(encoder, interaction):
    group = recipe(encoder, interaction).build(TIMES, [3, 4, 5]).eval()
    assert all(len(p) == 3 for p in group.parameters())
    together, z_e = group.predict(seen(windows(3), TIMES), Solver())
    for k, seed in enumerate([3, 4, 5]):
        one = recipe(encoder, interaction).build(TIMES, [seed]).eval()
        alone, own = one.predict(seen(windows(1), TIMES), Solver())
        torch.testing.assert_close(together[:, k], alone[:, 0])
        torch.testing.assert_close(z_e[k], own[0])
        flat, _ = one.predict(seen(windows(None), TIMES), Solver())
        torch.testing.assert_close(flat.reshape(alone[:, 0].shape), alone[:, 0])
        with torch.random.fork_rng():
            torch.manual_seed(seed)
            single = recipe(encoder, interaction).build_one(TIMES).eval()
        torch.testing.assert_close(single.predict(seen(windows(None), TIMES), Solver())[0], alone[:, 0])


@pytest.mark.parametrize("encoder", ENCODERS)
def test_gradients_are_those_of_each_seed(encoder):
    group = recipe(encoder).build(TIMES, [3, 4])
    group.predict(seen(windows(2), TIMES), Solver())[0].square().sum().backward()
    for k, seed in enumerate([3, 4]):
        one = recipe(encoder).build(TIMES, [seed])
        one.predict(seen(windows(1), TIMES), Solver())[0].square().sum().backward()
        for (name, p), (_, q) in zip(group.named_parameters(), one.named_parameters(), strict=True):
            assert (p.grad is None) == (q.grad is None), name
            if p.grad is not None:
                torch.testing.assert_close(p.grad[k], q.grad[0], rtol=1e-4, atol=1e-6)


def test_an_encoder_says_what_a_posterior_of_gaussians_is():
    model = recipe(parts.GaussianEncoder).build(TIMES, [0, 1])
    posterior = model.encode(seen(windows(2)))
    assert isinstance(posterior.z_e, Gaussian) and isinstance(posterior.z_a, Gaussian)
    assert posterior.z_e.log_std.shape == (2, 6, 2) and (posterior.z_e.mean > 0).all()
    assert posterior.z_a_used.shape == (2, 6, 2) and posterior.filtered is None


def test_unbounded_outputs_become_positive_parameters_of_their_size():
    encoder = recipe().build_one(TIMES).encoder
    raw = encoder.module(windows(None))[0]
    scale = torch.tensor([p.scale for p in SYSTEM.expert_parameters])
    torch.testing.assert_close(encoder(windows(None)).z_e.mean, scale * nn.functional.softplus(raw))


def test_what_fit_learns_is_the_same_for_every_seed_and_kept(tmp_path):
    whole = HybridModel(SYSTEM, partial(parts.KeywordEncoder, gain=2.0), {"kind": "mlp", "layers": [4]})
    model = whole.build(TIMES, [0, 1])
    model.fit(seen(windows(None)))
    assert torch.equal(model.encoder.module.size, windows(None).std().expand(2))
    description = describe(whole).model_dump() | {"kind": "hybrid", "t": TIMES.tolist(), "observed": 5, "seeds": [0, 1]}
    store.save(tmp_path / "m.safetensors", model, card(description))
    again = store.load(tmp_path / "m.safetensors", classes=[parts.KeywordEncoder]).model
    assert torch.equal(
        again.predict(seen(windows(2), TIMES), Solver())[0], model.eval().predict(seen(windows(2), TIMES), Solver())[0]
    )


def test_buffers_move_in_training_and_in_no_forecast():
    model = recipe(interaction=parts.SpectralInteraction).build(TIMES, [0, 1])
    before = {k: v.clone() for k, v in model.named_buffers()}
    assert before

    def moved() -> bool:
        return any(not torch.equal(v, before[k]) for k, v in model.named_buffers())

    with torch.no_grad():
        model.predict(seen(windows(2), TIMES), Solver())
    assert not moved()
    model.decoder.requires_grad_(False)
    model.predict(seen(windows(2), TIMES), Solver())
    assert not moved()  # frozen, as in fine-tuning
    model.decoder.requires_grad_(True)
    model.predict(seen(windows(2), TIMES), Solver())
    assert moved()


def test_tied_weights_stay_tied():
    class Tied(parts.LinearInteraction):
        def __init__(self, system, latent):
            super().__init__(system, latent, width=2)
            self.again = self.gain

        def forward(self, y, z_a):
            return super().forward(y, z_a) + self.again

    model = recipe(interaction=Tied).build(TIMES, [0, 1])
    assert model.decoder.interaction.module.again is model.decoder.interaction.module.gain
    model.predict(seen(windows(2), TIMES), Solver())[0].sum().backward()
    assert model.decoder.interaction.module.again.grad.shape == (2,)


def test_a_subclass_of_a_stackable_class_is_wrapped():
    class Doubled(MLPInteraction):
        def forward(self, y, context):
            return 2 * super().forward(y, context)

    windowed = partial(WindowEncoder, windows={"U": [0, 0.4]}, layers=[5], latent=1)
    own = HybridModel(SYSTEM, windowed, partial(Doubled, layers=[4])).build(TIMES, [0, 1])
    ours = HybridModel(SYSTEM, windowed, partial(MLPInteraction, layers=[4])).build(TIMES, [0, 1])
    assert type(ours.decoder.interaction) is MLPInteraction and type(own.decoder.interaction) is not Doubled
    y, z_a = torch.randn(2, 6, 2), torch.randn(2, 6, 1)
    rates = [m.interaction(y, m.interaction.context(z_a, z_a)) for m in (own, ours)]
    torch.testing.assert_close(rates[0], 2 * rates[1])


@pytest.mark.parametrize("encoder", [parts.DropoutEncoder, parts.DropoutGRU])
def test_random_layers_are_refused(encoder):
    model = recipe(encoder).build(TIMES, [0, 1])
    with pytest.raises(InputError, match=r"model\.encoder: Dropout\w+ draws random numbers, .*; leave .* dropout out"):
        model.encode(seen(windows(2)))


@pytest.mark.parametrize(
    ("encoder", "interaction", "expected"),
    [
        (
            parts.FlatEncoder,
            parts.LinearInteraction,
            r"FlatEncoder gives z_e of shape \(6,\) for 6 windows; make it \(6, 2\)",
        ),
        (
            parts.LinearEncoder,
            parts.WrongShape,
            r"WrongShape gives shape \(6, 1\); give rates of the states' shape \(6, 2\)",
        ),
    ],
)
def test_a_wrong_shape_is_one_line(encoder, interaction, expected):
    with pytest.raises(InputError, match=expected):
        recipe(encoder, interaction).build(TIMES, [0, 1]).predict(seen(windows(2), TIMES), Solver())


def test_a_lazy_layer_is_refused():
    class Lazy(parts.LinearEncoder):
        def __init__(self, system, times):
            super().__init__(system, times)
            self.trunk = nn.LazyLinear(3)

    with pytest.raises(InputError, match=r"encoder\.module\.trunk\.weight: is a lazy layer's"):
        recipe(Lazy).build(TIMES, [0, 1])


def test_the_least_that_an_encoder_may_be_has_no_z_a_and_no_head_of_its_own():
    class Last(nn.Module):
        def forward(self, observed):
            return observed[-1]

    encoder, observed = encoder_of(Last(), SYSTEM), windows(None)
    found = encoder(observed)
    assert isinstance(encoder, UserEncoder) and encoder.latent == 0 and found.z_a.mean.shape == (6, 0)
    torch.testing.assert_close(found.z_e.mean, constrain(observed[-1], SYSTEM.expert_parameters))
    with pytest.raises(InputError, match=r"model\.encoder: Last has no head_prefix"):
        _ = encoder.head_prefix

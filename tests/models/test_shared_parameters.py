"""Expert parameters that are constants of a hybrid model: learned with it, alike in all windows, kept and not drawn."""

from __future__ import annotations

import numpy as np
import pytest
import torch

import expertaug as ea
from expertaug.errors import InputError
from expertaug.models.posterior import Delta, Gaussian, Posterior
from expertaug.models.shared_parameters import SharedParameters

T = np.arange(31) * 0.1
OMEGA0 = 1.7
PRIOR = {"omega0": (0.5, 3.5)}
INTERACTION = {"kind": "mlp", "layers": [8], "activation": "silu", "components": ["omega"], "start": 0.1}
ENCODERS = {
    "aphynity": {"kind": "window", "windows": {"theta": [0.0, 1.5]}, "layers": [16], "latent": 1},
    "hvae": {"kind": "two_step", "latent": 1, "latent_layers": [16], "filter_layers": [16], "expert_layers": [16]},
}


def swings(n, seed=0):
    return ea.simulate(
        ea.DampedPendulum(), {"omega0": (OMEGA0, OMEGA0)}, {"alpha": (0.1, 0.4)}, n=n, t=T, noise=0.01, seed=seed
    )


@pytest.fixture(scope="module")
def sets():
    return swings(60), swings(20, seed=1)


@pytest.fixture(scope="module")
def fitted(sets):
    def trained(name, shared=("omega0",), epochs=40, **options):
        recipe = ea.HybridModel(ea.DampedPendulum(), ENCODERS[name], INTERACTION, shared=shared)
        objective = {"aphynity": ea.Aphynity, "hvae": ea.HybridVAE}[name]
        given = {"prior": PRIOR} if name == "hvae" else {}
        given |= {"observed_s": 1.5, "seeds": (0, 1), "batch_size": 20, "learning_rate": 1e-2}
        return ea.fit(recipe, *sets, objective=objective, epochs=epochs, **given, **options)

    kept = {}
    return lambda name, **options: kept.setdefault((name, *sorted(options.items())), trained(name, **options))


def omega0_of(model, data):
    return np.asarray(model.forecast(data.seen[:, : model.observed], T).z_e["omega0"])


@pytest.mark.parametrize("name", ENCODERS)
def test_a_constant_is_learned_and_the_same_in_every_window(name, fitted, sets, tmp_path):
    model = fitted(name)
    seeds = [model[place] for place in range(2)]
    for one in seeds:
        found = omega0_of(one, sets[1])
        assert np.ptp(found) < 1e-6 and found[0] == pytest.approx(OMEGA0, rel=0.1)
    assert omega0_of(seeds[0], sets[1])[0] != omega0_of(seeds[1], sets[1])[0]
    (row,) = model.estimates(sets[1]).itertuples()
    assert (row.parameter, row.of) == ("omega0", "all windows (shared)")
    assert np.isfinite(row.error) == (name == "hvae")  # of a point nothing says how far off it is
    model.save(tmp_path / "m.safetensors")
    again = ea.load(tmp_path / "m.safetensors")
    window = sets[1].seen[:, : model.observed]
    np.testing.assert_array_equal(again.forecast(window, T).y, model.forecast(window, T).y)
    assert again.stored.card.kind == "hybrid_shared" and again.stored.card.shared == ["omega0"]


@pytest.mark.parametrize("name", ENCODERS)
def test_a_constant_is_not_drawn_nor_fine_tuned(name, fitted, sets):
    model = fitted(name, epochs=2)
    plus = ea.augment(model, *sets, prior=PRIOR, noise=0.01)
    constant = model.stored.model.held(torch.zeros(2, 1, 1))
    assert torch.equal(plus.drawn.train.z_e, constant.expand_as(plus.drawn.train.z_e))
    tuned = ea.finetune(model, *sets, augmented=plus, epochs=1, batch_size=20, learning_rate=1e-2)
    assert torch.equal(tuned.stored.model.held(torch.zeros(2, 1, 1)), constant)


def test_the_others_come_from_the_window():
    """A posterior of two parameters, of which the second is a constant of each of three seeds."""
    system = ea.DampedPendulum(friction="estimated")
    shared = SharedParameters(system, ["alpha"])
    with torch.no_grad():
        shared.slow, shared.slow_std = (torch.nn.Parameter(torch.randn(3, 1, 1)) for _ in range(2))
    shared.windows = torch.tensor(50.0)
    point = Posterior(Delta(torch.rand(3, 4, 2)), Delta(torch.rand(3, 4, 1)))
    held = shared.posterior(point)
    assert torch.equal(held.z_e.mean[..., 0], point.z_e.mean[..., 0]) and held.z_a is point.z_a
    scale = system.expert_parameters[1].scale
    torch.testing.assert_close(
        held.z_e.mean[..., 1], scale * torch.nn.functional.softplus(shared.loc[..., 0]).expand(3, 4)
    )
    wide = Posterior(Gaussian(torch.rand(3, 4, 2), torch.rand(3, 4, 2), system.expert_parameters), point.z_a)
    gaussian = shared.posterior(wide).z_e
    assert torch.equal(gaussian.log_std[..., 0], wide.z_e.log_std[..., 0])
    assert torch.equal(gaussian.loc[..., 1], shared.loc[..., 0].expand(3, 4))
    each = gaussian.divergences()
    torch.testing.assert_close(each.sum(-1), gaussian.divergence())
    assert torch.equal(shared.weights(each)[0, 0], torch.tensor([1.0, 1 / 50]))


def test_names_are_those_of_expert_parameters(sets):
    recipe = ea.HybridModel(ea.DampedPendulum(), ENCODERS["aphynity"], INTERACTION, shared=("omega",))
    with pytest.raises(InputError, match=r"shared\.omega: 'omega' is no expert parameter; did you mean 'omega0'"):
        ea.fit(recipe, *sets, observed_s=1.5, epochs=1)
    with pytest.raises(InputError, match=r"shared: found omega0, omega0; name each once"):
        SharedParameters(ea.DampedPendulum(), ["omega0", "omega0"])

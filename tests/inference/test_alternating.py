"""Learning F_a by alternation: it finds a known F_a, goes on to the same bits after a kill, and seeds do not meddle."""

import numpy as np
import pytest
import torch

import expertaug as ea
import tiny
from expertaug import systems
from expertaug.errors import InputError, SolveError
from expertaug.inference import alternating as stage
from expertaug.inference.alternating import run_stage as alternate
from expertaug.inference.least_squares import refine_by
from expertaug.inference.settings import AlternateJob, AlternatingSettings
from expertaug.learning.settings import Build
from expertaug.learning.train import describe_recipe
from expertaug.models import store
from expertaug.models.fit_settings import Refinement, RefinementSettings
from expertaug.models.settings import PartsSettings
from expertaug.systems.settings import SolverSettings
from expertaug.trajectories import Trajectories
from seen import seen
from tiny import but, of_kind

SETS = {name: tiny.swings(size, alpha=(0.1, 0.6)) for name, size in (("train", 80), ("validation", 20))}
DATA = tiny.DATA.model_copy(update={"t2_s": 4.0, "sets": SETS})
SETTINGS = of_kind(
    AlternateJob,
    tiny.SETTINGS,
    method="alternating",
    label="Alternating",
    build=Build(kind="alternating"),
    model=PartsSettings(interaction={"kind": "mlp", "layers": [8], "activation": "silu", "components": ["omega"]}),
    training=AlternatingSettings(steps=6, batch_size=40, validate_every=3, checkpoint_s=0.0),
    refinement=Refinement(settings=RefinementSettings(starts=16, tries=2), noise=0.01, prior=tiny.PRIOR),
    t1_s=2.0,
)


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    return tiny.simulated(tmp_path_factory.mktemp("pendulum"), DATA)


@pytest.fixture
def settings():
    return SETTINGS


def trained_by(settings, **training):
    return but(settings, training=but(settings.training, **training))


def prepared(data, settings):
    described = describe_recipe(settings)
    sets = [Trajectories.load(data / f"{name}.npz") for name in ("train", "validation")]
    return stage.prepare(systems.load(described.system), *sets, settings, described)


@pytest.mark.slow
def test_finds_the_damping(data, settings):
    long = trained_by(settings, steps=320, validate_every=40, learning_rate=0.02)
    training = prepared(data, but(long, seeds=[0]))
    stored = training.run()
    validation = Trajectories.load(data / "validation.npz")
    y = torch.from_numpy(validation.y).movedim(1, 0).unsqueeze(1)
    estimator = refine_by(stored, stored.card.refinement)
    found = estimator.estimate(seen(y[: stored.card.observed]))
    states = y[::4]
    with torch.no_grad():
        rates = torch.stack(
            [stored.model.interaction(s, stored.model.interaction.context(found.z_a, found.z_e)) for s in states]
        )
    truth = -torch.from_numpy(validation.z_a)[:, 0] * states[..., 1]
    assert (rates[..., 0] == 0).all()
    error = (rates[..., 1] - truth).square().mean().sqrt() / truth.square().mean().sqrt()
    assert error < 0.25
    assert ((found.z_e[0] - torch.from_numpy(validation.z_e)).abs() < 0.05).all()
    assert stored.card.best_score[0] < -6.5  # the noise alone: ln(2 · 0.01²) = −8.5; the expert alone: −2


@pytest.mark.slow
def test_goes_on_to_the_same_bits_after_a_kill(data, settings, tmp_path, monkeypatch):
    alternate(data, tmp_path / "whole.safetensors", tmp_path / "a", settings, None)
    done = stage.Alternation.step

    def killed(self):
        if self.step_ == 4:
            raise KeyboardInterrupt
        return done(self)

    monkeypatch.setattr(stage.Alternation, "step", killed)
    with pytest.raises(KeyboardInterrupt):
        alternate(data, tmp_path / "resumed.safetensors", tmp_path / "b", settings, None)
    counted = []
    monkeypatch.setattr(stage.Alternation, "step", lambda self: (counted.append(self.step_), done(self))[1])
    alternate(data, tmp_path / "resumed.safetensors", tmp_path / "b", settings, None)
    assert counted == [4, 5]
    one, other = (store.load(tmp_path / f"{name}.safetensors") for name in ("whole", "resumed"))
    for key, value in one.model.state_dict().items():
        assert torch.equal(value, other.model.state_dict()[key]), key
    for key in ("best_score", "best_step", "latent"):
        assert getattr(one.card, key) == getattr(other.card, key)


@pytest.mark.slow
def test_a_seed_is_the_same_alone_and_in_a_group(data, settings):
    together = prepared(data, settings).run()
    alone = prepared(data, but(settings, seeds=[1])).run()
    for key, value in alone.model.state_dict().items():
        torch.testing.assert_close(value[0], together.model.state_dict()[key][1], rtol=1e-4, atol=1e-5)
    assert not torch.allclose(
        together.model.interaction.state_layer.weight[0], together.model.interaction.state_layer.weight[1]
    )


@pytest.mark.slow
def test_the_interaction_leaves_to_the_expert_what_is_its_own(data, settings):
    def share(weight):
        how = {"steps": 60, "validate_every": 60, "learning_rate": 0.02, "share": weight}
        training = prepared(data, trained_by(settings, **how))
        training.run()
        return training.trainer.step()["expert_share"]

    assert share(1000.0).mean() < 0.6 * share(0.0).mean()


@pytest.mark.slow
def test_a_large_penalty_keeps_the_interaction_small(data, settings):
    def size(penalty):
        how = {"steps": 30, "validate_every": 30, "learning_rate": 0.02, "penalty": penalty}
        training = prepared(data, trained_by(settings, **how))
        training.run()
        return training.trainer.step()["size"]

    assert (size(1e6) < 0.5 * size(0.0)).all()


def test_a_model_file_holds_what_forecasts_need(data, settings, tmp_path):
    fit = but(settings.refinement, settings=but(settings.refinement.settings, starts=8, tries=1, steps=4))
    job = but(trained_by(settings, steps=2, batch_size=10, validate_every=2), refinement=fit, t1_s=1.0)
    path = tmp_path / "model.safetensors"
    alternate(data, path, tmp_path / "work", job, None)
    stored = store.load(path)
    assert stored.card.kind == "alternating" and stored.seeds == [0, 1]
    windows = torch.from_numpy(Trajectories.load(data / "validation.npz").y[:3, :11]).movedim(1, 0).unsqueeze(1)
    found = refine_by(stored, stored.card.refinement).estimate(seen(windows.expand(-1, 2, -1, -1)))
    assert found.z_e.shape == (2, 3, 1) and found.z_a.shape == (2, 3, 1)
    assert ((found.z_e > 0.5) & (found.z_e < 4)).all()


@pytest.mark.slow
def test_seeds_that_never_forecast_are_said(data, settings, monkeypatch):
    monkeypatch.setattr(stage.Alternation, "score", lambda self: torch.tensor([float("inf"), -1.0]))
    assert prepared(data, settings).run().failed == [0]
    monkeypatch.setattr(stage.Alternation, "score", lambda self: torch.full((2,), float("inf")))
    with pytest.raises(SolveError, match="finite error"):
        prepared(data, settings).run()


def test_an_interaction_model_is_needed(data, settings):
    with pytest.raises(InputError, match=r"model\.interaction: missing"):
        prepared(data, but(settings, model=PartsSettings()))


def test_the_size_is_measured_by_the_data_where_the_expert_alone_stands_still():
    """Predators and prey about their balance: without F_a the best growth and death are about none."""
    t, rates = 0.5 * np.arange(21), {"a": (0.5, 0.5), "c": (0.5, 0.5)}
    train, validation = (
        ea.simulate(ea.LotkaVolterra(), rates, {"b": (0.5, 1.0), "d": (0.5, 1.0)}, n=20, t=t, seed=seed)
        for seed in (0, 1)
    )
    job = but(
        SETTINGS,
        system={"name": "lotka_volterra"},
        model=PartsSettings(interaction={"kind": "mlp", "layers": [8], "activation": "silu"}),
        training=AlternatingSettings(steps=1, latent=2, solver=SolverSettings(method="rk4", substeps=2)),
        refinement=but(SETTINGS.refinement, prior={"a": (0.2, 1.0), "c": (0.2, 1.0)}),
        t1_s=5.0,
    )
    trainer = stage.prepare(ea.LotkaVolterra(), train, validation, job, describe_recipe(job)).trainer
    trainer.begin()
    slopes = np.sqrt((np.diff(train.y[:, :11], axis=1) / 0.5) ** 2).astype(float)
    slopes = np.sqrt((slopes**2).mean((0, 1)))
    assert (trainer.rates.numpy() >= 0.29 * slopes).all()
    assert trainer.rates[:, 0].numpy() == pytest.approx(0.3 * slopes[0], rel=1e-3)

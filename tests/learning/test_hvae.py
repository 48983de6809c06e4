"""The hybrid-VAE: its objective against direct formulas, its randomness, its augmentation and fine-tuning."""

import json

import pytest
import torch

from cards import card
from expertaug.errors import InputError
from expertaug.learning import augment as augmentation
from expertaug.learning.augment import run_stage as augment
from expertaug.learning.finetune import run_stage as finetune
from expertaug.learning.hvae import HybridVAE, raw_prior
from expertaug.learning.random_streams import RandomStreams
from expertaug.learning.settings import AugmentJob, Build, FinetuneJob, TrainSettings
from expertaug.learning.train import run_stage as train
from expertaug.learning.training_data import Batch, StackedSet, task_of
from expertaug.models import store
from expertaug.models.estimators import Hybrid
from expertaug.models.posterior import Gaussian, unconstrain
from expertaug.models.settings import PartsSettings
from expertaug.presets import resolve
from expertaug.systems.reaction_diffusion import ReactionDiffusion
from expertaug.systems.solvers.solver import Solver
from expertaug.trajectories import Trajectories
from nightly import others_slow
from seen import seen
from tiny import PRIOR, but, of_kind

CPU = torch.device("cpu")
TIMES = torch.arange(31) * 0.1


@pytest.fixture
def settings(settings):
    small = {"kind": "two_step", "latent_layers": [8, 8], "filter_layers": [8, 8], "expert_layers": [12, 8]}
    interaction = {"kind": "mlp", "layers": [6, 6], "activation": "selu"}
    model, build = PartsSettings(encoder=small, interaction=interaction), Build(kind="hybrid", objective="hvae")
    return but(settings, model=model, build=build, method="h", label="H", prior=PRIOR)


def run(data, folder, settings):
    train(data, folder / "model.safetensors", folder / "work", settings, None)
    return store.load(folder / "model.safetensors")


@pytest.fixture
def case(data, tmp_path, settings):
    """A trained model, one batch for its two seeds and the task."""
    stored = run(data, tmp_path, but(settings, training=but(settings.training, epochs=1)))
    batch = StackedSet.of(Trajectories.load(data / "train.npz"), CPU).whole(2)
    return stored.model, batch, task_of(TrainSettings(), stored.card, CPU, torch.tensor([0.5]))


def objective(seeds=(0, 1), choices=None, **options):
    return HybridVAE(list(seeds), resolve("corrected", choices or {}), PRIOR, **options)


class TestLoss:
    """Every term computed once more, one forecast after the other."""

    @pytest.fixture
    def direct(self, case):
        model, batch, task = case
        noise, y = RandomStreams([0, 1], 0, 2), batch.y[:11]
        posterior = model.encoder(y, lambda k: noise.normal(40, k))
        z_e = posterior.z_e.draw(lambda k: noise.normal(40, k))
        z_plus = 0.5 + 3.0 * noise.uniform(40, 1)

        def expert(z):
            return Solver("rk4")(lambda s, x: model.system.expert(s, x, z), y[0], task.t[:11])

        hybrid = model.forecast(y[0], z_e, posterior.z_a_used, task.t[:11], Solver("rk4"))
        prior = torch.distributions.Normal(*raw_prior(model, PRIOR))
        q_e = torch.distributions.Normal(posterior.z_e.loc, posterior.z_e.log_std.exp())
        q_a = torch.distributions.Normal(posterior.z_a.loc, posterior.z_a.log_std.exp())
        kl = torch.distributions.kl_divergence
        divergence = (kl(q_e, prior) + kl(q_a, torch.distributions.Normal(0.0, 1.0))).sum(-1).mean(1)
        sigma = model.likelihood.scale.view(1, 2, 1, 1)
        likelihood = torch.distributions.Normal(hybrid[1:], sigma).log_prob(y[1:]).sum((0, 3)).mean(1)
        apart = torch.distributions.Normal(hybrid[1:], sigma), torch.distributions.Normal(expert(z_e)[1:], sigma)
        inferred = model.encoder.infer(expert(z_plus).movedim(0, 2)).mean
        return {
            "elbo": likelihood - divergence,
            "r_ppc": kl(*apart).sum((0, 3)).mean(1) + divergence,
            "r_da1": (posterior.filtered - expert(z_e).movedim(0, 2)).square().sum((2, 3)).mean(1),
            "r_da2": ((inferred - z_plus).square().sum(-1) * 12 / 3.0**2).mean(1),
        }

    def test_terms_and_their_sum(self, case, direct):
        loss, parts = objective(alpha=0.3, beta=0.2, gamma=0.7).loss(*case)
        for name in ("r_ppc", "r_da1", "r_da2"):
            torch.testing.assert_close(parts[name], direct[name].detach(), rtol=1e-4, atol=1e-5)
        expected = -direct["elbo"] + 0.3 * direct["r_ppc"] + 0.2 * direct["r_da1"] + 0.7 * direct["r_da2"]
        torch.testing.assert_close(loss, expected / 20, rtol=1e-4, atol=1e-5)

    def test_r_da1_stops_the_gradient_at_the_experts_simulation(self, case):
        """Without the stop it would reach g_p2; g_p1 gets it."""
        model = case[0]
        gradients = []
        for beta in (0.0, 1.0):
            model.zero_grad()
            objective(alpha=0.0, beta=beta, gamma=0.0).loss(*case)[0].sum().backward()
            gradients.append({k: p.grad.clone() for k, p in model.named_parameters()})
        for name in gradients[0]:
            same = torch.allclose(gradients[0][name], gradients[1][name], rtol=1e-4, atol=1e-7)
            assert same != name.startswith(("encoder.filter", "encoder.latent")), name

    def test_r_ppc_leaves_the_likelihoods_scale_to_the_data(self, case):
        scale = case[0].likelihood.log_scale
        gradients = []
        for alpha in (0.0, 5.0):
            case[0].zero_grad()
            objective(alpha=alpha).loss(*case)[0].sum().backward()
            gradients.append(scale.grad.clone())
        torch.testing.assert_close(*gradients)

    def test_gradient_reaches_every_parameter(self, case):
        objective().loss(*case)[0].sum().backward()
        for name, parameter in case[0].named_parameters():
            assert parameter.grad is not None and parameter.grad.abs().sum() > 0, name

    def test_while_the_expert_is_alone_the_hybrids_forecast_is_its_own(self, case):
        """Solved once: the terms that compare the two are nothing, the others those of the expert's forecast."""
        model, batch, task = case
        with model.decoder.expert_alone():
            _, alone = objective().loss(model, batch, task)
        _, both = objective().loss(model, batch, task)
        assert torch.equal(alone["r_ppc"], alone["divergence"]) and (both["r_ppc"] > both["divergence"]).all()
        torch.testing.assert_close(alone["r_da1"], both["r_da1"])
        assert not torch.allclose(alone["data"], both["data"])

    def test_z_e_may_be_a_point(self, case):
        """Then it is not drawn, and has no divergence."""
        losses = [objective(choices={"hvae_z_e": "mean"}, gamma=0.0, alpha=0.0).loss(*case)]
        with torch.no_grad():
            case[0].encoder.expert_network.mlp.layers[-1].bias[..., 1:] += 0.5
        losses.append(objective(choices={"hvae_z_e": "mean"}, gamma=0.0, alpha=0.0).loss(*case))
        torch.testing.assert_close(losses[0][0], losses[1][0])

    def test_supervision_is_the_posteriors_density(self, case):
        model, batch, task = case
        labelled = Batch(batch.trajectories, batch.z_e, torch.zeros(2, 40).index_fill_(1, torch.arange(10), 1.0))
        plain, term = objective().loss(*case)[0], objective().loss(model, labelled, task)
        noise = RandomStreams([0, 1], 0, 2)
        posterior = model.encoder(batch.y[:11], lambda k: noise.normal(40, k))
        expected = -(posterior.z_e.log_prob(batch.z_e) + torch.tensor(0.5).log())[:, :10].mean(1)
        torch.testing.assert_close(term[1]["z_e"], expected.detach())
        torch.testing.assert_close(term[0] * 20, plain * 20 + expected)
        impossible = batch.z_e.index_fill(1, torch.arange(10, 40), -1.0)
        unlikely = Batch(batch.trajectories, impossible, labelled.supervised)
        assert torch.isfinite(objective().loss(model, unlikely, task)[0]).all()

    def test_a_sample_that_runs_away_is_left_out(self, case, monkeypatch):
        draw = Gaussian.draw

        def drawn(self, normal):
            z = draw(self, normal)
            return z if self.parameters is None else torch.where(torch.arange(40).view(1, 40, 1) == 3, 1e30 + 0 * z, z)

        monkeypatch.setattr(Gaussian, "draw", drawn)
        loss, parts = objective().loss(*case)
        loss.sum().backward()
        assert all(torch.isfinite(v).all() for v in parts.values())
        assert all(torch.isfinite(p.grad).all() for p in case[0].parameters())
        monkeypatch.setattr(Gaussian, "draw", draw)
        torch.testing.assert_close(parts["data"], objective().loss(*case)[1]["data"], rtol=0.2, atol=0.0)

    def test_another_encoder_is_named(self, data, tmp_path, settings):
        recurrent = but(settings.model, encoder={"kind": "recurrent", "hidden": 8, "layers": [8]})
        with pytest.raises(InputError, match=r"encoder\.kind.*RecurrentEncoder.*two-step"):
            run(data, tmp_path, but(settings, model=recurrent))


def test_prior_in_the_unbounded_space(case):
    mean, std = raw_prior(case[0], PRIOR)
    drawn = 0.5 + 3.0 * torch.rand(200_000, 1, generator=torch.Generator().manual_seed(0))
    draws = unconstrain(drawn, case[0].system.expert_parameters)
    torch.testing.assert_close(mean, draws.mean(0), rtol=0.02, atol=0.01)
    torch.testing.assert_close(std, draws.std(0), rtol=0.02, atol=0.01)
    with pytest.raises(InputError, match=r"augmentation\.prior\.omega0.*positive"):
        raw_prior(case[0], {"omega0": [-1.0, 2.0]})


def test_one_step_of_a_seed_is_the_same_alone_and_in_a_block(data, tmp_path, settings):
    settings = but(settings, seeds=[5, 6, 7], training=but(settings.training, epochs=1, batch_size=40))
    group = run(data, tmp_path / "group", settings).model.state_dict()
    for place, seed in enumerate(settings.seeds):
        alone = run(data, tmp_path / str(seed), but(settings, seeds=[seed])).model.state_dict()
        for name, value in alone.items():
            torch.testing.assert_close(group[name][place], value[0], rtol=1e-3, atol=1e-5)


def test_a_killed_training_resumes_to_the_same_bits(data, tmp_path, settings, killed):
    whole = run(data, tmp_path / "whole", settings).model.state_dict()
    killed(run, data, tmp_path / "killed", settings)
    resumed = run(data, tmp_path / "killed", settings).model.state_dict()
    assert all(torch.equal(whole[k], resumed[k]) for k in whole)


@pytest.mark.slow
def test_training_lowers_the_loss_and_the_likelihoods_scale(data, tmp_path, settings):
    run(data, tmp_path, but(settings, training=but(settings.training, epochs=30, learning_rate=1e-2)))
    log = [json.loads(line) for line in (tmp_path / "log.jsonl").open()]
    lines = [line for line in log if "loss" in line]
    for name in ("loss", "sigma", "data"):
        first, last = (torch.tensor(lines[k][name]) for k in (0, -1))
        assert (last < first).all(), name


def augmented(model, data, folder, settings, **choices):
    job = of_kind(AugmentJob, settings, noise=0.01, choices=but(settings.choices, **choices))
    augment(model, data, folder / "plus.st", job)
    plus = augmentation.load(folder / "plus.st", CPU, TIMES)
    return plus.train, plus.validation, plus.drawing.to_json()


def test_z_a_of_augmented_samples_is_drawn(data, tmp_path, settings):
    stored = run(data, tmp_path, settings)
    real = StackedSet.of(Trajectories.load(data / "train.npz"), CPU)
    plus = {z_a: augmented(tmp_path / "model.safetensors", data, tmp_path, settings, augmentation_noise="none",
                           augmented_z_a=z_a)[0] for z_a in ("posterior", "prior")}  # fmt: skip
    t = torch.tensor(stored.card.t[:11])
    y = real.y.expand(-1, 2, -1, -1)
    noise = RandomStreams([0, 1], 0, 1).normal(40, 1)
    for name, z_a in (("posterior", stored.model.encode(seen(y[:11])).z_a.draw(lambda k: noise)), ("prior", noise)):
        expected = stored.model.forecast(y[0], plus[name].z_e, z_a, t, Solver("rk4"))
        torch.testing.assert_close(plus[name].y, expected.detach(), rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("choices", others_slow([{}, {"resample": "epoch"}, {"frozen": "interaction_and_z_e_head"}]))
def test_finetuning_leaves_theta_alone(data, tmp_path, settings, choices):
    settings = but(settings, training=but(settings.training, epochs=1))
    before = run(data, tmp_path, settings)
    settings = but(settings, choices=but(settings.choices, **choices))
    model = tmp_path / "model.safetensors"
    augmented(model, data, tmp_path, settings)
    job = of_kind(FinetuneJob, settings, method="h+", label="H+")
    finetune(model, tmp_path / "plus.st", data, tmp_path / "plus.safetensors", tmp_path / "work", job, None)
    after = store.load(tmp_path / "plus.safetensors")
    frozen = ("decoder.", *(("encoder.expert_network.",) if "frozen" in choices else ()))
    for name, value in before.model.state_dict().items():
        kept = name.startswith(frozen) or name.endswith(("scale.mean", "scale.std", ".unit", ".time"))
        assert torch.equal(value, after.model.state_dict()[name]) == kept, name


@pytest.mark.parametrize("preset", others_slow(["paper", "code"]))
def test_every_preset_trains_augments_and_finetunes(preset, data, tmp_path, settings):
    once = but(settings.training, epochs=1)
    settings = but(settings, choices=resolve(preset), preset=preset, training=once)
    run(data, tmp_path, settings)
    model = tmp_path / "model.safetensors"
    augmented(model, data, tmp_path, settings)
    job = of_kind(FinetuneJob, settings)
    finetune(model, tmp_path / "plus.st", data, tmp_path / "p.st", tmp_path / "work", job, None)
    assert store.load(tmp_path / "p.st").card.preset == preset


def test_fields_have_the_same_objective():
    """Reaction–diffusion: every term is there and the gradient reaches every parameter."""
    small = {"channels": [3, 4], "strides": [1, 2], "layers": [6], "filter_channels": [3, 4], "latent": 2}
    model = {"encoder": {"kind": "conv_two_step", **small}, "interaction": {"kind": "conv", "channels": [3, 3]}}
    description = {"model": model, "seeds": [0, 1], "t": [0.0, 0.1, 0.2], "observed": 3, "expert": True}
    description |= {"interaction": True, "likelihood": True}
    system = ReactionDiffusion()
    stacked = Hybrid.network(system, card(description))
    y = torch.rand(3, 1, 4, 2, 32, 32, generator=torch.Generator().manual_seed(0))
    stacked.fit(seen(y[:, 0]))
    batch = StackedSet(seen(y), torch.full((1, 4, 2), 0.002), torch.ones(4)).whole(2)
    task = task_of(TrainSettings(), card(description), CPU, torch.tensor([1e-3, 2e-3]))
    loss, parts = HybridVAE([0, 1], resolve("corrected"), {"a": [0.001, 0.004], "b": [0.001, 0.01]}).loss(
        stacked, batch, task
    )
    loss.sum().backward()
    assert all((parts[name] > 0).all() for name in ("data", "divergence", "r_ppc", "r_da1", "r_da2"))
    for name, parameter in stacked.named_parameters():
        assert parameter.grad is not None and parameter.grad.abs().sum() > 0, name

"""Posteriors by flows: a known one is found, and files and checkpoints hold all of them."""

import pytest
import torch
from flow_pendulum import PENDULUM, windows
from known_posterior import COMMON, NOISE, asked, lines

from expertaug.errors import InputError
from expertaug.evaluation.forecasting import forecast
from expertaug.inference.coordinates import PriorTransform
from expertaug.inference.flow import SummaryNetwork, load
from expertaug.inference.flow_training import prepare
from expertaug.inference.flow_training import run_stage as flow
from expertaug.inference.posterior_predictive import predictive
from expertaug.inference.simulations import HELD_OUT
from expertaug.learning.settings import TrainOptions, TrainSettings
from expertaug.learning.train import prepare as prepare_training
from expertaug.models import store as models
from expertaug.models.describe import describe
from expertaug.models.hybrid import HybridModel
from expertaug.models.store import StoredModel
from expertaug.systems.double_pendulum import DoublePendulum
from expertaug.systems.settings import SimulatedData, SimulatedSet
from expertaug.systems.simulate import sample
from expertaug.systems.solvers.solver import Solver
from expertaug.trajectories import Trajectories
from field_systems import Fisher
from seen import seen

RK4 = Solver("rk4")


@pytest.fixture(scope="module")
def known():
    """A flow that has learned the lines' posterior, and windows of its own prior with their slopes and starts."""
    base, data = lines()
    how = {"steps": 300, "batch_size": 200, "learning_rate": 1e-2, "pool": 2000, "uses": 1, "held_out": 1000}
    training = prepare(base, data, asked({"slope": (-2.0, 2.0)}, NOISE, layers=(32, 32), **how))
    simulator, estimator = training.trainer.pool.simulator, training.run().model.eval()
    drawn = simulator.draw(400, HELD_OUT, 1)
    first = drawn.x[..., :1]  # the recurrent encoder has no windows: the context is every observed point
    slope, _, start = estimator.head.unknowns.transform.unpack(drawn.theta, first)
    return estimator, drawn.x.movedim(-1, 0).unsqueeze(-1), slope, start


def test_a_known_posterior_is_found(known):
    """Against Bayesian linear regression, far enough from the ends of p⁺: mean, width, coverage and correlation."""
    estimator, y, slope, start = known
    design = torch.stack((torch.ones(5), torch.linspace(0, 1, 5)), dim=1)
    # The starts are drawn as the training set's first points are spread: a standard normal number and the noise.
    precision = design.T @ design / NOISE**2 + torch.diag(torch.tensor([1 / (1 + NOISE**2), 0.0]))
    covariance = torch.linalg.inv(precision)
    mean = torch.einsum("pq,tq,tsbk->psb", covariance / NOISE**2, design, y)
    inside = mean[1].abs() < 1.0
    z_e, _, y0 = (x.squeeze(-1) for x in estimator.sample(seen(y), 400, seed=3))
    for found, truth, k in ((y0, start, 0), (z_e, slope, 1)):
        std, error = covariance[k, k].sqrt(), (found.mean(0) - mean[k])[inside]
        assert error.square().mean().sqrt() < 0.3 * std
        assert abs((found.std(0)[inside] / std).mean() - 1) < 0.12
        rank = (found < truth.squeeze(-1)).float().mean(0)
        assert abs(((rank > 0.05) & (rank < 0.95))[inside].float().mean() - 0.9) < 0.05
        assert abs(((rank > 0.25) & (rank < 0.75))[inside].float().mean() - 0.5) < 0.08
    stated = estimator.estimate(seen(y)).z_e_std.squeeze(-1)
    assert abs((stated[inside] / covariance[1, 1].sqrt()).mean() - 1) < 0.12
    product = ((z_e - z_e.mean(0)) * (y0 - y0.mean(0))).mean(0)[inside].mean()
    assert abs(product / covariance[0, 1] - 1) < 0.2


def test_its_density_is_one(known):
    """∫ q(slope, start | window) over a grid wide enough is 1."""
    estimator, y, slope, start = known
    y = y[:, :1, :1]
    around = [torch.linspace(float(x[0, 0]) - 2.5, float(x[0, 0]) + 2.5, 201) for x in (slope, start)]
    z_e, y0 = (g.reshape(1, -1, 1) for g in torch.meshgrid(*around, indexing="ij"))
    seeds = estimator.head.unknowns.low.shape[0]
    many = [x.expand(seeds, -1, -1) for x in (z_e, torch.zeros(1, z_e.shape[1], 2), y0)]
    with torch.no_grad():
        log = estimator.log_prob(seen(y.expand(-1, seeds, z_e.shape[1], -1)), *many)[0]
    assert abs(float(log.exp().sum()) * (5 / 200) ** 2 - 1) < 0.03


def test_forecasts_are_posterior_predictive(known):
    estimator, y, slope, start = known
    t = torch.linspace(0, 2, 9)
    found = predictive(estimator, seen(y, t), RK4, 200, levels=(0.05, 0.5, 0.95), seed=1, keep=True)
    assert torch.allclose(found.samples.mean(0), found.mean, atol=1e-5)
    assert torch.allclose(found.quantiles[1], found.samples.quantile(0.5, dim=0), atol=1e-5)
    truth = start + slope * t[-1]
    inside = (truth > found.quantiles[0, -1]) & (truth < found.quantiles[2, -1])
    assert abs(inside.float().mean() - 0.9) < 0.05
    scored = forecast(estimator, seen(y, t), RK4, "y0", None)
    assert (scored.states[-1] - truth).square().mean() < 1.3 * (found.mean[-1] - truth).square().mean()
    assert torch.equal(scored.states, estimator.predict(seen(y, t), RK4)[0])
    part = forecast(estimator, seen(y[:, :, 7:9], t), RK4, "y0", torch.full((2, 1), 100.0)).states
    assert torch.allclose(part, scored.states[:, :, 7:9], atol=1e-5), "a window's forecast depends on it alone"


def test_a_runaway_draw_is_cut_off_at_the_bound(known):
    estimator, y, _, _ = known
    cut = forecast(estimator, seen(y[:, :, :3], torch.linspace(0, 1e4, 5)), RK4, "y0", torch.tensor([50.0])).states
    assert torch.isfinite(cut).all() and cut.abs().max() <= 50.0


def run(pendulum, folder):
    flow(pendulum / "both.safetensors", pendulum, folder / "model.safetensors", folder / "work", PENDULUM, None)
    return folder / "model.safetensors"


@pytest.fixture(scope="module")
def whole(pendulum, tmp_path_factory):
    return run(pendulum, tmp_path_factory.mktemp("whole"))


def test_a_file_holds_the_flow_and_its_base_model(pendulum, whole, tmp_path):
    stored, base = load(whole), models.load(pendulum / "both.safetensors")
    assert stored.card.base == base.card
    assert stored.card.kind == "flow" and stored.seeds == [0, 1] and stored.failed == []
    kept = stored.model.base.state_dict()
    assert all(torch.equal(value, kept[name]) for name, value in base.model.state_dict().items()), "it is frozen"
    models.save(tmp_path / "again.safetensors", stored.model, stored.card)
    again = load(tmp_path / "again.safetensors")
    y = windows(Trajectories.load(pendulum / "test.npz"), 11, 2)
    for one, other in zip(stored.model.sample(seen(y), 4), again.model.sample(seen(y), 4), strict=True):
        assert torch.equal(one, other)
    assert models.load(whole).kind is load(whole).kind, "known since it was imported"
    assert isinstance(load(pendulum / "both.safetensors"), StoredModel), "other kinds as ever"


def test_estimates_lie_in_the_widened_prior_and_speeds_are_what_was_observed(pendulum, whole):
    model, data = load(whole).model, Trajectories.load(pendulum / "test.npz")
    y = windows(data, 11, 2)
    z_e, z_a, y0 = model.sample(seen(y), 64, seed=0)
    assert z_e.shape == (64, 2, 40, 1) and z_a.shape == (64, 2, 40, 3) and y0.shape == (64, 2, 40, 2)
    assert z_e.min() > 0.43 and z_e.max() < 3.57
    assert not torch.equal(y0[0], y0[1]), "a noisy first point is inferred"
    found = model.estimate(seen(y))
    assert torch.equal(found.part(slice(3, 5)).draws[0], found.draws[0][:, 3:5])


def test_a_killed_training_resumes_to_the_same_bits(pendulum, whole, tmp_path, killed):
    taken = killed(run, pendulum, tmp_path)
    assert (tmp_path / "work/checkpoint.pt").exists()
    resumed = load(run(pendulum, tmp_path)).model.state_dict()
    assert len(taken) == 4, "only the last pass is left"
    assert all(torch.equal(value, resumed[name]) for name, value in load(whole).model.state_dict().items())


@pytest.mark.slow
def test_of_fields_the_moments_are_seen_and_no_first_point_is_inferred(tmp_path):
    """Noisy fields, whose draws are used several times; the expert's parameter is found in their moments."""
    system = Fisher()
    ranges = SimulatedSet(size=40, z_e={"D": (1e-3, 4e-3)}, z_a={"r": (0.5, 1.5)})
    data = sample(system, SimulatedData(seed=0, step_s=0.1, t2_s=1.0, noise=1e-3, sets={"train": ranges}), "train")
    recipe = HybridModel(system, {"kind": "moments", "layers": [8]}, {"kind": "polynomial", "latent_degree": 1})
    how = TrainSettings(epochs=1, batch_size=10)
    options = TrainOptions(**COMMON, method="a", label="A", t1_s=0.5, training=how)
    base = prepare_training(recipe, data, data, options, describe(recipe)).run()
    plus = asked({"D": (1e-3, 6e-3)}, 1e-3, steps=150, batch_size=100, pool=800, uses=4, layers=(32,))
    training = prepare(base, data, plus)
    held, done = training.trainer.held, training.run()
    y = windows(data, 6, 1)
    z_e, _, y0 = done.model.eval().sample(seen(y), 32)
    assert torch.equal(y0, y[0].expand_as(y0)), "a field's first point is what was observed"
    with torch.no_grad():
        theta = done.model.head.density.sample(held.x, torch.zeros(1, *held.theta.shape))[0]
    assert (theta - held.theta)[..., 0].std() < 0.5 * held.theta[..., 0].std(), "windows tell the diffusion"
    models.save(tmp_path / "flow.safetensors", done.model, done.card)
    again = load(tmp_path / "flow.safetensors", classes=["field_systems:Fisher"]).model
    assert torch.equal(again.sample(seen(y), 32)[0], z_e)
    with pytest.raises(InputError, match="needs field_systems:Fisher"):
        load(tmp_path / "flow.safetensors")


def test_speeds_that_nobody_measured_are_neither_seen_nor_inferred_twice():
    constants = {"B1": 0.3, "G1": 90.0, "B2": 1.0, "G2": 120.0}
    system = DoublePendulum(constants=constants)
    low, high = torch.tensor([-25.0, -60.0]), torch.tensor([25.0, 60.0])
    unknowns = PriorTransform(system, low, high, torch.zeros(4, 3), 0, 1e-3)
    assert unknowns.transform.sizes == (2, 0, 2), "both speeds as z_e, both angles as y0"
    context = SummaryNetwork(system, torch.linspace(0, 0.1, 11), {})
    y = torch.randn(11, 5, 4)
    other = y.clone()
    other[..., 2:] += 1.0
    assert torch.equal(context(y), context(other)) and context(y).shape == (5, 44)

"""Least squares on each window: the fit of a pendulum and of a circuit, refinement, its settings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from fitted_pendulum import NOISE, PRIOR, T, expert_alone, pendulum, windows

import expertaug as ea
from expertaug import systems
from expertaug.api.arguments import RefinementOptions
from expertaug.errors import InputError
from expertaug.inference.least_squares import estimator_of, refine_by
from expertaug.learning import train as train_stage
from expertaug.learning.settings import SolverOnly, UntrainedOptions
from expertaug.models import describe
from expertaug.models.card import RecipeRecord
from expertaug.models.fit_settings import Refinement, RefinementSettings
from expertaug.models.posterior import Estimates, unconstrain
from expertaug.presets import Choices
from expertaug.systems.pendulum import DampedPendulum
from expertaug.systems.rlc import RLC
from expertaug.systems.settings import SolverSettings
from expertaug.systems.simulate import trajectories
from expertaug.systems.solvers.solver import Solver
from seen import seen


@pytest.mark.parametrize("z_e", [(1.5, 3.1), (0.5, 1.5)])
def test_an_undamped_pendulum_is_fitted_to_its_noise(z_e):
    data = pendulum(z_e)
    found = estimator_of(expert_alone("pendulum", data), None, NOISE, PRIOR).estimate(seen(windows(data)))
    truth = torch.from_numpy(data.z_e).float()
    assert found.z_e.shape == (2, 40, 1) and torch.equal(found.z_e[0], found.z_e[1])
    assert ((found.z_e[0] - truth) / truth).abs().mean() < 0.01
    assert 0.85 < found.chi2[0].mean() < 1.15
    # Laplace's intervals hold: standardised errors have a variance near one.
    q = found.posterior.z_e
    parameters = DampedPendulum().expert_parameters
    score = (unconstrain(truth, parameters) - q.loc[0]) / q.log_std[0].exp()
    assert 0.5 < score.square().mean() < 2.0
    # A start that is estimated is nearer the truth than the noisy one.
    clean = trajectories(DampedPendulum(), {"omega0": z_e}, {"alpha": (0, 0)}, n=40, t=T)
    exact = torch.from_numpy(clean.y[:, 0]).float()
    assert (found.y0[0] - exact).square().mean() < 0.5 * (windows(data)[0, 0] - exact).square().mean()


def test_what_the_expert_lacks_shows_in_chi2():
    lacking = pendulum((1.5, 3.1), damping=(0.3, 0.6))
    found = estimator_of(expert_alone("pendulum", lacking), None, NOISE, PRIOR).estimate(seen(windows(lacking, 1)))
    assert found.chi2.median() > 50 and found.chi2.min() > 1.3


def test_a_circuit_without_noise_is_found_exactly_from_many_starts():
    data = trajectories(RLC(), {"L": (3.0, 5.0), "C": (1.0, 2.5)}, {"R": (0.0, 0.0)}, n=20, t=T, seed=1)
    estimator = estimator_of(expert_alone("rlc", data), None, 0.0, {"L": (1.0, 5.0), "C": (0.5, 2.5)})
    found = estimator.estimate(seen(windows(data)))
    torch.testing.assert_close(found.z_e[0], torch.from_numpy(data.z_e).float(), rtol=1e-3, atol=1e-3)
    assert torch.equal(found.y0, windows(data)[0])  # known where nothing is noisy


@pytest.mark.parametrize("name", ["pendulum", "reaction_diffusion"])
def test_the_true_equation_is_a_floor(name):
    system = systems.load({"name": name})
    t, ranges = T[:31], {"omega0": (1.5, 3.1)}
    z_a, fit, training, noise = {"alpha": (0.1, 0.6)}, RefinementSettings(), SolverOnly(), NOISE
    if name == "reaction_diffusion":
        t, ranges = np.linspace(0, 1, 11), {"a": (0.001, 0.002), "b": (0.003, 0.007)}
        z_a, fit, noise = {"k": (0.003, 0.005)}, RefinementSettings(starts=8), 0.0
        training = SolverOnly(solver=SolverSettings(method="lawson4"))
    data = trajectories(system, ranges, z_a, n=6, t=t, noise=noise)
    settings = UntrainedOptions(
        experiment="e",
        method="truth",
        label="t",
        preset="corrected",
        choices=Choices(observed_points="inclusive"),
        seeds=[0, 1],
        t1_s=float(t[-1]),
        training=training,
        refinement=Refinement(settings=fit, noise=noise, prior=ranges),
    )
    described = RecipeRecord(system={"name": name}, interaction=False)
    stored = train_stage.make_expert_alone(system, data, settings, described, truth=True)
    y = torch.from_numpy(data.y).movedim(1, 0).unsqueeze(1).float()
    found = refine_by(stored, stored.card.refinement).estimate(seen(y.expand(-1, 2, *y.shape[2:])))
    expected = torch.from_numpy(data.z_e).float()
    assert ((found.z_e[0] - expected) / expected).abs().mean() < (0.02 if noise else 1e-4)
    assert (found.z_a[0] - torch.from_numpy(data.z_a).float()).abs().mean() < 0.05 * data.z_a.mean()
    # Also where its own parameters lie far from the training's.
    beyond = {k: (10 * high, 20 * high) for k, (_, high) in z_a.items()} if name == "reaction_diffusion" else z_a
    far = trajectories(system, ranges, beyond, n=4, t=t, noise=noise)
    y = torch.from_numpy(far.y).movedim(1, 0).unsqueeze(1).float().expand(-1, 2, -1, *[-1] * (far.y.ndim - 2))
    found = refine_by(stored, stored.card.refinement).estimate(seen(y))
    assert (found.z_a[0] - torch.from_numpy(far.z_a).float()).abs().mean() < 0.05 * far.z_a.mean()
    with pytest.raises(InputError, match="only simulated data have a true equation"):
        train_stage.make_expert_alone(system, replace(data, z_a=None), settings, described, truth=True)


def test_refinement_starts_from_the_models_own_estimates(settings, data):
    from expertaug.trajectories import Trajectories

    train, validation = (Trajectories.load(data / f"{name}.npz") for name in ("train", "validation"))
    described = train_stage.describe_recipe(settings)
    recipe = describe.recipe_of(systems.load(described.system), described)
    run = train_stage.prepare(recipe, train, validation, settings, described)
    stored = run.run()
    latent = stored.card.latent
    assert np.shape(latent.mean) == np.shape(latent.std) == (2, 8)
    y = torch.from_numpy(train.y).float().movedim(1, 0)[: stored.card.observed].unsqueeze(1)
    y = y.expand(-1, 2, *y.shape[2:])
    mean = stored.model.encode(seen(y)).z_a.mean.double().mean(1)
    torch.testing.assert_close(torch.tensor(latent.mean, dtype=torch.float64), mean, rtol=1e-5, atol=1e-6)

    y = y[:, :, :12]
    own = stored.model.estimate(seen(y))
    alone = estimator_of(stored, RefinementSettings(starts=0, steps=8), 0.01, None)  # no start but the model's own
    t = torch.tensor(stored.card.t)
    observed = stored.card.observed

    def misfit(found):
        states = stored.model.forecast(found.y0, found.z_e, found.z_a, t[:observed], Solver("rk4"))
        return (states - y).square().mean((0, 3))

    refined = alone.estimate(seen(y))
    assert (misfit(refined) <= misfit(own) + 1e-6).all() and misfit(refined).mean() < 0.5 * misfit(own).mean()
    many = RefinementSettings(starts=64, tries=2, steps=8)
    more = estimator_of(stored, many, 0.01, {"omega0": (0.5, 3.5)}).estimate(seen(y))
    assert (more.chi2 <= refined.chi2 * 1.001 + 1e-6).double().mean() > 0.95
    # The same again, and the model is as it was.
    again = alone.estimate(seen(y))
    assert torch.equal(again.z_e, refined.z_e) and torch.equal(stored.model.estimate(seen(y)).z_e, own.z_e)
    part = alone.estimate(seen(y[:, :, :7]))
    torch.testing.assert_close(part.z_e, refined.z_e[:, :7], rtol=1e-3, atol=1e-4)


@pytest.mark.slow
def test_further_starts_are_tried_only_where_the_first_does_not_explain_a_window(monkeypatch):
    data = pendulum((1.5, 3.1), n=12)
    seen = windows(data)
    fit = estimator_of(expert_alone("pendulum", data), None, NOISE, PRIOR).fit
    y0, truth = seen[0], torch.from_numpy(data.z_e).float().expand(2, -1, -1)
    near = Estimates(y0, truth.clone(), y0[..., :0])
    far = Estimates(y0, torch.full_like(truth, 0.3), y0[..., :0])
    mixed = Estimates(y0, torch.where(torch.arange(12)[:, None] < 6, truth, 0.3), y0[..., :0])
    tried = []
    asked = fit.best_of_grid
    monkeypatch.setattr(fit, "best_of_grid", lambda part: tried.append(part.shape[2]) or asked(part))
    assert fit(seen, far).chi2.max() < 1.6 and fit(seen, mixed).chi2.max() < 1.6 and fit(seen, near).chi2.max() < 1.6
    assert tried[0] > 6 and tried[1] <= 6 and len(tried) == 2  # nothing was wanting from the truth on
    # What one seed of the stack wants does not change the others.
    one_far = Estimates(y0, torch.stack((truth[0], far.z_e[1])), y0[..., :0])
    both = fit(seen, one_far)
    assert torch.equal(both.z_e[0], fit(seen, near).z_e[0]) and torch.equal(both.z_e[1], fit(seen, far).z_e[1])
    fit.settings = fit.settings.model_copy(update={"sufficient": 0.0})
    tried.clear()
    everywhere = fit(seen, near)
    assert tried == [12]
    torch.testing.assert_close(everywhere.z_e, truth, rtol=0.02, atol=0.0)


@pytest.mark.slow
def test_no_further_start_is_tried_once_two_have_led_to_the_same_minimum(monkeypatch):
    data = pendulum((1.5, 3.1), n=12)
    damped = replace(data, y=data.y * np.exp(-0.1 * data.t)[None, :, None].astype(np.float32))
    seen = windows(damped)
    many = RefinementSettings(starts=64, tries=8)
    fit = estimator_of(expert_alone("pendulum", data), many, NOISE, PRIOR).fit
    asked, tried = fit._minimum, []
    monkeypatch.setattr(fit, "_minimum", lambda x, *rest: tried.append(x.shape[1]) or asked(x, *rest))
    found = fit(seen)
    assert found.chi2.min() > 2 and tried[:2] == [12, 12]  # nothing explains these windows, so each is tried again,
    assert sum(tried) < 12 * 4  # and not eight times
    fit.settings = fit.settings.model_copy(update={"agreement": 0.0})
    tried.clear()
    everything = fit(seen)
    assert tried == [12] * 8
    torch.testing.assert_close(found.chi2, everything.chi2, rtol=0.02, atol=0.0)


def test_every_setting_is_an_option_in_python():
    noise = {"noise"}  # an argument of its own
    assert set(RefinementOptions.__annotations__) | noise == set(RefinementSettings.model_fields)


def test_points_outside_a_components_window_do_not_count():
    data = pendulum((1.5, 3.1), n=8)
    stored = expert_alone("pendulum", data)
    only_angle = RefinementSettings(windows={"omega": (0.0, 0.0)})
    spoiled = replace(data, y=data.y.copy())
    spoiled.y[:, 1:, 1] += 7.0
    one, other = (
        estimator_of(stored, only_angle, NOISE, PRIOR).estimate(seen(windows(each, 1))).z_e for each in (data, spoiled)
    )
    assert torch.equal(one, other)


def test_what_cannot_be_fitted_is_one_line():
    data = pendulum((1.5, 3.1), n=2)
    stored = expert_alone("pendulum", data)
    with pytest.raises(InputError, match="least squares needs a range of starts"):
        estimator_of(stored, None, NOISE, None).estimate(seen(windows(data)))
    with pytest.raises(InputError, match="names speed"):
        estimator_of(stored, {"windows": {"speed": [0, 1]}}, NOISE, PRIOR)
    with pytest.raises(InputError, match="give a range for each of"):
        estimator_of(stored, None, NOISE, {"L": (1, 2)})
    old = replace(stored, card=stored.card.but(kind="hybrid"))
    with pytest.raises(InputError, match="does not say where its z_a lie; train it again"):
        estimator_of(old, None, NOISE, PRIOR)
    with pytest.raises(InputError, match="only models with an expert"):
        estimator_of(replace(stored, card=stored.card.but(kind="mean")), None, NOISE, PRIOR)


def test_intervals_tell_what_the_expert_lacks():
    """A pendulum without friction in the expert: the residuals are larger than the noise, and correlated."""
    friction, t = {"alpha": (0.05, 0.2)}, np.arange(31) * 0.1
    train, new = (
        ea.simulate(ea.DampedPendulum(), {"omega0": (1.5, 3.0)}, friction, n=60, t=t, noise=0.01, seed=k)
        for k in (0, 1)
    )
    options = {"observed_s": 2.0, "prior": {"omega0": (1.0, 3.5)}, "noise": 0.01}
    model = ea.least_squares(ea.DampedPendulum(), train, **options)
    assert model.refinement.overdispersion[0] > 3
    plain = replace(model, refinement=model.refinement.model_copy(update={"overdispersion": None}))
    assert plain.watched(train).refinement.overdispersion == model.refinement.overdispersion
    held = {}
    for name, one in {"told": model, "plain": plain}.items():
        found = one.forecast(new.y[:, : model.observed], t)
        errors = np.abs(found.z_e["omega0"] - new.z_e[:, 0])
        held[name] = (errors < 1.645 * found.z_e_std["omega0"]).mean()
    assert held["told"] > held["plain"] + 0.2 and held["told"] > 0.6
    knowing = ea.DampedPendulum(friction="estimated")
    known = replace(train, z_e=np.column_stack((train.z_e, train.z_a)))
    ranges = options["prior"] | {"alpha": (0.001, 0.5)}
    assert ea.least_squares(knowing, known, **(options | {"prior": ranges})).refinement.overdispersion[0] < 1.2

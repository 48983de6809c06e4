"""Events of each sample of a batch: crossings, jumps, rest, and gradients through them."""

from functools import partial

import numpy as np
import pytest
import torch
from own_systems import Block

import expertaug as ea
from expertaug.errors import InputError
from expertaug.systems.bouncing_ball import BouncingBall
from expertaug.systems.check_system import check_system
from expertaug.systems.inputs import solve

GRAVITY, DRAG = {"g": (8.0, 12.0), "e": (0.6, 0.9)}, {"k": (0.0, 0.3)}
T = np.arange(31) * 0.05


def simulated(system, y0, z_e, t, substeps=1):
    field = lambda s, y, side: system.expert(s, y, z_e, side)  # noqa: E731
    return solve(system, field, y0, t, ea.Solver("rk4", substeps=substeps), z_e)


def heights(t, h0, g, e, bounces=40):
    """Of a ball dropped from rest at h0, in closed form."""
    start, speed = np.sqrt(2 * h0 / g), e * np.sqrt(2 * h0 * g)
    h = np.where(t < start, h0 - g * t**2 / 2, 0.0)
    for _ in range(bounces):
        end = start + 2 * speed / g
        here = (t >= start) & (t < end)
        h = np.where(here, speed * (t - start) - g * (t - start) ** 2 / 2, h)
        start, speed = end, e * speed
    return h


def test_each_ball_bounces_at_its_own_times():
    t = np.arange(0, 1.6, 0.05)
    z_e = torch.tensor([[9.81, 0.8], [12.0, 0.7], [5.0, 0.9]], dtype=torch.float64)
    h0 = [1.0, 0.5, 2.0]
    y0 = torch.tensor([[h, 0.0] for h in h0], dtype=torch.float64)
    y = simulated(BouncingBall(rest_m_s=0.0), y0, z_e, torch.from_numpy(t))
    for k, (g, e) in enumerate(z_e.tolist()):
        assert np.abs(y[:, k, 0].numpy() - heights(t, h0[k], g, e)).max() < 1e-9


def test_a_ball_comes_to_rest_after_ever_smaller_bounces_and_stays():
    z_e = torch.tensor([[9.81, 0.5]], dtype=torch.float64)
    y = simulated(BouncingBall(), torch.tensor([[1.0, 0.0]], dtype=torch.float64), z_e, torch.arange(0, 6, 0.1))
    assert torch.equal(y[-20:], torch.zeros(20, 1, 2, dtype=torch.float64))
    assert (y[..., 0] >= 0).all()


def test_friction_stops_a_block_at_its_turning_points_and_holds_it():
    """Between stops x swings about ±mu/k, so each turning point is 2 mu/k nearer: 1 → −.6 → .2, within mu/k, stays."""
    k, mu = 4.0, 0.8
    z_e = torch.tensor([[k, mu]], dtype=torch.float64)
    t = torch.arange(0, 5.01, 0.05, dtype=torch.float64)
    y = simulated(Block(), torch.tensor([[1.0, 0.0]], dtype=torch.float64), z_e, t, substeps=2)
    half = np.pi / 2  # of a swing with ω = 2
    first = t < half
    assert torch.allclose(y[first, 0, 0], 0.2 + 0.8 * torch.cos(2 * t[first]), atol=1e-6)
    assert abs(float(y[:, 0, 0].min()) + 0.6) < 1e-3
    assert torch.allclose(y[t > 2 * half + 0.1, 0], torch.tensor([0.2, 0.0], dtype=torch.float64), atol=1e-6)


@pytest.mark.parametrize("name", ["g", "e", "h0"])
def test_gradients_are_those_of_the_crossing_too(name):
    t = torch.arange(0, 1.5, 0.05, dtype=torch.float64)

    def last(g, e, h0):
        z_e = torch.stack((g, e)).unsqueeze(0)
        y0 = torch.stack((h0, torch.zeros_like(h0))).unsqueeze(0)
        return simulated(BouncingBall(), y0, z_e, t)[-1].sum()

    values = {k: torch.tensor(v, dtype=torch.float64) for k, v in {"g": 9.81, "e": 0.8, "h0": 1.0}.items()}
    values[name].requires_grad_()
    (found,) = torch.autograd.grad(last(**values), values[name])
    with torch.no_grad():
        up, down = (last(**(values | {name: values[name] + d})) for d in (1e-5, -1e-5))
    assert float(found) == pytest.approx(float((up - down) / 2e-5), rel=1e-5)


def test_the_contract_holds_and_says_what_does_not():
    check_system(BouncingBall(), z_e=GRAVITY, z_a=DRAG)
    check_system(Block())

    class Stepped(Block):
        simulation = ea.Solver("dopri5")

    class OneTime(Block):
        def expert(self, t, y, z_e, side):
            return super().expert(t, y, z_e, side) * (1 + t * y[..., :1])

    for system, expected in ((Stepped(), "its simulation is by dopri5"), (OneTime(), "OneTime.expert")):
        with pytest.raises(InputError, match=expected):
            check_system(system)


def test_a_solver_that_steps_over_events_and_a_model_without_an_expert_are_refused():
    y, z_e = torch.ones(1, 2), torch.tensor([[9.81, 0.8]])
    with pytest.raises(InputError, match="dopri5 steps over events; give rk4"):
        solve(BouncingBall(), lambda s, y, side: y, y, torch.tensor([0.0, 1.0]), ea.Solver("dopri5"), z_e)
    with pytest.raises(InputError, match="has events, which are the expert's"):
        ea.HybridModel(BouncingBall(), {"kind": "recurrent"}, expert=False).build(torch.arange(3), [0])


@pytest.fixture(scope="module")
def balls():
    return {
        name: ea.simulate(BouncingBall(), GRAVITY, DRAG, n=n, t=T, name=name)
        for name, n in {"train": 40, "validation": 10, "test": 10}.items()
    }


@pytest.mark.slow
def test_least_squares_finds_gravity_and_bounce():
    sets = [ea.simulate(BouncingBall(), GRAVITY, {"k": (0, 0)}, n=6, t=T, name=name) for name in ("train", "test")]
    model = ea.least_squares(BouncingBall(), sets[0], observed_s=1.0, prior=GRAVITY, solver={"substeps": 4})
    found = model.forecast(sets[1].y[:, :21], T)
    for k, name in enumerate(("g", "e")):
        assert np.abs(found.z_e[name] / sets[1].z_e[:, k] - 1).max() < 1e-3
    assert np.abs(found.y[..., 0] - sets[1].y[..., 0]).max() < 0.01


def parts(system):
    encoder = {"kind": "window", "windows": {system.state[0].name: [0, 1]}, "layers": [8], "latent": 1}
    return ea.HybridModel(system, encoder, {"kind": "mlp", "layers": [8], "components": ["v"]})


OPTIONS = {"epochs": 6, "batch_size": 20, "learning_rate": 1e-2, "objective": partial(ea.Aphynity, lambda0=100.0)}


@pytest.mark.slow
def test_aphynity_learns_from_heights_across_bounces(balls):
    recipe = parts(BouncingBall(observed="height"))
    model = ea.fit(recipe, balls["train"], balls["validation"], observed_s=1.0, **OPTIONS)
    loss = model.history[model.history["metric"] == "data"]["value"].to_numpy()
    assert np.isfinite(loss).all() and loss[-1] < 0.5 * loss[0]
    assert model.solver.method == "rk4" and model.solver.substeps == 10
    assert np.isfinite(model.evaluate(balls["test"])["value"]).all()
    prior = {"g": (8, 14), "e": (0.5, 0.9)}
    plus = ea.finetune(model, balls["train"], balls["validation"], prior=prior, epochs=1)
    assert np.isfinite(plus.evaluate(balls["test"])["value"]).all()


def test_aphynity_learns_a_drag_beside_friction():
    ranges = {"k": (2.0, 4.0), "mu": (0.2, 0.6)}, {"c": (0.0, 0.3)}
    train, validation = (ea.simulate(Block(), *ranges, n=n, t=T, name=str(n)) for n in (40, 10))
    model = ea.fit(parts(Block()), train, validation, observed_s=1.0, **OPTIONS)
    loss = model.history[model.history["metric"] == "data"]["value"].to_numpy()
    assert np.isfinite(loss).all() and loss[-1] < 0.7 * loss[0]


@pytest.mark.slow
def test_alternation_across_friction():
    ranges = {"k": (2.0, 4.0), "mu": (0.2, 0.6)}, {"c": (0.0, 0.3)}
    train, validation = (ea.simulate(Block(), *ranges, n=n, t=T, name=str(n)) for n in (10, 4))
    model = ea.alternate(
        Block(), {"kind": "damping", "components": ["v"]}, train, validation, observed_s=1.0, prior=ranges[0],
        steps=2, batch_size=5, validate_every=2, refinement={"starts": 2, "tries": 1},
    )  # fmt: skip
    assert np.isfinite(model.forecast(validation.y[:, :21], T).y).all()


def test_what_cannot_be_trained_by_gradients_is_refused_before():
    data = ea.simulate(BouncingBall(), GRAVITY, DRAG, n=4, t=T[:3])
    with pytest.raises(InputError, match="what BouncingBall observes jumps at its events"):
        ea.fit(parts(BouncingBall()), data, data, observed_s=0.05, **OPTIONS)

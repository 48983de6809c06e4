"""On a card every tensor lies on it, and a step waits for it once, at its end; here it is a pretended one."""

from collections import Counter
from functools import cache

import numpy as np
import pytest
import torch

import expertaug as ea
from expertaug.learning.trainer import Trainer
from expertaug.learning.training_data import StackedSet
from expertaug.models.decoder import Decoder
from nightly import others_slow
from pretended_card import DEVICE, Card, OnCard, WrongDevice

T, END = np.arange(4) * 0.1, 0.2
OPTIONS = {"epochs": 1, "batch_size": 2, "learning_rate": 1e-4}
TWO_STEP = {"kind": "two_step", "latent_layers": [8], "filter_layers": [8], "expert_layers": [8]}
FIELDS_TWO_STEP = {"kind": "conv_two_step", "latent": 1}
FLOW = {"steps": 4, "batch_size": 2, "pool": 8, "held_out": 8, "layers": [8], "summary": 4, "transforms": 1}
FLOW |= {"hidden": [4], "latent": 1, "samples": 4}
MLP, RECURRENT = {"kind": "mlp", "layers": [4]}, {"kind": "recurrent", "hidden": 4, "layers": [4]}
DRIVEN = MLP | {"inputs": True, "time": True}
# Did no forecast run away, and is each gradient finite: before the update, after all that it is made of.
ASKED = {"learning/optimiser.py"}
# Where a forecast ran away the step is done again, and asks which.
ASKED_AGAIN = {"learning/objectives.py", "learning/residuals.py"}


def window(*names):
    return {"kind": "window", "windows": {name: [0.0, END] for name in names}, "layers": [4], "latent": 1}


def simulated(system, z_e, z_a, **more):
    both = ea.simulate(system, z_e, z_a, n=6, t=T, noise=0.01, **more)
    return [both.subset(slice(4)), both.subset(slice(4, 6))]


def double_pendulums():
    """Of the expert alone: its simulation needs a calibration."""
    system, t = ea.DoublePendulum(expert="point_mass"), np.arange(6) * 0.01
    generator = torch.Generator().manual_seed(0)
    y0, z_e = (torch.rand(6, n, generator=generator) - 0.5 for n in (4, 2))
    y = ea.Solver("rk4")(lambda s, y: system.expert(s, y, z_e), system.initial_state(y0, z_e), torch.from_numpy(t))
    data = ea.Trajectories(t, y.movedim(0, 1).numpy().astype(np.float32), z_e.numpy())
    return system, [data, data.subset(range(2))]


@cache
def case(name):
    """System, sets (which tests do not change), encoder, F_a, solver and end of the window."""
    rk4 = ea.Solver("rk4")
    if name == "double_pendulum":
        encoder = window("theta1", "theta2") | {"angles": ["theta1", "theta2"]}
        encoder["windows"] = {"theta1": [0.0, 0.02], "theta2": [0.01, 0.02]}
        return *double_pendulums(), encoder, MLP, rk4, 0.02
    system, z_e, z_a, more, encoder, interaction, solver = {
        "pendulum": (ea.DampedPendulum(), {"omega0": (1.5, 3.1)}, {"alpha": (0, 0.6)}, {}, RECURRENT, MLP, rk4),
        "rlc": (ea.RLC(), {"L": (1, 3), "C": (0.5, 1.5)}, {"R": (1, 3)}, {}, window("U", "I"),
                MLP | {"components": ["I"]}, rk4),
        "stiff": (ea.DampedPendulum(), {"omega0": (1.5, 3.1)}, {"alpha": (0, 0.6)}, {}, RECURRENT,
                  {"kind": "polynomial", "degree": 2, "latent_degree": 1}, ea.Solver("rodas3")),
        "driven": (ea.DrivenPendulum(), {"omega0": (0.8, 3.1)}, {"gamma": (0, 0.8)},
                   {"inputs": {"A": (0, 4), "f": (3, 6)}}, RECURRENT, DRIVEN, rk4),
        "fields": (ea.ReactionDiffusion(), {"a": (1e-3, 2e-3), "b": (3e-3, 7e-3)}, {"k": (3e-3, 5e-3)}, {},
                   {"kind": "moments", "layers": [4], "latent": 1},
                   {"kind": "conv", "channels": [2], "kernels": [3, 1]}, ea.Solver("lawson4")),
    }[name]  # fmt: skip
    return system, simulated(system, z_e, z_a, **more), encoder, interaction, solver, END


@pytest.fixture
def card():
    with Card() as card:
        yield card


@pytest.fixture
def waits(card, monkeypatch):
    """Waits for the card in the steps taken: a count by place for each."""
    step, found = Trainer.step, []

    def counted(self, *arguments):
        before = Counter(card.waits)
        told = step(self, *arguments)
        found.append(card.waits - before)
        return told

    monkeypatch.setattr(Trainer, "step", counted)
    return found


def on_card(model):
    return all(isinstance(value, OnCard) for value in model.stored.model.state_dict().values())


def fitted(name, objective="aphynity", device=str(DEVICE)):
    system, sets, encoder, interaction, solver, end = case(name)
    ranges = {p.name: (0.5 * p.scale, 1.5 * p.scale) for p in system.expert_parameters}
    if objective == "hvae":
        encoder = FIELDS_TWO_STEP if name == "fields" else TWO_STEP
    recipe = ea.HybridModel(system, encoder=encoder, interaction=interaction)
    loss = ea.HybridVAE if objective == "hvae" else ea.Aphynity
    options = OPTIONS | {"observed_s": end, "objective": loss, "solver": solver, "seeds": [0, 1], "prior": ranges}
    return ea.fit(recipe, *sets, device=device, **options), sets, ranges


def asked(waits):
    """Places of the waits of a step, each asked once: of all but the first, with which an objective begins, and those
    that were done again since a forecast ran away."""
    again = [one for one in waits[1:] if max(one.values()) > 1]
    for one in again:
        assert {place.partition(":")[0] for place in one} <= {*ASKED, *ASKED_AGAIN} and max(one.values()) == 2, one
    once = [one for one in waits[1:] if one not in again]
    return {place.partition(":")[0] for one in once for place in one}


@pytest.mark.parametrize("objective", ["aphynity", "hvae"])
@pytest.mark.parametrize("name", others_slow(["pendulum", "rlc", "double_pendulum", "fields", "driven", "stiff"]))
def test_training_and_finetuning(waits, name, objective):
    model, sets, ranges = fitted(name, objective)
    expected = [ASKED, set()] if name == "double_pendulum" else [ASKED]  # untrained it runs away in every step
    assert asked(waits) in expected
    waits.clear()
    plus = ea.finetune(model, *sets, prior=ranges, noise=0.01, choices={"resample": "epoch"}, **OPTIONS)
    assert asked(waits) in expected
    assert on_card(model) and on_card(plus)


@pytest.mark.slow
@pytest.mark.parametrize("objective", others_slow(["hvae", "aphynity"]))
@pytest.mark.parametrize("name", others_slow(["pendulum", "rlc", "double_pendulum"]))
def test_the_values_are_those_of_the_cpu(card, name, objective):
    """What is pretended is where tensors lie, no more."""
    found = fitted(name, objective)[0].history["value"]
    assert found.equals(fitted(name, objective, device="cpu")[0].history["value"])


@pytest.mark.slow
@pytest.mark.parametrize("objective", others_slow(["aphynity", "hvae"]))
def test_a_step_is_done_again_where_a_forecast_ran_away(waits, objective, monkeypatch):
    monkeypatch.setattr("expertaug.learning.divergence.FACTOR", 0.9)
    found = fitted("pendulum", objective)[0].history["value"]
    assert any(max(one.values()) > 1 for one in waits[1:])
    assert found.equals(fitted("pendulum", objective, device="cpu")[0].history["value"])


@pytest.mark.slow
def test_what_follows_a_training(waits):
    """Evaluation and refinement, whose fits are the CPU's wherever the model lies."""
    model, sets, ranges = fitted("pendulum")
    refined = model.refined(noise=0.01, prior=ranges, starts=4, steps=2)
    for one in (model, refined):
        assert one.forecast(sets[1].y[:, :3], sets[1].t).y.shape == (2, 2, len(T), 2)
        assert one.evaluate(sets[1])["metric"].nunique() > 2


@pytest.mark.slow
def test_a_flow(waits):
    model, sets, ranges = fitted("pendulum")
    waits.clear()
    flow = ea.fit_posterior(model, *sets, prior=ranges, noise=0.01, **FLOW)
    assert on_card(flow)
    assert asked(waits) == {"learning/optimiser.py"}
    found = ea.predictive(flow, sets[1].y[:, :3], sets[1].t, draws=4).mean
    assert found.shape == (2, len(T), 2)
    there = ea.fit_posterior(fitted("pendulum", device="cpu")[0], *sets, prior=ranges, noise=0.01, **FLOW)
    assert np.array_equal(found, ea.predictive(there, sets[1].y[:, :3], sets[1].t, draws=4).mean)


def test_gaps(waits):
    """Windows with gaps ask for them more than once, which those without do not."""
    system, sets = ea.DampedPendulum(), case("pendulum")[1]
    measured = np.ones((len(T), 2), dtype=bool)
    measured[::2, 1] = False
    gaps = [ea.Trajectories(d.t, d.y * measured, d.z_e, mask=np.broadcast_to(measured, d.y.shape)) for d in sets]
    recipe = ea.HybridModel(system, encoder=RECURRENT, interaction=MLP)
    options = OPTIONS | {"observed_s": END, "start": {"omega": (-2, 2)}, "seeds": [0, 1]}
    assert on_card(ea.fit(recipe, *gaps, device=str(DEVICE), **options))


@pytest.mark.parametrize("method", ["rk4", "dopri5", "radau"])
def test_events_and_other_solvers(card, method):
    system = ea.DampedPendulum() if method != "rk4" else ea.BouncingBall()
    z_e = torch.tensor([[1.5, 0.8], [2.5, 0.7]])[:, : len(system.expert_parameters)]
    decoder, y0, t = Decoder(system), torch.tensor([[1.0, 0.0], [0.5, 0.1]]), torch.from_numpy(T).float()
    z_a, solver = torch.zeros(2, 0), ea.Solver(method)
    with torch.no_grad():
        here = decoder.forecast(y0, z_e, z_a, t, solver)
        there = decoder.forecast(*(x.to(DEVICE) for x in (y0, z_e, z_a)), t, solver)
    assert isinstance(there, OnCard) and torch.equal(there.cpu(), here)


@pytest.mark.parametrize(
    "line",
    [
        lambda batch: batch.y + torch.zeros(len(batch.y), 1, 1, 1),
        lambda batch: torch.cat((batch.z_e, torch.zeros(2, 4, 1)), dim=-1),
        lambda batch: torch.where(torch.ones(2, 4, 1, dtype=torch.bool), batch.z_e, 0.0),
    ],
)
def test_a_tensor_that_is_made_on_the_cpu_is_refused(card, line):
    data = StackedSet.of(case("pendulum")[1][0], DEVICE)
    with pytest.raises(WrongDevice, match="of the CPU beside those on the card"):
        line(next(data.batches([0, 1], 0, 4)))


@pytest.mark.parametrize(
    "line", [float, bool, torch.Tensor.item, torch.Tensor.tolist, torch.Tensor.cpu, torch.Tensor.nonzero]
)
def test_what_waits_is_counted(card, line):
    value = torch.ones((), device=DEVICE)
    before = card.waits.total()
    line(value)
    assert card.waits.total() == before + 1

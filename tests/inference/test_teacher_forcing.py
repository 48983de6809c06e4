"""First steps from each measured point to the next: they find a known F_a, whatever the times, and leave gaps out."""

import dataclasses

import numpy as np
import pytest
import torch

import tiny
from expertaug import systems
from expertaug.errors import InputError
from expertaug.inference import alternating, teacher_forcing
from expertaug.inference.settings import AlternateJob, AlternatingSettings, TeacherForcing
from expertaug.learning.settings import Build
from expertaug.learning.train import describe_recipe
from expertaug.models.fit_settings import Refinement, RefinementSettings
from expertaug.models.settings import PartsSettings
from expertaug.trajectories import Trajectories
from tiny import but, of_kind

SETS = {name: tiny.swings(size, alpha=(0.1, 0.6)) for name, size in (("train", 40), ("validation", 10))}
DATA = tiny.DATA.model_copy(update={"t2_s": 4.0, "sets": SETS})
SETTINGS = of_kind(
    AlternateJob,
    tiny.SETTINGS,
    method="alternating",
    label="Alternating",
    build=Build(kind="alternating"),
    model=PartsSettings(interaction={"kind": "mlp", "layers": [8], "activation": "silu", "components": ["omega"]}),
    training=AlternatingSettings(steps=1, batch_size=20, teacher_forcing=TeacherForcing(steps=120)),
    refinement=Refinement(settings=RefinementSettings(starts=16, tries=2), noise=0.01, prior=tiny.PRIOR),
    t1_s=2.0,
)


@pytest.fixture(scope="module")
def sets(tmp_path_factory):
    folder = tiny.simulated(tmp_path_factory.mktemp("pendulum"), DATA)
    return [Trajectories.load(folder / f"{name}.npz") for name in ("train", "validation")]


def prepared(sets, settings=SETTINGS, **more):
    described = describe_recipe(but(settings, **more))
    return alternating.prepare(systems.load(described.system), *sets, but(settings, **more), described).trainer


def test_the_first_steps_find_the_damping(sets):
    trainer = prepared(sets)
    trainer.begin()
    before = trainer.score()
    trainer.learn_next_points()
    assert (trainer.best_score < before - 1.0).all()
    assert (trainer.best_step == 0).all()  # what they found can be what is kept


def test_points_keep_windows_constants_from_what_the_expert_lacks(tmp_path):
    data = but(DATA, sets={name: tiny.swings(40, alpha=(0.3, 0.6)) for name in ("train", "validation")})
    folder = tiny.simulated(tmp_path, data)
    train, validation = (Trajectories.load(folder / f"{name}.npz") for name in ("train", "validation"))
    exact = TeacherForcing(steps=120, estimates="least_squares")
    trainer = prepared([train, validation], training=AlternatingSettings(steps=1, batch_size=20, teacher_forcing=exact))
    trainer.begin()

    def off() -> float:
        z_e = trainer.fit.parts(trainer.x, trainer.fit.first(trainer.train))[0]
        return float((z_e / torch.as_tensor(train.z_e) - 1.0).abs().max())

    assert off() > 0.5  # over a window without the friction, one of them is far off
    trainer.x = teacher_forcing.expert_from_points(trainer.first_fit, trainer.train, trainer.x, 5)
    assert off() < 0.15
    trainer.learn_next_points()
    assert off() < 0.1


@pytest.mark.parametrize("points", [1, 7, 19, 20, None])
def test_a_step_begins_at_as_many_points_as_asked(points):
    chosen = [teacher_forcing._some_of(20, points, step).tolist() for step in range(300)]
    assert all(found == sorted(set(found)) and len(found) == min(points or 20, 20) for found in chosen)
    assert set().union(*chosen) == set(range(20))


@pytest.mark.parametrize("estimates", ["gradient", "least_squares"])
def test_few_points_a_step_find_the_damping_too(sets, estimates):
    few = TeacherForcing(steps=120, points=6, estimates=estimates)
    trainer = prepared(sets, training=AlternatingSettings(steps=1, batch_size=20, teacher_forcing=few))
    trainer.begin()
    before = trainer.score()
    trainer.learn_next_points()
    assert (trainer.best_score < before - 1.0).all()


@pytest.mark.parametrize("estimates", ["gradient", "least_squares"])
def test_a_seed_learns_the_same_alone_and_in_a_group(sets, estimates):
    found = []
    settings = AlternatingSettings(
        steps=1, batch_size=20, teacher_forcing=TeacherForcing(steps=120, estimates=estimates)
    )
    for seeds in ([1], [0, 1]):
        trainer = prepared(sets, seeds=seeds, training=settings)
        trainer.begin()
        trainer.learn_next_points()
        found.append(trainer.best_score[-1].item())
    assert found[0] == pytest.approx(found[1], abs=1e-3)


def test_times_that_differ_are_gone_through_one_by_one(sets):
    trainer = prepared(sets)
    trainer.begin()
    fit, seeds = trainer.fit, len(trainer.seeds)
    batch = trainer.train[: len(fit.t), :, :5].expand(-1, seeds, -1, -1)
    z_e, z_a, _ = fit.parts(trainer.x[:, :5], fit.first(batch))
    starts, every = batch[:-1], torch.arange(len(batch) - 1)
    together = teacher_forcing._next_points(fit, starts, every, z_e, z_a, None)
    fit.t = fit.t + torch.linspace(0.0, 1e-3, len(fit.t), dtype=fit.t.dtype) ** 2
    apart = teacher_forcing._next_points(fit, starts, every, z_e, z_a, None)
    assert apart.shape == batch[1:].shape
    assert torch.allclose(apart, together, atol=1e-5) and not torch.equal(apart, together)


@pytest.mark.parametrize("estimates", ["gradient", "least_squares"])
def test_points_that_were_not_measured_are_left_out(sets, estimates):
    settings = TeacherForcing(steps=120, estimates=estimates)
    trainer = prepared(sets, training=AlternatingSettings(steps=1, batch_size=20, teacher_forcing=settings))
    trainer.begin()
    trainer.train[3, :, ::2, 1] = np.nan
    trainer.train[7, :, 1::3] = np.nan
    before = [value.clone() for value in trainer.parameters]
    trainer.learn_next_points()
    moved = [not torch.equal(a, b) for a, b in zip(before, trainer.parameters, strict=True)]
    assert all(moved) and all(torch.isfinite(value).all() for value in trainer.parameters)
    assert torch.isfinite(trainer.best_score).all()


@pytest.mark.parametrize("observed", ["angle", "all"])
def test_a_component_that_nobody_measured_is_named(sets, observed):
    system, windows = systems.load({"name": "pendulum", "observed": observed}), torch.zeros(5, 1, 3, 2)
    if observed == "all":  # as far as the system knows
        teacher_forcing.check_measured(system, windows)
        windows[..., 1] = np.nan
    with pytest.raises(InputError, match=r"teacher_forcing: forecasts begin .* nobody measured omega"):
        teacher_forcing.check_measured(system, windows)


def test_a_set_without_speeds_is_refused_before_anything_is_trained(sets):
    train, validation = sets
    alone = dataclasses.replace(train, mask=np.broadcast_to([True, False], train.y.shape))
    with pytest.raises(InputError, match="nobody measured omega"):
        prepared([alone, validation], start={"omega": (-3.0, 3.0)})

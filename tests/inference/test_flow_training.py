"""Trainings of flows: a seed is on its own, draws begin where they are to, and mistakes are told."""

from __future__ import annotations

import pytest
import torch
from flow_pendulum import PENDULUM, windows
from known_posterior import SMALL

from expertaug.errors import InputError
from expertaug.inference.flow_training import prepare
from expertaug.inference.settings import FlowJob, FlowSettings
from expertaug.inference.simulations import HELD_OUT
from expertaug.learning.random_streams import RandomStreams
from expertaug.models import store as models
from expertaug.systems.pendulum import DampedPendulum
from expertaug.trajectories import Trajectories
from seen import seen


def test_a_seed_does_not_depend_on_the_seeds_beside_it(pendulum):
    """The flow of a seed alone and in a group: the same draws of the simulator, to float rounding."""
    data = Trajectories.load(pendulum / "train.npz")
    both, alone = (prepare(models.load(pendulum / f"{n}.safetensors"), data, PENDULUM) for n in ("both", "alone"))
    # Trained apart, the two seed 1 differ by rounding; the same tensors make the draws comparable.
    a, b = (t.trainer.pool.simulator.draw(60, HELD_OUT, 7) for t in (both, alone))
    assert torch.allclose(a.x[1], b.x[0], atol=1e-3) and torch.allclose(a.theta[1], b.theta[0], atol=1e-2)
    assert not torch.allclose(a.x[0], a.x[1], atol=0.1), "another seed, other draws"
    trained = [t.run().model.eval() for t in (both, alone)]
    y = windows(data, 11, 2)
    z, other = trained[0].sample(seen(y), 16, seed=2)[0][:, 1], trained[1].sample(seen(y[:, 1:]), 16, seed=2)[0][:, 0]
    assert torch.allclose(z, other, atol=1e-2)


@pytest.mark.parametrize(
    ("row", "flow", "anew"), [("data", {}, 0), ("resampled", {}, 1), ("data", {"resample_x": True}, 1)]
)
def test_draws_begin_where_training_windows_do_or_anywhere(pendulum, monkeypatch, row, flow, anew):
    elsewhere = lambda self, y0, uniform: torch.cat((5.0 + uniform(1), y0[..., 1:]), dim=-1)  # noqa: E731
    monkeypatch.setattr(DampedPendulum, "resample_known", elsewhere)
    choices = PENDULUM.choices.model_copy(update={"augmented_x": row})
    of_row = PENDULUM.model_copy(update={"choices": choices, "flow": FlowSettings(**SMALL | flow)})
    made = prepare(models.load(pendulum / "both.safetensors"), Trajectories.load(pendulum / "train.npz"), of_row)
    first = made.trainer.pool.simulator.simulated(20, RandomStreams([0, 1], 7)).y0[..., 0]
    assert bool((first > 4.9).all()) == bool(anew) and (anew or bool((first < 4.9).all()))


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ({"prior": {"omega": [1.0, 2.0]}}, "augmentation.prior"),
        ({"flow": {"transforms": 0}}, "flow.transforms"),
        ({"flow": {"step": 3}}, "flow.step"),
        ({"flow": {"resample_x": True}}, "flow.resample_x: DampedPendulum does not say where"),
    ],
)
def test_what_is_wrong_is_said_in_a_line(pendulum, changed, expected):
    data = Trajectories.load(pendulum / "train.npz")
    with pytest.raises(InputError, match=expected):
        prepare(models.load(pendulum / "both.safetensors"), data, FlowJob.from_mapping(PENDULUM.dump() | changed))

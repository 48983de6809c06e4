"""A prior that finds its own width: it covers where the windows lie, and says where the expert does not fit."""

from __future__ import annotations

import pytest
import torch
from test_least_squares import NOISE, OBSERVED, expert_alone, pendulum

from expertaug.errors import InputError
from expertaug.inference.own_prior import own_prior

SEEN = {"omega0": (1.5, 3.1)}


def first_points(data):
    return torch.from_numpy(data.y).movedim(1, 0)[:OBSERVED]


@pytest.fixture(scope="module")
def train():
    return pendulum(SEEN["omega0"], n=60)


def test_it_grows_to_where_the_windows_are_and_no_further(train):
    far = pendulum((0.5, 1.5), n=60)
    found = own_prior(expert_alone("pendulum", train), first_points(train), first_points(far), NOISE, SEEN)
    low, high = found.ranges["omega0"]
    assert 0.3 < low < far.z_e.min() * 1.05 and 3.0 < high < 3.6
    assert 1.4 < found.training["omega0"][0] < found.training["omega0"][1] < 3.2
    assert found.explained > 0.9 and "explains" in found.says


def test_windows_of_the_training_leave_the_ranges_as_they_are(train):
    found = own_prior(expert_alone("pendulum", train), first_points(train), first_points(train), NOISE, SEEN)
    assert found.ranges == found.training and found.explained > 0.95


def test_it_says_when_the_expert_itself_does_not_fit(train):
    damped = pendulum((1.5, 3.1), damping=(0.4, 0.6), n=40)
    found = own_prior(expert_alone("pendulum", train), first_points(train), first_points(damped), NOISE, SEEN)
    assert found.explained < 0.5 and "does not fit" in found.says


def test_mistakes_are_one_line(train):
    stored, y = expert_alone("pendulum", train), first_points(train)
    with pytest.raises(InputError, match="give ranges"):
        own_prior(stored, y, y, NOISE)
    with pytest.raises(InputError, match="the training's are"):
        own_prior(stored, y, y[1:], NOISE, SEEN)

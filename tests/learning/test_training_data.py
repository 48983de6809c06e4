"""Batches of a training set."""

from __future__ import annotations

import torch

from expertaug.learning.training_data import StackedSet
from expertaug.trajectories import Trajectories


def test_orders_depend_on_seed_and_pass_alone(data):
    whole = StackedSet.of(Trajectories.load(data / "train.npz"), "cpu")
    batch = next(whole.batches([3, 4], 0, 8))
    again = next(whole.batches([4], 0, 8))
    later = next(whole.batches([4], 1, 8))
    assert torch.equal(batch.y[:, 1], again.y[:, 0])
    assert not torch.equal(again.y, later.y)
    every = torch.cat([b.z_e for b in whole.batches([3], 0, 8)], 1)
    assert torch.equal(every[0].sort(0)[0], whole.z_e[0].sort(0)[0])


def test_the_first_points_alone_are_those_of_the_whole(data):
    train = Trajectories.load(data / "train.npz")
    whole, first = StackedSet.of(train, "cpu"), StackedSet.of(train, "cpu", 5)
    assert len(first.y) == 5 < len(whole.y)
    assert torch.equal(first.y, whole.y[:5]) and torch.equal(first.z_e, whole.z_e)
    assert torch.equal(first.window(5).y, whole.window(5).y) and len(first.trajectories.t) == 5
    assert torch.equal(StackedSet.of(train, "cpu", 10**6).y, whole.y)

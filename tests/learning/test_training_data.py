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

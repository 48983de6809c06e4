"""Random streams of a group of seeds."""

from __future__ import annotations

import torch

from expertaug.learning.random_streams import RandomStreams


def test_every_seed_and_step_draws_its_own():
    first, other = RandomStreams([3, 4], 0, 2).normal(50, 2), RandomStreams([3, 4], 1, 2).normal(50, 2)
    assert not torch.equal(first[0], first[1]) and not torch.equal(first, other)
    assert torch.equal(first[1], RandomStreams([4], 0, 2).normal(50, 2)[0])

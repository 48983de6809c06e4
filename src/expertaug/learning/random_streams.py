"""Random streams of a group of seeds: what a seed draws does not depend on the seeds beside it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor


class RandomStreams:
    """One generator a seed, made from the seed and the integers ``key``.

    Arguments:
        seeds: S of them, in the group's order.
        key: what the numbers are for (a pass, a step, a stream's number): another key, other numbers.
        device: of the numbers.
    """

    def __init__(self, seeds: Sequence[int], *key: int, device: torch.device | str = "cpu") -> None:
        self.generators = [np.random.default_rng([seed, *key]) for seed in seeds]
        self.device = device

    def uniform(self, *shape: int) -> Tensor:
        """(S, *shape) numbers, uniform in [0, 1)."""
        return self._draw("random", shape)

    def normal(self, *shape: int) -> Tensor:
        """(S, *shape) standard normal numbers."""
        return self._draw("standard_normal", shape)

    def _draw(self, kind: str, shape: tuple[int, ...]) -> Tensor:
        each = [getattr(generator, kind)(shape, dtype=np.float32) for generator in self.generators]
        return torch.from_numpy(np.stack(each)).to(self.device, non_blocking=True)

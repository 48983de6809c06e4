"""Data of a training: sets as tensors, time first, batches in an order a seed, and what losses need to know."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Protocol

import numpy as np
import torch
from torch import Tensor

from expertaug.errors import InputError
from expertaug.learning.divergence import bound_of_card
from expertaug.models.card import ModelCard
from expertaug.presets import Choices
from expertaug.systems.settings import SolverSettings
from expertaug.systems.solvers.solver import Solver
from expertaug.trajectories import Trajectories, points_until
from expertaug.windows import Windows


class _Samples:
    """What sets and batches share: samples whose states and inputs are ``trajectories``."""

    trajectories: Windows

    @property
    def y(self) -> Tensor:
        """States (T, S, B, *state), NaN where nothing was measured."""
        return self.trajectories.y

    @property
    def u(self) -> Tensor | None:
        """Known inputs (T, S, B, U); None for a system without."""
        return self.trajectories.u

    def windows(self, points: int) -> Windows:
        """The first ``points`` points alone: what an encoder sees."""
        return self.trajectories.until(points)

    def inputs(self, points: int) -> Tensor | None:
        """Known inputs at the first ``points`` points."""
        return None if self.u is None else self.u[:points]


@dataclass(frozen=True)
class Batch(_Samples):
    """A batch for a group of S seeds.

    A step does not ask the tensors, for which it would wait where they lie on a card, what is known beforehand:
    ``complete``, that nothing is NaN, and ``labelled``, whether a sample is supervised; None where it is not known.

    Attributes:
        trajectories: of B samples, y (T, S, B, *state).
        z_e: (S, B, P).
        supervised: (S, B) in {0, 1}.
        z_a: (S, B, Q) of augmented samples, NaN of others; None where there are none.
    """

    trajectories: Windows
    z_e: Tensor
    supervised: Tensor
    complete: bool = False
    labelled: bool | None = None
    z_a: Tensor | None = None

    @property
    def has_labels(self) -> bool:
        """Whether a sample is supervised."""
        return bool(self.supervised.any()) if self.labelled is None else self.labelled


@dataclass(frozen=True)
class StackedSet(_Samples):
    """M samples for each of S seeds; S = 1 in the tensors where all seeds share them.

    Attributes:
        trajectories: y (T, S or 1, M, *state).
        z_e: (S or 1, M, P).
        supervised: (M,) in {0, 1}: whether z_e is the sample's label (augmented samples) or only for scoring.
        z_a: with which augmented samples were made, (S or 1, M, Q), NaN of others; None where there are none.
    """

    trajectories: Windows
    z_e: Tensor
    supervised: Tensor
    z_a: Tensor | None = None

    @classmethod
    def of(cls, data: Trajectories, device: torch.device, points: int | None = None) -> StackedSet:
        """A set that all seeds share, none of it supervised; of its first ``points`` points alone, where these are all
        that is asked for: the rest of a set of fields is not copied."""
        if points is not None and points < len(data.t):
            data = data.window(0, points)
        z_e = torch.from_numpy(data.z_e).unsqueeze(0).to(device)
        return cls(Windows.of(data, device), z_e, torch.zeros(len(data), device=device))

    def __len__(self) -> int:
        return len(self.supervised)

    @cached_property
    def complete(self) -> bool:
        """Whether everything was measured."""
        return not self.trajectories.has_gaps

    def __or__(self, other: StackedSet) -> StackedSet:
        """The union of two sets over the times that both have."""
        points = min(len(self.y), len(other.y))
        seeds = max(self.y.shape[1], other.y.shape[1])

        def both(a: Tensor, b: Tensor) -> Tensor:
            return torch.cat([x.expand(seeds, *x.shape[1:]) for x in (a, b)], dim=1)

        parts = [part.windows(points).expand(seeds) for part in (self, other)]
        return StackedSet(
            Windows.cat(parts),
            both(self.z_e, other.z_e),
            torch.cat((self.supervised, other.supervised)),
            None if self.z_a is None and other.z_a is None else both(self._z_a_like(other), other._z_a_like(self)),
        )

    def _z_a_like(self, other: StackedSet) -> Tensor:
        """This set's z_a (S or 1, M, Q); NaN where it has none and another has."""
        if self.z_a is not None:
            return self.z_a
        assert other.z_a is not None
        return other.z_a.new_full((1, len(self), other.z_a.shape[-1]), torch.nan)

    def window(self, points: int) -> StackedSet:
        """The first ``points`` points of every sample."""
        return replace(self, trajectories=self.windows(points).contiguous())

    def subset(self, count: int | None) -> StackedSet:
        """At most ``count`` samples, evenly spread."""
        if count is None or count >= len(self):
            return self
        index = torch.linspace(0, len(self) - 1, count, device=self.y.device).long()
        return self.at(index)

    def at(self, index: Tensor) -> StackedSet:
        """The samples at some places."""
        z_a = None if self.z_a is None else self.z_a[:, index]
        return StackedSet(self.trajectories.samples(index), self.z_e[:, index], self.supervised[index], z_a)

    def whole(self, seeds: int) -> Batch:
        """All samples as one batch for ``seeds`` seeds."""
        return Batch(
            self.trajectories.expand(seeds),
            self.z_e.expand(seeds, *self.z_e.shape[1:]),
            self.supervised.expand(seeds, -1),
            z_a=None if self.z_a is None else self.z_a.expand(seeds, -1, -1),
        )

    def batches(self, seeds: list[int], epoch: int, size: int) -> Iterator[Batch]:
        """One pass: full batches in an order that depends on the seed and the epoch alone (a rest is left out)."""
        order = np.stack([np.random.default_rng([seed, epoch]).permutation(len(self)) for seed in seeds])
        supervised = self.supervised.cpu().numpy()[order] > 0
        order = torch.from_numpy(order).to(self.y.device)
        size = min(size, len(self))
        row = torch.arange(len(seeds), device=self.y.device).unsqueeze(1)
        shared = torch.zeros_like(row) if self.y.shape[1] == 1 else row
        for start in range(0, len(self) - size + 1, size):
            index, labelled = order[:, start : start + size], supervised[:, start : start + size].any()
            z_a = None if self.z_a is None else self.z_a[shared, index]
            yield Batch(
                self.trajectories.at(shared, index),
                self.z_e[shared, index],
                self.supervised[index],
                self.complete,
                bool(labelled),
                z_a,
            )

    def steps(self, size: int) -> int:
        """Batches in one pass."""
        return max(len(self) // min(size, len(self)), 1)


@dataclass(frozen=True)
class Task:
    """What a loss needs to know about the data.

    Attributes:
        t: all times of a trajectory in s, (T,), on the CPU: solvers step from number to number.
        observed: points in [t0, t1], which the encoder sees.
        horizon: points that the loss compares, from the first on.
        solver: for the forecasts.
        z_e_scale: (P,), standard deviation of p⁺ for the supervision of z_e.
        supervision_weight: of the z_e term.
        z_a_scale: (S, 1, Q), spread of z_a over the training windows, for the supervision of z_a.
        z_a_supervision_weight: of the z_a term; 0: there is none.
        bound: (K,), how far a forecast's components may go (:mod:`expertaug.learning.divergence`); None for no bound.
        doubts: where a loss leaves what it takes for granted, each one truth value on the device, instead of waiting
            for it; None: it waits, and acts on it.
    """

    t: Tensor
    observed: int
    horizon: int
    solver: Solver
    z_e_scale: Tensor | float = 1.0
    supervision_weight: float = 1.0
    z_a_scale: Tensor | float = 1.0
    z_a_supervision_weight: float = 0.0
    bound: Tensor | None = None
    doubts: list[Tensor] | None = None

    def shortened(self, points: int) -> Task:
        """The same over the first ``points`` times."""
        return replace(self, t=self.t[:points])

    def points(self, choices: Choices) -> int:
        """Points of a trajectory that training needs."""
        return len(self.t) if choices.loss_window == "half_batch" else max(self.horizon, self.observed)

    def selection(self, choices: Choices) -> range:
        """Points of the validation set that select the best model."""
        return range(1, self.horizon) if choices.selection == "observed" else range(self.observed, len(self.t))


def set_files(data: Path) -> list[Path]:
    """Files of the two sets in a folder that a training reads."""
    return [Path(data) / f"{name}.npz" for name in ("train", "validation")]


class TrainedWith(Protocol):
    """What a task asks of the settings, or the record, of a training."""

    @property
    def solver(self) -> SolverSettings: ...

    @property
    def horizon_s(self) -> float: ...


def task_of(
    training: TrainedWith,
    card: ModelCard,
    device: torch.device,
    scale: Tensor | float = 1.0,
) -> Task:
    """The task of a training, or of what was trained so, for the model of a card.

    Raises:
        InputError: the loss window ends a step or more after the data.
    """
    horizon, asked = card.observed, training.horizon_s
    if asked is not None:
        if asked >= 2 * card.t[-1] - card.t[-2]:
            raise InputError("training.horizon_s", f"found {asked:g}", f"the data end at {card.t[-1]:g} s")
        horizon = points_until(card.t, asked)
    weight, z_a_weight = (getattr(training, f"{of}supervision_weight", None) for of in ("", "z_a_"))
    return Task(
        t=torch.tensor(card.t, dtype=torch.float32),
        observed=card.observed,
        horizon=max(horizon, 2),
        solver=Solver(**dict(training.solver or {})),
        z_e_scale=scale,
        supervision_weight=1.0 if weight is None else float(weight),
        z_a_supervision_weight=float(z_a_weight or 0.0),
        bound=bound_of_card(card, device),
    )

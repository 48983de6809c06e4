"""What losses, selection and augmentation need to know about the data."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import torch
from torch import Tensor

from expertaug.learning.divergence import stored_bound
from expertaug.models.card import ModelCard
from expertaug.presets import Choices
from expertaug.systems.settings import SolverSettings
from expertaug.systems.solvers.solver import Solver
from expertaug.trajectories import points_until


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
    z_a_scale: Tensor | float = 1.0,
) -> Task:
    """The task of a training, or of what was trained so, for the model of a card."""
    horizon = card.observed if training.horizon_s is None else points_until(card.t, training.horizon_s)
    weight, z_a_weight = (getattr(training, f"{of}supervision_weight", None) for of in ("", "z_a_"))
    return Task(
        t=torch.tensor(card.t, dtype=torch.float32),
        observed=card.observed,
        horizon=max(horizon, 2),
        solver=Solver(**dict(training.solver or {})),
        z_e_scale=scale,
        supervision_weight=1.0 if weight is None else float(weight),
        z_a_scale=z_a_scale,
        z_a_supervision_weight=float(z_a_weight or 0.0),
        bound=stored_bound(card, device),
    )

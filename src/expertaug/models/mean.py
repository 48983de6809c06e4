"""The paper's simplest baseline: the mean of the training signals."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from expertaug.models.posterior import Estimates, Predictor
from expertaug.systems import System
from expertaug.systems.inputs import states_of
from expertaug.systems.solvers.solver import Solver


class MeanModel(Predictor, nn.Module):
    """A decoder that needs no estimates: for every time the training set's mean state.

    Arguments:
        mean: (T, *state).
    """

    def __init__(self, system: System, mean: Tensor) -> None:
        super().__init__()
        self.system = system
        self.register_buffer("mean", mean)

    def estimate(self, windows: Tensor) -> Estimates:
        """Observed windows (T1, …, B, *observed) → their first points, and no parameters."""
        return Estimates(states_of(self.system, windows[0]).nan_to_num(), None, None)

    def forecast(self, y0: Tensor, z_e: None, z_a: None, t: Tensor, solver: Solver, u: Tensor | None = None) -> Tensor:
        """(…, B, *state) → (T, …, B, *state); the same for every sample, and beyond the training's times that
        of the last of them."""
        last = len(self.mean) - 1
        known = self.mean[torch.arange(len(t)).clamp_max(last)]
        lead = y0.dim() - self.mean.dim() + 1
        mean = known.reshape(len(t), *[1] * lead, *self.mean.shape[1:])
        return mean.expand(len(t), *y0.shape)

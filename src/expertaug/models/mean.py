"""The paper's simplest baseline: the mean of the training signals."""

from __future__ import annotations

from torch import Tensor, nn

from expertaug.systems import System
from expertaug.systems.solver import Solver


class MeanModel(nn.Module):
    """Predicts, for every time, the training set's mean state; it estimates no parameters.

    Arguments:
        mean: (T, *state).
    """

    def __init__(self, system: System, mean: Tensor) -> None:
        super().__init__()
        self.system = system
        self.register_buffer("mean", mean)

    def predict(self, observed: Tensor, t: Tensor, solver: Solver, start: str = "y0") -> tuple[Tensor, None]:
        """(T1, S, B, *state) → (T, S, B, *state); the same for every sample."""
        lead = observed.dim() - self.mean.dim() + 1 - 1
        mean = self.mean.reshape(len(self.mean), *[1] * lead, *self.mean.shape[1:])
        return mean.expand(len(t), *observed.shape[1:]), None

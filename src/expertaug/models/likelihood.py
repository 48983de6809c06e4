"""The Gaussian likelihood of the hybrid-VAE: one learned scale for all observations (paper, app. HVAE)."""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

GAIN = 10.0  # the scale falls by orders of magnitude in training: its logarithm moves ten learning rates a step
FLOOR = 1e-4  # of the data's standard deviation


class GaussianLikelihood(nn.Module):
    """y ~ N(forecast, σ²) for every observed value; σ starts at the data's standard deviation (:meth:`fit`)."""

    unit: Tensor

    def __init__(self) -> None:
        super().__init__()
        self.log_scale = nn.Parameter(torch.zeros(1))
        self.register_buffer("unit", torch.ones(1))

    def fit(self, observed: Tensor) -> None:
        """Take the unit of σ from the training set's observed quantities (T1, N, *observed)."""
        self.unit.copy_(observed.std((0, 1)).square().mean().sqrt().expand_as(self.unit))

    @property
    def scale(self) -> Tensor:
        """σ, (1,), or (S, 1) for stacked seeds."""
        return self.unit * (FLOOR + torch.exp(GAIN * self.log_scale))

    def log_prob(self, squares: Tensor, count: Tensor | int) -> Tensor:
        """Log-density (…, B) of ``count`` values, one number or (…, B), whose squared errors sum to ``squares``."""
        scale = self.scale
        return -0.5 * squares / scale.square() - count * (scale.log() + 0.5 * math.log(2 * math.pi))

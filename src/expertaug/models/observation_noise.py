"""Noise of observations: standard deviations that settings or data tell, and the likelihood's, which is learned."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import torch
from torch import Tensor, nn

from expertaug.errors import InputError
from expertaug.models.card import ModelCard
from expertaug.systems import System
from expertaug.wording import check_keys

ESTIMATED = "estimated"
NoiseLike = float | Sequence[float]  # of all components, or of each
GivenNoise = float | Mapping[str, float] | str  # as settings say it

GAIN = 10.0  # the scale falls by orders of magnitude in training: its logarithm moves ten learning rates a step
FLOOR = 1e-4  # of the data's standard deviation


def noise_of(noise: GivenNoise, system: System, card: ModelCard) -> NoiseLike:
    """What settings say of the noise, as numbers.

    Arguments:
        noise: one number, one by component, or ``estimated``.
        card: of a model; it knows what was estimated from its training set.

    Raises:
        InputError: a name that is no component's, or nothing was estimated.
    """
    if isinstance(noise, int | float):
        return float(noise)
    names = [p.name for p in system.state]
    if noise == ESTIMATED:
        estimated = card.data_noise
        if estimated is None:
            raise InputError("noise", "estimated, but the training set does not say it", "give a number")
        return [float(value) for value in estimated]
    assert isinstance(noise, Mapping)
    check_keys(noise, names, "noise", "component of the state")
    return [float(noise.get(name, 0.0)) for name in names]


def is_some(noise: NoiseLike) -> bool:
    """Whether any component has noise."""
    return noise > 0 if isinstance(noise, int | float) else any(value > 0 for value in noise)


def shape_as_state(noise: NoiseLike, y: Tensor, system: System) -> Tensor | float:
    """Noise as a factor of states y (…, *state)."""
    if isinstance(noise, int | float):
        return noise
    return torch.tensor(noise).to(y).view(-1, *[1] * (len(system.state_shape) - 1))


def of_observed(noise: NoiseLike, system: System) -> Tensor | float:
    """Noise of the observed quantities (*observed) of vector states, to the first order with slopes of 1: what depends
    on several components has the root of the sum of their squares."""
    if isinstance(noise, int | float):
        return noise
    sigma, state = torch.tensor(noise, dtype=torch.float64), torch.linspace(0.1, 0.2, len(noise), dtype=torch.float64)
    base, squares = system.observe(state), torch.zeros_like(system.observe(state))
    for k in range(len(noise)):
        moved = state.clone()
        moved[k] += 0.01
        squares = squares + torch.where(system.observe(moved) != base, sigma[k].square(), 0.0)
    return squares.sqrt()


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

"""Coordinates of (z_e, z_a, y0) in which an estimator seeks or infers them, and back."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from expertaug.models.card import LatentRecord, ModelCard
from expertaug.models.gaps import ends_of
from expertaug.models.observation_noise import NoiseLike, is_some
from expertaug.models.posterior import principal_axes, scores_of
from expertaug.systems import System
from expertaug.systems.base import constant_like

SMALLEST = 1e-3  # of the largest value of the training set: the noise that is assumed where data have none
LOGISTIC = math.pi / math.sqrt(3)  # standard deviation of the logit of a uniform number


def box(system: System, low: Tensor, high: Tensor, margin: float) -> tuple[Tensor, Tensor]:
    """p⁺'s ends (P,) moved outwards by ``margin`` of its widths; a positive parameter stays positive."""
    wide = margin * (high - low).clamp_min(1e-6 * high.abs().clamp_min(1.0))
    positive = torch.tensor([p.positive for p in system.expert_parameters])
    return torch.where(positive, (low - wide).clamp_min(0.0), low - wide), high + wide


class Unknowns(nn.Module):
    """θ = (logit of z_e in a box, principal components of z_a, first point − observed first point).

    z_e and z_a are in units of their prior's width, the first point is in units of the noise: each is then about
    standard normal before anything is learned.  A flow may draw what its prior does not hold, most of all for windows
    that few of its draws are like: z_e stays in the box, and components of z_a stay where those of the training windows
    are, since F_a was not learned elsewhere.

    Arguments:
        system: with P parameters.
        low, high: ends (P,) of the box.
        latents: z_a (N, Q) of the training windows.
        components: principal components of z_a that are inferred, at most.
        noise: standard deviation of the data's noise; 0: the first point is what was observed.
        ranges: of the components of first points, where they may not be measured (NaN): such a component is in units of
            half its range, around its middle.
        beyond: how far drawn components of z_a may lie outside those of the training windows, in standard deviations.
    """

    def __init__(
        self,
        system: System,
        low: Tensor,
        high: Tensor,
        latents: Tensor,
        components: int,
        noise: NoiseLike,
        ranges: Mapping[str, Sequence[float]] | None = None,
        beyond: float = 0.0,
    ) -> None:
        super().__init__()
        self.state_shape = system.state_shape
        self.given = given_components(system).nonzero().flatten().tolist() if is_some(noise) else []
        if ranges is not None:
            self.given = free_components(system).nonzero().flatten().tolist()
        each = [float(noise)] * len(system.state) if isinstance(noise, int | float) else noise
        # What has no noise, but may be missing, is known to a small part of its range.
        self.units = [each[k] or SMALLEST * float(ends_of(ranges)[1][k]) for k in self.given] if ranges else None
        self.noise = [each[k] for k in self.given]
        self.middle = None if ranges is None else ends_of(ranges)[0].tolist()
        self.ranges = None if ranges is None else [values[self.given].tolist() for values in ends_of(ranges)]
        self.register_buffer("low", low.unsqueeze(0).clone())
        self.register_buffer("high", high.unsqueeze(0).clone())
        rows = principal_axes(latents, components)
        self.register_buffer("mean", latents.mean(0, keepdim=True))
        self.register_buffer("rows", rows.to(latents))  # (components, Q), of one standard deviation each
        known = self.scores(latents)
        self.register_buffer("least", known.amin(0, keepdim=True) - beyond)
        self.register_buffer("most", known.amax(0, keepdim=True) + beyond)
        self.sizes = (low.numel(), len(rows), len(self.given))

    @property
    def count(self) -> int:
        """Numbers of θ."""
        return sum(self.sizes)

    def scores(self, z_a: Tensor) -> Tensor:
        """Principal components (…, N, ·) of z_a (…, N, Q), in standard deviations."""
        return scores_of(z_a - self.mean, self.rows)

    def latent(self, scores: Tensor) -> Tensor:
        """z_a (…, B, Q) of principal components (…, B, ·)."""
        return self.mean + scores @ self.rows

    def pack(self, z_e: Tensor, scores: Tensor, y0: Tensor, first: Tensor) -> Tensor:
        """θ (…, B, count) of z_e (…, B, P), components of z_a, and the first point (…, B, *state), observed as
        ``first``."""
        share = ((z_e - self.low) / (self.high - self.low)).clamp(1e-6, 1 - 1e-6)
        parts = [torch.logit(share) / LOGISTIC, scores]
        if self.given:
            around, unit = self._first(first)
            parts.append((self._of_given(y0) - around) / unit)
        return torch.cat(parts, dim=-1)

    def unpack(self, theta: Tensor, first: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """z_e (…, B, P), z_a (…, B, Q) and y0 (…, B, *state) of θ (…, B, count)."""
        logit, scores, moved = theta.split(self.sizes, dim=-1)
        z_e = self.low + (self.high - self.low) * torch.sigmoid(LOGISTIC * logit)
        y0 = first.expand(*theta.shape[:-1], *self.state_shape)
        if self.given:
            around, unit = self._first(first)
            if self.middle is not None:
                y0 = torch.where(torch.isnan(y0), constant_like(y0, self.middle, y0.dtype), y0)
            y0 = y0.index_copy(-1, constant_like(y0, self.given, torch.long), around + unit * moved)
        return z_e, self.latent(torch.minimum(torch.maximum(scores, self.least), self.most)), y0

    def _first(self, first: Tensor) -> tuple[Tensor, Tensor]:
        """What the given components of first points (…, B, *state) are around, and in which units."""
        first = self._of_given(first)
        if self.ranges is None:
            return first, constant_like(first, self.noise, first.dtype)
        assert self.units is not None, "ranges come with units"
        middle, width, units = (constant_like(first, values, first.dtype) for values in (*self.ranges, self.units))
        unknown = torch.isnan(first)
        return torch.where(unknown, middle, first), torch.where(unknown, width, units)

    def _of_given(self, y0: Tensor) -> Tensor:
        return y0.index_select(-1, constant_like(y0, self.given, torch.long))

    def log_slope(self, theta: Tensor, first: Tensor) -> Tensor:
        """Logarithm of |∂(z_e, components of z_a, y0) / ∂θ|, (…, B)."""
        raw = LOGISTIC * theta[..., : self.sizes[0]]
        width = ((self.high - self.low) * LOGISTIC).log()
        slope = (nn.functional.logsigmoid(raw) + nn.functional.logsigmoid(-raw) + width).sum(-1)
        return slope + (self._first(first)[1].log().sum(-1) if self.given else 0.0)


@dataclass(frozen=True)
class Latent:
    """Where the z_a of the training windows lie, and in which coordinates a fit seeks one.

    Attributes:
        mean, std: (S, Q) each.
        axes: principal axes (S, C, Q), where z_a has too many components to seek each: the others stay at their mean.
    """

    mean: Tensor
    std: Tensor
    axes: Tensor | None = None

    @classmethod
    def of(cls, card: ModelCard, components: int) -> Latent:
        """Of a model file, with at most so many coordinates; the expert alone has none."""
        known = card.latent or LatentRecord(mean=[[]], std=[[]])
        mean, std = (torch.tensor(value, dtype=torch.float64) for value in (known.mean, known.std))
        axes = None
        if known.axes is not None and mean.shape[-1] > components:
            axes = torch.tensor(known.axes, dtype=torch.float64)[:, :components]
        return cls(mean, std.clamp_min(1e-6), axes)

    @property
    def size(self) -> int:
        """Coordinates of z_a."""
        return self.mean.shape[-1] if self.axes is None else self.axes.shape[-2]

    def z_a(self, coordinates: Tensor) -> Tensor:
        """z_a (S, N, Q) of coordinates (S, N, size), in standard deviations."""
        moved = self.std.unsqueeze(1) * coordinates if self.axes is None else coordinates @ self.axes
        return self.mean.unsqueeze(1) + moved

    def coordinates(self, z_a: Tensor) -> Tensor:
        """Of z_a (S, N, Q): (S, N, size)."""
        away = z_a - self.mean.unsqueeze(1)
        return away / self.std.unsqueeze(1) if self.axes is None else scores_of(away, self.axes)

    def spread(self, std: Tensor) -> Tensor:
        """Standard deviation (S, N, Q) of z_a from that of coordinates (S, N, size), to first order."""
        if self.axes is None:
            return std * self.std.unsqueeze(1)
        return (std.square() @ self.axes.square()).sqrt()


def seen_components(system: System) -> Tensor:
    """Which components of a state are observed, (K,)."""
    state = torch.linspace(0.1, 0.2, len(system.state), dtype=torch.float64)
    state = state.view(-1, *[1] * (len(system.state_shape) - 1)).expand(system.state_shape)
    return _felt(system.observe, state)


def given_components(system: System) -> Tensor:
    """Which components (K,) of the first point are observed and not replaced by z_e; none of a field's."""
    return seen_components(system) & free_components(system)


def free_components(system: System) -> Tensor:
    """Which components (K,) of the first point z_e does not replace; none of a field's."""
    if len(system.state_shape) > 1:
        return torch.zeros(len(system.state), dtype=torch.bool)
    z_e = torch.tensor([p.scale for p in system.expert_parameters], dtype=torch.float64)
    state = torch.linspace(0.1, 0.2, len(system.state), dtype=torch.float64)
    return _felt(lambda y: system.initial_state(y, z_e), state)


def _felt(function: object, state: Tensor) -> Tensor:
    """Which components of a state a function depends on."""
    assert callable(function)
    base, felt = function(state), []
    for k in range(len(state)):
        moved = state.clone()
        moved[k] += 0.01
        felt.append(not torch.equal(function(moved), base))
    return torch.tensor(felt, dtype=torch.bool)

"""The transform of (z_e, z_a, y0) to coordinates in which an estimator seeks or infers them, and back."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

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


def widen_box(system: System, low: Tensor, high: Tensor, margin: float) -> tuple[Tensor, Tensor]:
    """p⁺'s ends (P,) moved outwards by ``margin`` of its widths; a positive parameter stays positive."""
    wide = margin * (high - low).clamp_min(1e-6 * high.abs().clamp_min(1.0))
    positive = torch.tensor([p.positive for p in system.expert_parameters])
    return torch.where(positive, (low - wide).clamp_min(0.0), low - wide), high + wide


@dataclass(frozen=True)
class LogCoordinates:
    """z_e on a scale of its own: ln(z_e / scale) of a positive parameter, z_e / scale of another.

    Attributes:
        scale: (P,), in the parameters' units.
        positive: (P,), bool.
        shared: (P,), or (S, 1, P) where each seed knows others: coordinates of parameters that all windows share and
            that are known; NaN of those of each window, which alone are coordinates of a window.
    """

    scale: Tensor
    positive: Tensor
    shared: Tensor

    @classmethod
    def of(cls, system: System, shared: Mapping[str, float | Sequence[float]] | None = None) -> LogCoordinates:
        """Of a system's expert parameters.

        Arguments:
            shared: values of the parameters that all windows share, by name, in their units; of several seeds one each.
        """
        parameters = system.expert_parameters
        scale = torch.tensor([p.scale for p in parameters], dtype=torch.float64)
        positive = torch.tensor([p.positive for p in parameters], dtype=torch.bool)
        each = [torch.tensor((shared or {}).get(p.name, math.nan), dtype=torch.float64) for p in parameters]
        values = torch.stack(torch.broadcast_tensors(*each), dim=-1)
        values = values.unsqueeze(1) if values.dim() > 1 else values
        return cls(scale, positive, _log_where(positive, values / scale))

    def holding(self, places: Sequence[int], shared: Tensor) -> LogCoordinates:
        """The same with other coordinates (S, M) of the M parameters that windows share, at their places."""
        wide = shared.new_full((len(shared), len(self.scale)), math.nan)
        wide[:, list(places)] = shared
        return replace(self, shared=wide.unsqueeze(1))

    @property
    def own(self) -> Tensor:
        """Places of the parameters of each window."""
        return self._own.nonzero().flatten()

    @property
    def size(self) -> int:
        """Number of parameters of each window."""
        return int(self._own.sum())

    @property
    def _own(self) -> Tensor:
        return self.shared.reshape(-1, len(self.scale))[0].isnan()

    def coordinates(self, z_e: Tensor) -> Tensor:
        """Of z_e (…, P): (…, size); what cannot be one, zero or less, is moved near."""
        return _log_where(self.positive, z_e / self.scale)[..., self.own]

    def z_e(self, coordinates: Tensor) -> Tensor:
        """z_e (…, P) of coordinates (…, size)."""
        if len(self.own) < len(self.scale):
            whole = self.shared.to(coordinates).expand(*coordinates.shape[:-1], -1)
            coordinates = whole.index_copy(-1, self.own, coordinates)
        return self.scale * torch.where(self.positive, coordinates.exp(), coordinates)

    def slope(self, coordinates: Tensor) -> Tensor:
        """∂z_e / ∂coordinates of the parameters of each window, (…, size)."""
        slope = torch.where(self.positive[self.own], coordinates.exp(), torch.ones_like(coordinates))
        return self.scale[self.own] * slope


def _log_where(positive: Tensor, share: Tensor) -> Tensor:
    return torch.where(positive, share.clamp_min(1e-3).log(), share)


@dataclass(frozen=True)
class BoxCoordinates:
    """The logit of z_e in a box, in units of its standard deviation where z_e is uniform there.

    Attributes:
        low, high: ends (…, 1, P) of the box.
    """

    low: Tensor
    high: Tensor

    @property
    def size(self) -> int:
        """Number of parameters."""
        return self.low.shape[-1]

    def coordinates(self, z_e: Tensor) -> Tensor:
        """Of z_e (…, B, P): what lies outside the box is moved inside."""
        share = ((z_e - self.low) / (self.high - self.low)).clamp(1e-6, 1 - 1e-6)
        return torch.logit(share) / LOGISTIC

    def z_e(self, coordinates: Tensor) -> Tensor:
        """z_e (…, B, P) of coordinates."""
        return self.low + (self.high - self.low) * torch.sigmoid(LOGISTIC * coordinates)

    def log_slope(self, coordinates: Tensor) -> Tensor:
        """Logarithm of ∂z_e / ∂coordinates, (…, B, P)."""
        raw = LOGISTIC * coordinates
        width = ((self.high - self.low) * LOGISTIC).log()
        return nn.functional.logsigmoid(raw) + nn.functional.logsigmoid(-raw) + width


@dataclass(frozen=True)
class LatentCoordinates:
    """z_a in standard deviations of the training windows' around their mean: by component, or along principal axes.

    Attributes:
        mean, std: (S, 1, Q) each; ``std`` None where there are axes.
        axes: principal axes (S, C, Q), each as long as its standard deviation; z_a stays at its mean in all other
            directions.
        least, most: (S, 1, C), where coordinates end: F_a was not learned elsewhere; None: nowhere.
    """

    mean: Tensor
    std: Tensor | None = None
    axes: Tensor | None = None
    least: Tensor | None = None
    most: Tensor | None = None

    @classmethod
    def of(cls, card: ModelCard, components: int) -> LatentCoordinates:
        """Of a model file, with at most so many coordinates; the expert alone has none."""
        record = card.latent or LatentRecord(mean=[[]], std=[[]])
        mean, std = (torch.tensor(value, dtype=torch.float64).unsqueeze(1) for value in (record.mean, record.std))
        if record.axes is not None and mean.shape[-1] > components:
            return cls(mean, axes=torch.tensor(record.axes, dtype=torch.float64)[:, :components])
        return cls(mean, std.clamp_min(1e-6))

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return self.mean.shape[-1] if self.axes is None else self.axes.shape[-2]

    def coordinates(self, z_a: Tensor) -> Tensor:
        """Of z_a (S, N, Q): (S, N, size)."""
        deviations = z_a - self.mean
        return deviations / self.std if self.axes is None else scores_of(deviations, self.axes)

    def z_a(self, coordinates: Tensor) -> Tensor:
        """z_a (S, N, Q) of coordinates (S, N, size)."""
        return self.mean + (self.std * coordinates if self.axes is None else coordinates @ self.axes)

    def within(self, coordinates: Tensor) -> Tensor:
        """Coordinates that end where they may."""
        if self.least is None or self.most is None:
            return coordinates
        return torch.minimum(torch.maximum(coordinates, self.least), self.most)

    def spread(self, std: Tensor) -> Tensor:
        """Standard deviation (S, N, Q) of z_a from that of coordinates (S, N, size), to first order."""
        if self.axes is None:
            return std * self.std
        return (std.square() @ self.axes.square()).sqrt()


@dataclass(frozen=True)
class FirstPointCoordinates:
    """Some components of the first point as deviations from the observed one, in units of the noise; what was not
    measured is a deviation from the middle of its range, in units of half the range.

    Attributes:
        state_shape: of the system's state.
        components: places of those that are sought; of fields there are none.
        units: of each of them.
        middle, width: of the range of every component, half its width; None: everything was measured.
    """

    state_shape: tuple[int, ...]
    components: Sequence[int]
    units: Sequence[float]
    middle: Sequence[float] | None = None
    width: Sequence[float] | None = None

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return len(self.components)

    def coordinates(self, y0: Tensor, observed: Tensor) -> Tensor:
        """Of first points y0 (…, B, *state), observed as (…, B, *state): (…, B, size)."""
        centre, unit = self.centre(observed)
        return (self._chosen(y0) - centre) / unit

    def y0(self, coordinates: Tensor, observed: Tensor) -> Tensor:
        """First points (…, B, *state) of coordinates (…, B, size), observed as (…, B, *state)."""
        y0 = observed.expand(*coordinates.shape[:-1], *self.state_shape)
        if self.middle is not None:
            y0 = torch.where(torch.isnan(y0), constant_like(y0, self.middle, y0.dtype), y0)
        if not self.size:
            return y0
        centre, unit = self.centre(observed)
        return y0.index_copy(-1, constant_like(y0, self.components, torch.long), centre + unit * coordinates)

    def centre(self, observed: Tensor) -> tuple[Tensor, Tensor]:
        """What the components of first points (…, B, *state) are sought around, and their units."""
        first = self._chosen(observed)
        units = constant_like(first, self.units, first.dtype)
        if self.middle is None or self.width is None:
            return first, units
        middle, width = (
            constant_like(first, [values[k] for k in self.components], first.dtype)
            for values in (self.middle, self.width)
        )
        unknown = torch.isnan(first)
        return torch.where(unknown, middle, first), torch.where(unknown, width, units)

    def _chosen(self, y0: Tensor) -> Tensor:
        return y0.index_select(-1, constant_like(y0, self.components, torch.long))


@dataclass(frozen=True)
class ParameterTransform:
    """θ ↔ (z_e, z_a, y0): unbounded numbers of order one, and what they stand for.

    Attributes:
        expert, latent, start: coordinates of each part; θ is made of them in this order.
    """

    expert: LogCoordinates | BoxCoordinates
    latent: LatentCoordinates
    start: FirstPointCoordinates

    @property
    def sizes(self) -> tuple[int, int, int]:
        """Numbers of θ that stand for z_e, z_a and y0."""
        return self.expert.size, self.latent.size, self.start.size

    def pack(self, z_e: Tensor, latent: Tensor, y0: Tensor, observed: Tensor) -> Tensor:
        """θ (…, B, D) of z_e (…, B, P), coordinates of z_a, and first points (…, B, *state), observed as given."""
        parts = [self.expert.coordinates(z_e), latent]
        if self.start.size:
            parts.append(self.start.coordinates(y0, observed))
        return torch.cat(parts, dim=-1)

    def unpack(self, theta: Tensor, observed: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """z_e (…, B, P), z_a (…, B, Q) and first points (…, B, *state) of θ (…, B, D)."""
        expert, latent, start = theta.split(self.sizes, dim=-1)
        z_a = self.latent.z_a(self.latent.within(latent))
        return self.expert.z_e(expert), z_a, self.start.y0(start, observed)


class PriorTransform(nn.Module):
    """The transform by which θ is about standard normal under p⁺, before anything is learned; stacked over seeds.

    z_e and z_a are in units of their prior's width, the first point is in units of the noise.  A flow may draw what its
    prior does not hold, most of all for windows that few of its draws are like: z_e stays in the box, and components of
    z_a stay where those of the training windows are.  Model files hold its tensors.

    Arguments:
        system: with P parameters.
        low, high: ends (P,) of the box.
        latents: z_a (N, Q) of the training windows.
        components: principal components of z_a that are inferred, at most.
        noise: standard deviation of the data's noise; 0: the first point is what was observed.
        ranges: of the components of first points, where they may not be measured (NaN).
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
        self.start = _first_point(system, noise, ranges)
        self.register_buffer("low", low.unsqueeze(0).clone())
        self.register_buffer("high", high.unsqueeze(0).clone())
        self.register_buffer("mean", latents.mean(0, keepdim=True))
        self.register_buffer("rows", principal_axes(latents, components).to(latents))
        scores = scores_of(latents - self.mean, self.rows)
        self.register_buffer("least", scores.amin(0, keepdim=True) - beyond)
        self.register_buffer("most", scores.amax(0, keepdim=True) + beyond)

    @property
    def transform(self) -> ParameterTransform:
        """With the tensors as they are now: stacked, moved or read from a file."""
        latent = LatentCoordinates(self.mean, axes=self.rows, least=self.least, most=self.most)
        return ParameterTransform(BoxCoordinates(self.low, self.high), latent, self.start)

    @property
    def count(self) -> int:
        """Numbers of θ."""
        return sum(self.transform.sizes)

    def log_slope(self, theta: Tensor, observed: Tensor) -> Tensor:
        """Logarithm of |∂(z_e, components of z_a, y0) / ∂θ|, (…, B)."""
        parts = self.transform
        slope = parts.expert.log_slope(theta[..., : parts.expert.size]).sum(-1)  # type: ignore[union-attr]
        return slope + (self.start.centre(observed)[1].log().sum(-1) if self.start.size else 0.0)


def _first_point(
    system: System, noise: NoiseLike, ranges: Mapping[str, Sequence[float]] | None
) -> FirstPointCoordinates:
    """Of first points with noise, or with components that may not be measured."""
    each = [float(noise)] * len(system.state) if isinstance(noise, int | float) else noise
    if ranges is None:
        components = given_components(system).nonzero().flatten().tolist() if is_some(noise) else []
        return FirstPointCoordinates(system.state_shape, components, [each[k] for k in components])
    components = free_components(system).nonzero().flatten().tolist()
    middle, width = (ends.tolist() for ends in ends_of(ranges))
    # What has no noise, but may be missing, is known to a small part of its range.
    units = [each[k] or SMALLEST * width[k] for k in components]
    return FirstPointCoordinates(system.state_shape, components, units, middle, width)


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

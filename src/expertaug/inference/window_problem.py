"""What a window says of (z_e, z_a, y0): the problem that least squares solves, with what is known beforehand."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Self

import torch
from torch import Tensor

from expertaug.errors import InputError
from expertaug.inference.coordinates import (
    SMALLEST,
    FirstPointCoordinates,
    LatentCoordinates,
    LogCoordinates,
    ParameterTransform,
    free_components,
    given_components,
    seen_components,
)
from expertaug.inference.levenberg_marquardt import LONGEST
from expertaug.inference.population import PopulationPull
from expertaug.learning.divergence import FACTOR, forecast_or_fallback
from expertaug.learning.residuals import differences
from expertaug.models.decoder import Decoder, TruthDecoder
from expertaug.models.fit_settings import Constant, RefinementSettings
from expertaug.models.gaps import ends_of
from expertaug.models.observation_noise import NoiseLike, of_observed, shape_as_state
from expertaug.models.posterior import Estimates
from expertaug.systems import System
from expertaug.systems.inputs import inputs_of, states_of
from expertaug.systems.solvers.solver import Solver

FARTHEST = 10.0  # step of a first point, in standard deviations of the noise
FREE = 30.0  # step of a true equation's z_a, in its standard deviations over the training windows
MEMORY = 2**26  # bytes of the states that are compared at a time


class WindowProblem:
    """What a window says of (z_e, z_a, y0): squares of residuals, whose sum is least at the estimate.

    Its parameters are ln(z_e / scale) where z_e is positive, z_e / scale elsewhere, z_a (of a long one its first
    principal components) in standard deviations of the training windows, and, where the first point is noisy, its
    components in standard deviations of the noise.

    Arguments:
        decoder: stacked over S seeds, or without parameters.
        t: times of the observed window in s, (T1,).
        settings: how to fit.
        noise: standard deviation of the observation, > 0, one or one for each component.
        free_start: whether the first point is noisy.
        prior: range of each expert parameter in which starts lie; None: only the given first estimates are starts.
        latent: where z_a lies.
        solver: on a fixed grid; another is replaced where it fails.
        ranges: of the components of first points, where windows may have values that were not measured (NaN): the first
            point is then a parameter in any case, in units of half a range where it was not measured.
        shared: constants of all windows (:mod:`expertaug.inference.shared`), which are no parameters of a window.
        population: what pulls parameters of windows towards the middle of their distribution.
        overdispersion: by how much less residuals tell than independent ones of the stated noise would, by each seed's
            model or by all; None: not less.

    Raises:
        InputError: a range or a window of what the system does not have, or no start at all.
    """

    def __init__(
        self,
        decoder: Decoder,
        t: Tensor,
        settings: RefinementSettings,
        noise: NoiseLike,
        free_start: bool,
        prior: Mapping[str, tuple[float, float]] | None,
        latent: LatentCoordinates,
        solver: Solver,
        ranges: Mapping[str, Sequence[float]] | None = None,
        shared: Mapping[str, Constant] | None = None,
        population: PopulationPull | None = None,
        overdispersion: Sequence[float] | None = None,
    ) -> None:
        system = decoder.system
        self.decoder = copy.deepcopy(decoder).cpu().double().requires_grad_(False).eval()
        self.system, self.settings, self.solver = system, settings, solver
        self.observed_noise = of_observed(noise, system)
        self.population = population
        self.overdispersion = torch.tensor(overdispersion or [1.0], dtype=torch.float64)
        self.t = t.double()
        start = _first_point(system, noise, free_start, ranges)
        self.shared = dict(shared or {})
        self.expert = LogCoordinates.of(system, {name: constant.held for name, constant in self.shared.items()})
        self.transform = ParameterTransform(self.expert, latent, start)
        self.counts = _counts(system, self.t, settings.windows if "windows" in settings.model_fields_set else {})
        self.sizes = p, q, free = self.transform.sizes
        # A first point may be several standard deviations off, and its residuals are nearly linear in it.
        longest = torch.full((sum(self.sizes),), LONGEST, dtype=torch.float64)
        if isinstance(decoder, TruthDecoder):  # its z_a means the same far from the training windows
            longest[p : p + q] = FREE
        longest[len(longest) - free :] = FARTHEST
        self.longest = longest
        self.grid = None if prior is None or not settings.starts else self._grid(prior)

    def hold(self, places: Sequence[int], shared: Tensor) -> None:
        """Hold the parameters at these places, which all windows share, at other coordinates, (S, M)."""
        self.expert = self.expert.holding(places, shared)
        self.transform = replace(self.transform, expert=self.expert)

    def pulled(self, population: PopulationPull) -> Self:
        """The same problem where something else is known of the parameters beforehand."""
        other = copy.copy(self)
        other.population = population
        return other

    @property
    def tries(self) -> int:
        """Points of the grid from which a window is fitted, at most."""
        return 0 if self.grid is None else min(self.settings.tries, len(self.grid))

    @property
    def observations(self) -> int:
        """Observed numbers that a window is compared at."""
        seen = seen_components(self.system)[:, None] & self.counts
        each = seen if self.transform.start.size else seen[:, 1:]  # a known first point has no residual
        cells = 1
        for size in self.system.state_shape[1:]:
            cells *= size
        return int(each.sum()) * cells

    def residuals(self, x: Tensor, windows: Tensor) -> Tensor:
        """x (C, S, B, K), windows (T1, S, B, *observed) → (C, S, B, M): residuals in units of the noise, then z_a's."""
        copies, seeds, count = x.shape[:3]
        wide = x.movedim(0, 1).flatten(1, 2)  # (S, C·B, K): the seeds' parameters stay beside the seeds
        observed = windows.repeat(1, 1, copies, *[1] * (windows.dim() - 3))
        data = self.differences(self.states(wide, observed), observed)
        return torch.cat((data, self.pull(wide)), -1).view(seeds, copies, count, -1).movedim(1, 0)

    def first(self, windows: Tensor) -> Tensor:
        """The observed first points (S, N, *state) of windows (T1, S, N, *observed), as a forecast starts from them."""
        return self.decoder.state_of(states_of(self.system, windows[0]))

    def states(self, x: Tensor, windows: Tensor) -> Tensor:
        """Forecasts (T1, S, N, *state), as they are measured, with parameters (S, N, K), from the first points and with
        the known inputs of windows (T1, S, N, *observed)."""
        z_e, z_a, start = self.parts(x, self.first(windows))
        u = inputs_of(self.system, windows)
        return forecast_or_fallback(self.decoder, start, z_e, z_a, self.t, self.solver, u)  # type: ignore[arg-type]

    def differences(self, states: Tensor, observed: Tensor) -> Tensor:
        """Measured states (T1, S, N, *state) and windows (T1, S, N, *observed) → what lies between them in units of the
        noise, (S, N, M)."""
        observed = states_of(self.system, observed)
        counts = self.counts.T.view(len(self.t), 1, 1, -1, *[1] * (len(self.system.state_shape) - 1))
        states = torch.where(counts.to(states.device), states, observed)
        difference, _ = differences(self.system, states, observed)
        difference = difference / self.observed_noise
        if not self.transform.start.size:
            difference = difference[1:]
        return difference.movedim(0, 2).flatten(2)

    def missing(self, windows: Tensor) -> Tensor:
        """How many of the numbers that windows (T1, S, B, *observed) are compared at were not measured, (S, B)."""
        windows = states_of(self.system, windows)
        counts = self.counts.T.view(len(self.t), 1, 1, -1, *[1] * (len(self.system.state_shape) - 1))
        gaps = torch.isnan(self.system.observe(torch.where(counts, windows, torch.zeros_like(windows))))
        gaps = gaps if self.transform.start.size else gaps[1:]
        return gaps.movedim(0, 2).flatten(2).sum(-1)

    @property
    def pulls(self) -> int:
        """How many residuals of a window are those of :meth:`pull`."""
        return self.sizes[1] + (0 if self.population is None else self.population.size)

    def pull(self, x: Tensor) -> Tensor:
        """Residuals of what is known of windows' parameters (S, N, K) beforehand: of z_a's prior, (S, N, Q), and after
        them of the distributions of R expert parameters."""
        p, q, _ = self.sizes
        latent = x[..., p : p + q] / self.settings.latent_width
        if self.population is None:
            return latent
        expert = self.population.residuals(self.expert.z_e(x[..., :p]))
        return torch.cat((latent, self.overdispersion.sqrt().view(-1, 1, 1) * expert), dim=-1)

    def parts(self, x: Tensor, y0: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Parameters (S, N, K) and observed first points (S, N, *state) → z_e, z_a, first points."""
        z_e, z_a, y0 = self.transform.unpack(x, y0)
        return z_e, z_a.expand(*x.shape[:2], -1), y0

    def coordinates(self, first: Estimates, y0: Tensor) -> Tensor:
        """The parameters (S, B, K) of first estimates: what cannot be one, zero or no number, is moved near."""
        assert first.z_e is not None and first.z_a is not None
        latent = self.transform.latent.coordinates(first.z_a.double())
        return self.transform.pack(first.z_e.double(), latent, first.y0.double(), y0).nan_to_num(0.0, 0.0, 0.0)

    def _grid(self, prior: Mapping[str, tuple[float, float]]) -> Tensor:
        """Starts (C, K) that fill the prior's box evenly, z_a as in training, the first point as observed, or where it
        was not, anywhere in its range."""
        names = [p.name for p in self.system.expert_parameters]
        if sorted(prior) != sorted(names):
            raise InputError("refinement", f"a prior of {sorted(prior)}", f"give a range for each of {names}")
        low, high = (torch.tensor([float(prior[n][end]) for n in names], dtype=torch.float64) for end in (0, 1))
        p, q, start = self.sizes
        sought = start if self.transform.start.middle is not None else 0
        if p + q + sought == 0:  # all that is sought is noise around the observed first point
            return torch.zeros(1, start, dtype=torch.float64)
        sobol = torch.quasirandom.SobolEngine(p + q + sought, scramble=True, seed=0)
        unit = sobol.draw(self.settings.starts, dtype=torch.float64)
        raw = self.expert.coordinates(low + (high - low) * _spread_over(unit[:, :p], self.expert.own, len(low)))
        latent = torch.special.ndtri(unit[:, p : p + q].clamp(0.02, 0.98))
        first = 2 * unit[:, p + q :] - 1 if sought else raw.new_zeros(len(raw), start)
        return torch.cat((raw, latent, first), 1)

    def best_of_grid(self, windows: Tensor) -> Tensor:
        """The starts that fit each window best, (S, B, tries, K)."""
        assert self.grid is not None
        seeds, count = windows.shape[1:3]
        costs, each = [], max(1, MEMORY // max(windows.numel() * 8, 1))
        for part in self.grid.split(each):
            x = part[:, None, None].expand(-1, seeds, count, -1)
            costs.append(self.residuals(x, windows).square().sum(-1).nan_to_num(torch.inf))
        best = torch.cat(costs).topk(self.tries, dim=0, largest=False).indices
        return self.grid[best.movedim(0, -1)]


def _spread_over(values: Tensor, places: Tensor, size: int) -> Tensor:
    """Columns (C, K) at their places among (C, size) columns, the others in the middle of [0, 1]."""
    return torch.full((len(values), size), 0.5, dtype=values.dtype).index_copy(-1, places, values)


def assumed_noise(settings: RefinementSettings, noise: NoiseLike, bound: Sequence[float]) -> NoiseLike:
    """Standard deviation of the observation: the settings', the data's ``noise``, or, where there is none, a small part
    of the largest value that the stored ``bound`` (K,) is made of."""
    std = settings.noise if "noise" in settings.model_fields_set else noise
    if std is None or isinstance(std, int | float):
        return std or SMALLEST * max(bound) / FACTOR
    return [value or SMALLEST * end / FACTOR for value, end in zip(std, bound, strict=True)]


def _first_point(
    system: System, noise: NoiseLike, free_start: bool, ranges: Mapping[str, Sequence[float]] | None
) -> FirstPointCoordinates:
    """Of a first point that is noisy, or of which components may not be measured."""
    scales = shape_as_state(noise, torch.zeros(0, dtype=torch.float64), system)
    if ranges is not None:
        # In single precision as ever, which the bits of fits of windows with gaps depend on.
        scales = torch.as_tensor(scales)
    if isinstance(scales, Tensor):
        each = scales.flatten().expand(len(system.state)).tolist()
    else:
        each = [scales] * len(system.state)
    chosen = given_components(system) if free_start else torch.zeros(len(system.state), dtype=torch.bool)
    chosen = chosen if ranges is None else free_components(system)
    components = chosen.nonzero().flatten().tolist()
    middle, width = (None, None) if ranges is None else (ends.tolist() for ends in ends_of(ranges))
    return FirstPointCoordinates(system.state_shape, components, [each[k] for k in components], middle, width)


def _counts(system: System, t: Tensor, windows: Mapping[str, tuple[float, float]]) -> Tensor:
    """At which times each component counts, (K, T1); the first point always does."""
    names = [p.name for p in system.state]
    counts = torch.ones(len(names), len(t), dtype=torch.bool)
    for name, (start, end) in windows.items():
        if name not in names:
            raise InputError("refinement.windows", f"names {name}", f"the state is {', '.join(names)}")
        counts[names.index(name)] = (t >= start - 1e-9) & (t <= end + 1e-9)
    counts[:, 0] = True
    return counts

"""The least-squares problem of observed windows: parameters of (z_e, z_a, y0), residuals, and starts."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence

import torch
from torch import Tensor

from expertaug.errors import InputError
from expertaug.inference.latent import Latent
from expertaug.inference.levenberg_marquardt import LONGEST
from expertaug.learning.divergence import FACTOR, solved
from expertaug.learning.residuals import differences
from expertaug.models.decoder import Decoder, TruthDecoder
from expertaug.models.gaps import ends_of
from expertaug.models.observation_noise import NoiseLike, of_observed, shaped
from expertaug.models.posterior import Estimates
from expertaug.models.settings import RefinementSettings
from expertaug.systems import System
from expertaug.systems.inputs import inputs_of, states_of
from expertaug.systems.solvers.solver import Solver

SMALLEST = 1e-3  # of the largest value of the training set: the noise that is assumed where data have none
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
        latent: Latent,
        solver: Solver,
        ranges: Mapping[str, Sequence[float]] | None = None,
    ) -> None:
        system = decoder.system
        self.decoder = copy.deepcopy(decoder).cpu().double().requires_grad_(False).eval()
        self.system, self.settings, self.latent, self.solver = system, settings, latent, solver
        self.noise = shaped(noise, torch.zeros(0, dtype=torch.float64), system)
        self.observed_noise = of_observed(noise, system)
        self.ranges = None if ranges is None else ends_of(ranges)
        self.t = t.double()
        self.scale = torch.tensor([p.scale for p in system.expert_parameters], dtype=torch.float64)
        self.positive = torch.tensor([p.positive for p in system.expert_parameters], dtype=torch.bool)
        self.start = given_components(system) if free_start else torch.zeros(len(system.state), dtype=torch.bool)
        if ranges is not None:
            self.start = free_components(system)
        self.counts = _counts(system, self.t, settings.windows if "windows" in settings.model_fields_set else {})
        self.sizes = (len(self.scale), latent.size, int(self.start.sum()))
        # A first point may be several standard deviations off, and its residuals are nearly linear in it.
        longest = torch.full((sum(self.sizes),), LONGEST, dtype=torch.float64)
        if isinstance(decoder, TruthDecoder):  # its z_a means the same far from the training windows
            longest[len(self.scale) : len(self.scale) + latent.size] = FREE
        longest[len(longest) - self.sizes[2] :] = FARTHEST
        self.longest = longest
        self.grid = None if prior is None or not settings.starts else self._grid(prior)

    @property
    def tries(self) -> int:
        """Points of the grid from which a window is fitted, at most."""
        return 0 if self.grid is None else min(self.settings.tries, len(self.grid))

    @property
    def observations(self) -> int:
        """Observed numbers that a window is compared at."""
        seen = seen_components(self.system)[:, None] & self.counts
        each = seen if self.start.any() else seen[:, 1:]  # a known first point has no residual
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
        """The observed first points (S, N, *state) of windows (T1, S, N, *observed)."""
        return states_of(self.system, windows[0])

    def states(self, x: Tensor, windows: Tensor) -> Tensor:
        """Forecasts (T1, S, N, *state) with parameters (S, N, K), from the first points and with the known inputs of
        windows (T1, S, N, *observed)."""
        z_e, z_a, start = self.parts(x, self.first(windows))
        u = inputs_of(self.system, windows)
        return solved(self.decoder, start, z_e, z_a, self.t, self.solver, u)  # type: ignore[arg-type]

    def differences(self, states: Tensor, observed: Tensor) -> Tensor:
        """States (T1, S, N, *state) and windows (T1, S, N, *observed) → what lies between them in units of the noise,
        (S, N, M)."""
        observed = states_of(self.system, observed)
        counts = self.counts.T.view(len(self.t), 1, 1, -1, *[1] * (len(self.system.state_shape) - 1))
        states = torch.where(counts.to(states.device), states, observed)
        difference, _ = differences(self.system, states, observed)
        difference = difference / self.observed_noise
        if not self.start.any():
            difference = difference[1:]
        return difference.movedim(0, 2).flatten(2)

    def missing(self, windows: Tensor) -> Tensor:
        """How many of the numbers that windows (T1, S, B, *observed) are compared at were not measured, (S, B)."""
        windows = states_of(self.system, windows)
        counts = self.counts.T.view(len(self.t), 1, 1, -1, *[1] * (len(self.system.state_shape) - 1))
        gaps = torch.isnan(self.system.observe(torch.where(counts, windows, torch.zeros_like(windows))))
        gaps = gaps if self.start.any() else gaps[1:]
        return gaps.movedim(0, 2).flatten(2).sum(-1)

    def _first(self, y0: Tensor) -> tuple[Tensor, Tensor | float]:
        """What first points (…, *state) are sought around, and in which units."""
        if self.ranges is None:
            return y0, self.noise
        unknown, (middle, width) = torch.isnan(y0), self.ranges
        return torch.where(unknown, middle, y0), torch.where(unknown, width, torch.as_tensor(self.noise).to(y0))

    def pull(self, x: Tensor) -> Tensor:
        """Residuals of z_a's prior at parameters (S, N, K): (S, N, Q)."""
        return x[..., self.sizes[0] : self.sizes[0] + self.sizes[1]] / self.settings.latent_width

    def parts(self, x: Tensor, y0: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Parameters (S, N, K) and observed first points (S, N, *state) → z_e, z_a, first points."""
        raw, latent, start = x.split(self.sizes, dim=-1)
        z_e = self.scale * torch.where(self.positive, raw.exp(), raw)
        z_a = self.latent.z_a(latent)
        if self.start.any() or self.ranges is not None:
            y0, unit = self._first(y0)
            y0 = y0.clone()
            y0[..., self.start] += self._of_start(unit) * start
        return z_e, z_a.expand(*x.shape[:2], -1), y0

    def coordinates(self, first: Estimates, y0: Tensor) -> Tensor:
        """The parameters (S, B, K) of first estimates: what cannot be one, zero or no number, is moved near."""
        assert first.z_e is not None and first.z_a is not None
        size = first.z_e.double() / self.scale
        raw = torch.where(self.positive, size.clamp_min(1e-3).log(), size)
        latent = self.latent.coordinates(first.z_a.double())
        start = raw[..., :0]
        if self.start.any():
            around, unit = self._first(y0)
            start = (first.y0.double() - around)[..., self.start] / self._of_start(unit)
        return torch.cat((raw, latent, start), -1).nan_to_num(0.0, 0.0, 0.0)

    def _of_start(self, unit: Tensor | float) -> Tensor | float:
        """Of units of all components those of the components that are parameters."""
        return unit[..., self.start] if isinstance(unit, Tensor) else unit

    def _grid(self, prior: Mapping[str, tuple[float, float]]) -> Tensor:
        """Starts (C, K) that fill the prior's box evenly, z_a as in training, the first point as observed, or where it
        was not, anywhere in its range."""
        names = [p.name for p in self.system.expert_parameters]
        if sorted(prior) != sorted(names):
            raise InputError("refinement", f"a prior of {sorted(prior)}", f"give a range for each of {names}")
        low, high = (torch.tensor([float(prior[n][end]) for n in names], dtype=torch.float64) for end in (0, 1))
        p, q, start = self.sizes
        sought = start if self.ranges is not None else 0
        sobol = torch.quasirandom.SobolEngine(p + q + sought, scramble=True, seed=0)
        unit = sobol.draw(self.settings.starts, dtype=torch.float64)
        value = (low + (high - low) * unit[:, :p]) / self.scale
        raw = torch.where(self.positive, value.clamp_min(1e-3).log(), value)
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


def assumed_noise(settings: RefinementSettings, noise: NoiseLike, bound: Sequence[float]) -> NoiseLike:
    """Standard deviation of the observation: the settings', the data's ``noise``, or, where there is none, a small part
    of the largest value that the stored ``bound`` (K,) is made of."""
    given = settings.noise if "noise" in settings.model_fields_set else noise
    if given is None or isinstance(given, int | float):
        return given or SMALLEST * max(bound) / FACTOR
    return [one or SMALLEST * end / FACTOR for one, end in zip(given, bound, strict=True)]


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

"""Least squares of (z_e, z_a, y0) on observed windows through a decoder: multi-start Levenberg–Marquardt."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from expertaug.errors import InputError
from expertaug.inference.levenberg_marquardt import minimise
from expertaug.inference.settings import RefinementSettings
from expertaug.learning.bound import solved
from expertaug.models.decoder import Decoder
from expertaug.models.estimates import Estimates
from expertaug.models.posterior import Gaussian, Posterior, log_slope, unconstrain
from expertaug.systems import System
from expertaug.systems.solver import Solver

MEMORY = 2**26  # bytes of the states that are compared at a time


@dataclass(frozen=True)
class Latent:
    """Where the z_a of the training windows lie: mean and standard deviation, (S, Q) each."""

    mean: Tensor
    std: Tensor

    @classmethod
    def of(cls, description: Mapping) -> Latent:
        """Of a model file's description; the expert alone has none."""
        found = description.get("latent") or {"mean": [[]], "std": [[]]}
        mean, std = (torch.tensor(found[k], dtype=torch.float64) for k in ("mean", "std"))
        return cls(mean, std.clamp_min(1e-6))


class WindowFit:
    """Estimates of (z_e, z_a, y0) for each window, by the least squared residuals of its observed points.

    The parameters of a fit are ln(z_e / scale) where z_e is positive, z_e / scale elsewhere, z_a in standard deviations
    of the training windows, and, where the first point is noisy, its components in standard deviations of the noise.

    Arguments:
        decoder: stacked over S seeds, or without parameters.
        t: times of the observed window in s, (T1,).
        settings: how to fit.
        noise: standard deviation of the observation, > 0.
        free_start: whether the first point is noisy.
        prior: range of each expert parameter in which starts lie; None: only the given first estimates are starts.
        latent: where z_a lies.
        solver: on a fixed grid; another is replaced where it fails.

    Raises:
        InputError: a range or a window of what the system does not have, or no start at all.
    """

    def __init__(
        self,
        decoder: Decoder,
        t: Tensor,
        settings: RefinementSettings,
        noise: float,
        free_start: bool,
        prior: Mapping[str, tuple[float, float]] | None,
        latent: Latent,
        solver: Solver,
    ) -> None:
        system = decoder.system
        self.decoder = copy.deepcopy(decoder).double().requires_grad_(False).eval()
        self.system, self.settings, self.noise, self.latent, self.solver = system, settings, noise, latent, solver
        self.t = t.double()
        self.scale = torch.tensor([p.scale for p in system.expert_parameters], dtype=torch.float64)
        self.positive = torch.tensor([p.positive for p in system.expert_parameters], dtype=torch.bool)
        self.start = given_components(system) if free_start else torch.zeros(len(system.state), dtype=torch.bool)
        self.counts = _counts(system, self.t, settings.windows if "windows" in settings.model_fields_set else {})
        self.sizes = (len(self.scale), latent.mean.shape[-1], int(self.start.sum()))
        self.grid = None if prior is None or not settings.starts else self._grid(prior)

    @property
    def residuals_count(self) -> int:
        """Observed numbers that a window is compared at."""
        seen = seen_components(self.system)[:, None] & self.counts
        each = seen if self.start.any() else seen[:, 1:]  # a known first point has no residual
        cells = 1
        for size in self.system.state_shape[1:]:
            cells *= size
        return int(each.sum()) * cells

    @torch.no_grad()
    def __call__(self, windows: Tensor, first: Estimates | None = None) -> Estimates:
        """Fit windows (T1, S, B, *state), also from the first estimates (…, S, B) where there are some."""
        free = sum(self.sizes)
        tries = (self.settings.tries if self.grid is not None else 0) + (first is not None)
        if not tries:
            raise InputError("refinement.starts", "found 0", "least squares needs a range of starts, or a model's")
        each = windows[:, :, :1].numel() * 8 * tries * (free + 1)
        size = max(1, MEMORY // max(each, 1))
        parts = [
            self._fit(windows[:, :, k : k + size].double(), None if first is None else first.part(slice(k, k + size)))
            for k in range(0, windows.shape[2], size)
        ]
        return Estimates.joined(parts).to(windows)

    def _fit(self, windows: Tensor, first: Estimates | None) -> Estimates:
        seeds, count = windows.shape[1:3]
        x = self._best_of_grid(windows) if self.grid is not None else None  # (S, B, tries, K)
        if first is not None:
            own = self._coordinates(first, windows[0]).unsqueeze(2)
            x = own if x is None else torch.cat((x, own), dim=2)
        assert x is not None
        tries = x.shape[2]

        def residuals(candidates: Tensor, columns: Tensor) -> Tensor:
            return self._residuals(candidates, windows[:, :, torch.div(columns, tries, rounding_mode="floor")])

        found = minimise(residuals, x.flatten(1, 2), self.settings.steps)
        cost = found.cost.view(seeds, count, tries)
        best = cost.argmin(-1, keepdim=True)

        def chosen(value: Tensor) -> Tensor:
            each = value.view(seeds, count, tries, *value.shape[2:])
            index = best.view(seeds, count, 1, *[1] * (each.dim() - 3)).expand(-1, -1, 1, *each.shape[3:])
            return each.gather(2, index).squeeze(2)

        return self._estimates(chosen(found.x), chosen(found.cost), chosen(found.curvature), windows[0])

    def _residuals(self, x: Tensor, windows: Tensor) -> Tensor:
        """x (C, S, B, K), windows (T1, S, B, *state) → (C, S, B, M): residuals in units of the noise, then z_a's."""
        copies, seeds, count = x.shape[:3]
        wide = x.movedim(0, 1).flatten(1, 2)  # (S, C·B, K): the seeds' parameters stay beside the seeds
        observed = windows.repeat(1, 1, copies, *[1] * (windows.dim() - 3))
        z_e, z_a, y0 = self._parts(wide, observed[0])
        states = solved(self.decoder, y0, z_e, z_a, self.t, self.solver)  # type: ignore[arg-type]
        counts = self.counts.T.view(len(self.t), 1, 1, -1, *[1] * (len(self.system.state_shape) - 1))
        states = torch.where(counts.to(states.device), states, observed)
        difference = (self.system.observe(states) - self.system.observe(observed)) / self.noise
        if not self.start.any():
            difference = difference[1:]
        data = difference.movedim(0, 2).flatten(2)
        pull = wide[..., self.sizes[0] : self.sizes[0] + self.sizes[1]] / self.settings.latent_width
        return torch.cat((data, pull), -1).view(seeds, copies, count, -1).movedim(1, 0)

    def _parts(self, x: Tensor, y0: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Parameters (S, N, K) and observed first points (S, N, *state) → z_e, z_a, first points."""
        raw, latent, start = x.split(self.sizes, dim=-1)
        z_e = self.scale * torch.where(self.positive, raw.exp(), raw)
        z_a = self.latent.mean.unsqueeze(1) + self.latent.std.unsqueeze(1) * latent
        if self.start.any():
            y0 = y0.clone()
            y0[..., self.start] += self.noise * start
        return z_e, z_a.expand(*x.shape[:2], -1), y0

    def _coordinates(self, first: Estimates, y0: Tensor) -> Tensor:
        """The parameters (S, B, K) of first estimates: what cannot be one, zero or no number, is moved near."""
        assert first.z_e is not None and first.z_a is not None
        size = first.z_e.double() / self.scale
        raw = torch.where(self.positive, size.clamp_min(1e-3).log(), size)
        latent = (first.z_a.double() - self.latent.mean.unsqueeze(1)) / self.latent.std.unsqueeze(1)
        start = (first.y0.double() - y0)[..., self.start] / self.noise if self.start.any() else raw[..., :0]
        return torch.cat((raw, latent, start), -1).nan_to_num(0.0, 0.0, 0.0)

    def _grid(self, prior: Mapping[str, tuple[float, float]]) -> Tensor:
        """Starts (C, K) that fill the prior's box evenly, z_a as in training, the first point as observed."""
        names = [p.name for p in self.system.expert_parameters]
        if sorted(prior) != sorted(names):
            raise InputError("refinement", f"a prior of {sorted(prior)}", f"give a range for each of {names}")
        low, high = (torch.tensor([float(prior[n][end]) for n in names], dtype=torch.float64) for end in (0, 1))
        p, q, start = self.sizes
        sobol = torch.quasirandom.SobolEngine(p + q, scramble=True, seed=0)
        unit = sobol.draw(self.settings.starts, dtype=torch.float64)
        value = (low + (high - low) * unit[:, :p]) / self.scale
        raw = torch.where(self.positive, value.clamp_min(1e-3).log(), value)
        latent = torch.special.ndtri(unit[:, p:].clamp(0.02, 0.98))
        return torch.cat((raw, latent, raw.new_zeros(len(raw), start)), 1)

    def _best_of_grid(self, windows: Tensor) -> Tensor:
        """The starts that fit each window best, (S, B, tries, K)."""
        assert self.grid is not None
        seeds, count = windows.shape[1:3]
        costs, each = [], max(1, MEMORY // max(windows.numel() * 8, 1))
        for part in self.grid.split(each):
            x = part[:, None, None].expand(-1, seeds, count, -1)
            costs.append(self._residuals(x, windows).square().sum(-1).nan_to_num(torch.inf))
        best = torch.cat(costs).topk(min(self.settings.tries, len(self.grid)), dim=0, largest=False).indices
        return self.grid[best.movedim(0, -1)]

    def _estimates(self, x: Tensor, cost: Tensor, curvature: Tensor, y0: Tensor) -> Estimates:
        """What the best parameters (S, B, K) are, with Laplace's approximation of their posterior."""
        p, q, _ = self.sizes
        z_e, z_a, start = self._parts(x, y0)
        pulled = (x[..., p : p + q] / self.settings.latent_width).square().sum(-1)
        freedom = max(self.residuals_count - p - self.sizes[2], 1)
        size = torch.eye(x.shape[-1], dtype=x.dtype)
        covariance = torch.linalg.pinv(
            curvature + 1e-12 * curvature.diagonal(dim1=-2, dim2=-1).sum(-1)[..., None, None] * size
        )
        std = covariance.diagonal(dim1=-2, dim2=-1).clamp_min(0).sqrt()
        slope = self.scale * torch.where(self.positive, x[..., :p].exp(), torch.ones_like(x[..., :p]))
        parameters = self.system.expert_parameters
        raw = unconstrain(z_e, parameters)
        log_std = (std[..., :p] * slope).clamp_min(1e-30).log() - log_slope(raw, parameters)
        spread = (std[..., p : p + q] * self.latent.std.unsqueeze(1)).clamp_min(1e-30).log()
        posterior = Posterior(Gaussian(raw, log_std, parameters), Gaussian(z_a, spread))
        return Estimates(start, z_e, z_a, posterior, (cost - pulled) / freedom)


def seen_components(system: System) -> Tensor:
    """Which components of a state are observed, (K,)."""
    state = torch.linspace(0.1, 0.2, len(system.state), dtype=torch.float64)
    state = state.view(-1, *[1] * (len(system.state_shape) - 1)).expand(system.state_shape)
    return _felt(system.observe, state)


def given_components(system: System) -> Tensor:
    """Which components (K,) of the first point are observed and not replaced by z_e; none of a field's."""
    if len(system.state_shape) > 1:
        return torch.zeros(len(system.state), dtype=torch.bool)
    z_e = torch.tensor([p.scale for p in system.expert_parameters], dtype=torch.float64)
    state = torch.linspace(0.1, 0.2, len(system.state), dtype=torch.float64)
    return seen_components(system) & _felt(lambda y: system.initial_state(y, z_e), state)


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

"""The distribution of parameters over windows, or over trajectories, by their marginal likelihood (empirical Bayes).

What a unit tells of its parameters φ is quadratic around its estimate v: −log L = s·(φ − v) + (φ − v)ᵀ S (φ − v) / 2.
With φ normal, its components independent, it is integrated over φ in closed form; the product over units is largest at
the estimates of mean and spread, with the term of restricted maximum likelihood for what the mean costs (Patterson &
Thompson 1971).  Residuals of a model that is not quite right are correlated and larger than the noise: the information
is divided by their correlation time (Geyer 1992) and by χ² per degree of freedom (quasi-likelihood, Wedderburn 1974).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from expertaug.models.fit_settings import Population
from expertaug.systems import System

ROBUST = 1.4826  # a normal distribution's standard deviation over its median absolute deviation
STEPS = 200
WIDEST = 1e3  # ends of the search for a spread's error, in first guesses of the spread
BISECTIONS = 30
HALF = 0.5  # of the log-likelihood, at the ends of a 68 % interval


@dataclass(frozen=True)
class Distribution:
    """Of R independent parameters: means and spreads (R,) with their standard errors."""

    mean: Tensor
    mean_std: Tensor
    spread: Tensor
    spread_std: Tensor


@dataclass(frozen=True)
class PopulationPull:
    """Residuals that pull parameters of windows towards the middle of their distribution.

    Attributes:
        places: of the parameters among the expert's.
        logarithmic: (R,), bool: whose logarithm is normal.
        middle, width: (S, 1, R), S = 1 for all seeds alike, of the parameter or of its logarithm; the width has the
            standard errors of middle and spread in it: of few units the likeliest spread is often zero, where it is not
            (Chung et al. 2013).
    """

    places: Sequence[int]
    logarithmic: Tensor
    middle: Tensor
    width: Tensor

    @classmethod
    def of(cls, system: System, population: Mapping[str, Population]) -> PopulationPull:
        """Of estimated distributions by expert parameter."""
        names, each = [p.name for p in system.expert_parameters], list(population.values())
        logarithmic = torch.tensor([estimate.form == "lognormal" for estimate in each])

        def seeds(values: Sequence[float | list[float]]) -> Tensor:
            tensors = [torch.tensor(value, dtype=torch.float64) for value in values]
            return torch.atleast_2d(torch.stack(torch.broadcast_tensors(*tensors), dim=-1)).unsqueeze(1)

        middle, spread = (seeds([getattr(estimate, part).held for estimate in each]) for part in ("middle", "spread"))
        error, of_spread = (seeds([getattr(estimate, part).std for estimate in each]) for part in ("middle", "spread"))
        error = torch.where(logarithmic, error / middle, error)
        width = (spread.square() + of_spread.square() + error.square()).sqrt()
        middle = torch.where(logarithmic, middle.clamp_min(1e-300).log(), middle)
        return cls([names.index(name) for name in population], logarithmic, middle, width)

    @property
    def size(self) -> int:
        """R, the number of residuals of a window."""
        return len(self.places)

    def residuals(self, z_e: Tensor) -> Tensor:
        """Of expert parameters (S, N, P): (S, N, R)."""
        values = z_e[..., list(self.places)]
        values = torch.where(self.logarithmic, values.clamp_min(1e-300).log(), values)
        return (values - self.middle) / self.width.clamp_min(1e-12)


def correlation_time(residuals: Tensor) -> float:
    """1 + 2 Σ ρ_k in points, of residuals (N, T, M) of N windows, by Geyer's initial positive sequence; the longest of
    the M components', at least 1."""
    count = residuals.shape[1]
    lags = [(residuals[:, k:] * residuals[:, : count - k]).mean((0, 1)) for k in range(max(1, count // 2))]
    rho = torch.stack(lags) / lags[0].clamp_min(1e-300)
    pairs = rho[: len(rho) // 2 * 2].unflatten(0, (-1, 2)).sum(1)
    positive = (pairs > 0).long().cumprod(0)
    times = 2 * (pairs * positive).sum(0) - 1
    return max(1.0, float(times.max())) if len(rho) > 1 else 1.0


def overdispersion(residuals: Tensor, freedom: Tensor, rows: int) -> tuple[float, Tensor]:
    """By how much residuals of windows tell less than independent ones of the stated noise would, at least 1: their
    correlation time times the median of the windows' χ² per degree of freedom; and the same with each window's own χ²
    where that is larger, (N,).

    Arguments:
        residuals: in units of the noise, (N, M), by points in time.
        freedom: degrees of freedom, (N,).
        rows: number of points in time.
    """
    if not rows:
        return 1.0, torch.ones(len(residuals), dtype=residuals.dtype)
    residuals = residuals.nan_to_num(0.0, 0.0, 0.0)
    time = correlation_time(residuals.unflatten(1, (rows, -1)))
    chi2 = residuals.square().sum(1) / freedom
    middle = chi2.median()
    return max(1.0, time * float(middle)), (time * chi2.clamp_min(middle)).clamp_min(1.0)


def distribution(curvature: Tensor, slope: Tensor, at: Tensor, clusters: Tensor) -> Distribution:
    """The distribution of R parameters over G units.

    Arguments:
        curvature: S of each unit, (G, R, R), positive semidefinite.
        slope: s, (G, R).
        at: v, where these are taken, (G, R).
        clusters: numbers (G,), from 0 on, of the groups of units that are independent: the mean's error is at least
            what their scatter tells.
    """
    centre = at.median(0).values
    information = curvature.diagonal(dim1=1, dim2=2)
    width = ROBUST * (at - centre).abs().median(0).values
    width = torch.where(width > 0, width, information.sum(0).clamp_min(1e-300).rsqrt())
    curvature, slope = curvature * width[:, None] * width, slope * width
    problem = _Marginal(0.5 * (curvature + curvature.mT), slope, (at - centre) / width)
    size = len(width)
    values = torch.cat((torch.zeros(size, dtype=at.dtype), torch.ones(size, dtype=at.dtype))).requires_grad_()
    optimiser = torch.optim.LBFGS(
        [values], max_iter=STEPS, line_search_fn="strong_wolfe", tolerance_grad=1e-8, tolerance_change=1e-14
    )

    def closure() -> Tensor:
        optimiser.zero_grad()
        loss = problem(*values.split(size))
        loss.backward()
        return loss

    with torch.enable_grad():
        optimiser.step(closure)
    mean, spread = (part.detach() for part in values.split(size))
    spread = spread.abs()
    errors = torch.stack([problem.spread_error(mean, spread, k) for k in range(size)])
    error = torch.maximum(problem.mean_error(spread), problem.clustered_error(mean, spread, clusters))
    return Distribution(centre + width * mean, width * error, width * spread, width * errors)


@dataclass(frozen=True)
class _Marginal:
    """Minus the logarithm of the marginal likelihood of what G units tell."""

    curvature: Tensor
    slope: Tensor
    at: Tensor

    def __call__(self, mean: Tensor, spread: Tensor) -> Tensor:
        return self._of_each(mean, spread).sum() + 0.5 * torch.logdet(self._information(spread))

    def _of_each(self, mean: Tensor, spread: Tensor) -> Tensor:
        """Of each unit, (G,), whose means are (R,), or (G, R)."""
        far = mean - self.at
        inner = self._inner(spread)
        pulled = (self.slope + (self.curvature @ far.unsqueeze(-1)).squeeze(-1)) * spread
        squares = 0.5 * torch.einsum("gi,gij,gj->g", far, self.curvature, far) + (self.slope * far).sum(-1)
        squares = squares - 0.5 * (pulled * torch.linalg.solve(inner, pulled.unsqueeze(-1)).squeeze(-1)).sum(-1)
        return 0.5 * torch.logdet(inner) + squares

    def mean_error(self, spread: Tensor) -> Tensor:
        """Standard errors (R,) of the means."""
        return torch.linalg.inv(self._information(spread)).diagonal().clamp_min(0).sqrt()

    def clustered_error(self, mean: Tensor, spread: Tensor, clusters: Tensor) -> Tensor:
        """The same by how the slopes of groups of units scatter; 0 of a single group, which tells nothing of it."""
        count = int(clusters.max()) + 1
        if count < 2:
            return torch.zeros_like(mean)
        with torch.enable_grad():
            of_each = mean.expand(len(self.at), -1).clone().requires_grad_()
            (slopes,) = torch.autograd.grad(self._of_each(of_each, spread).sum(), of_each)
        slopes = torch.zeros(count, len(mean), dtype=mean.dtype).index_add_(0, clusters, slopes)
        inverse = torch.linalg.inv(self._information(spread))
        scatter = count / (count - 1) * inverse @ (slopes.mT @ slopes) @ inverse
        return scatter.diagonal().clamp_min(0).sqrt()

    def spread_error(self, mean: Tensor, spread: Tensor, k: int) -> Tensor:
        """By how much the k-th spread may be larger within a 68 % interval of its likelihood."""
        least = self(mean, spread)
        low, high = torch.zeros((), dtype=mean.dtype), torch.tensor(WIDEST, dtype=mean.dtype)
        for _ in range(BISECTIONS):
            middle = 0.5 * (low + high)
            moved = spread.clone()
            moved[k] += middle
            if self(mean, moved) - least > HALF:
                high = middle
            else:
                low = middle
        return high

    def _inner(self, spread: Tensor) -> Tensor:
        return torch.eye(len(spread), dtype=spread.dtype) + self.curvature * spread[:, None] * spread

    def _information(self, spread: Tensor) -> Tensor:
        """Of all units on the means, (R, R)."""
        scaled = self.curvature * spread
        lost = scaled @ torch.linalg.solve(self._inner(spread), scaled.mT)
        least = 1e-12 * torch.eye(len(spread), dtype=spread.dtype)
        return (self.curvature - lost).sum(0) + least

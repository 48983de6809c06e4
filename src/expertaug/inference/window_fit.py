"""Least squares of (z_e, z_a, y0) on observed windows through a decoder: multi-start Levenberg–Marquardt."""

from __future__ import annotations

import torch
from torch import Tensor

from expertaug.errors import InputError
from expertaug.inference.levenberg_marquardt import Minimum, minimise
from expertaug.inference.window_problem import MEMORY, WindowProblem
from expertaug.models.posterior import Estimates, Gaussian, Posterior, log_slope, unconstrain

WIDEST = 3.0  # of Laplace's approximation in any direction of the coordinates: far from the fit it says nothing


class WindowFit(WindowProblem):
    """Estimates of (z_e, z_a, y0) for each window, by the least squared residuals of its observed points."""

    @torch.no_grad()
    def __call__(self, windows: Tensor, first: Estimates | None = None) -> Estimates:
        """Fit windows (T1, S, B, *observed), also from the first estimates (…, S, B) where there are some.

        The fits run on the CPU, in double precision, wherever the windows lie.
        """
        here = windows.cpu()
        first = None if first is None else first.to(here)
        free = sum(self.sizes)
        if self.grid is None and first is None:
            raise InputError("refinement.starts", "found 0", "least squares needs a range of starts, or a model's")
        each = windows[:, :, :1].numel() * 8 * (free + 1)
        size = max(1, MEMORY // max(each, 1))
        parts = [
            self._fit(here[:, :, k : k + size].double(), None if first is None else first.part(slice(k, k + size)))
            for k in range(0, windows.shape[2], size)
        ]
        return Estimates.joined(parts).to(windows)

    def _fit(self, windows: Tensor, first: Estimates | None) -> Estimates:
        starts = None if first is not None else self.best_of_grid(windows)
        x = self.coordinates(first, self.first(windows)) if starts is None else starts[:, :, 0]
        found = self._minimum(x, windows)
        wanting = ~self._sufficient(found, windows)
        seeds = torch.arange(len(wanting)).unsqueeze(-1)
        for k in range(0 if first is not None else 1, self.tries):
            if not wanting.any():
                break
            # Each seed's own windows first, so many as the seed with most has: the others try for nothing.
            place = wanting.int().argsort(dim=1, descending=True, stable=True)[:, : int(wanting.sum(1).max())]
            part = windows[:, seeds, place]
            if starts is None:
                starts = found.x.new_zeros(*wanting.shape, self.tries, found.x.shape[-1])
                starts[seeds, place] = self.best_of_grid(part)
            further = self._minimum(starts[seeds, place, k], part)
            before = found.cost[seeds, place]
            better = wanting[seeds, place] & (further.cost < before)
            for value, other in zip(vars(found).values(), vars(further).values(), strict=True):
                chosen = better.view(*better.shape, *[1] * (value.dim() - 2))
                value[seeds, place] = torch.where(chosen, other, value[seeds, place])
            again = (further.cost - before).abs() <= self.settings.agreement * torch.minimum(before, further.cost)
            wanting[seeds, place] &= ~(again | self._sufficient(further, part))
        return self._estimates(found.x, found.cost, found.curvature, windows)

    def _minimum(self, x: Tensor, windows: Tensor) -> Minimum:
        """The minima that are reached from starts (S, B, K)."""

        def residuals(candidates: Tensor, columns: Tensor) -> Tensor:
            return self.residuals(candidates, windows[:, :, columns])

        return minimise(residuals, x, self.settings.steps, self.longest)

    def _sufficient(self, found: Minimum, windows: Tensor) -> Tensor:
        """Whether minima (S, B) explain their windows within the noise."""
        squares = found.cost - self._pulled(found.x)
        return torch.special.gammainc(self._freedom(windows) / 2, squares / 2) <= self.settings.sufficient

    def _freedom(self, windows: Tensor) -> Tensor:
        return (self.observations - self.missing(windows) - self.sizes[0] - self.sizes[2]).clamp_min(1)

    def _pulled(self, x: Tensor) -> Tensor:
        """What z_a's prior adds to the sum of squares at parameters (S, B, K)."""
        return self.pull(x).square().sum(-1)

    def _estimates(self, x: Tensor, cost: Tensor, curvature: Tensor, windows: Tensor) -> Estimates:
        """What the best parameters (S, B, K) are, with Laplace's approximation of their posterior."""
        p, q, _ = self.sizes
        z_e, z_a, start = self.parts(x, self.first(windows))
        size = torch.eye(x.shape[-1], dtype=x.dtype)
        covariance = torch.linalg.pinv(
            curvature + 1e-12 * curvature.diagonal(dim1=-2, dim2=-1).sum(-1)[..., None, None] * size
        )
        std = covariance.diagonal(dim1=-2, dim2=-1).clamp_min(0).sqrt()
        squares, axes = torch.linalg.eigh(0.5 * (covariance + covariance.mT))
        root = axes * squares.clamp(0.0, WIDEST**2).sqrt().unsqueeze(-2)
        slope = self.scale * torch.where(self.positive, x[..., :p].exp(), torch.ones_like(x[..., :p]))
        parameters = self.system.expert_parameters
        raw = unconstrain(z_e, parameters)
        log_std = (std[..., :p] * slope).clamp_min(1e-30).log() - log_slope(raw, parameters)
        spread = self.latent.spread(std[..., p : p + q]).clamp_min(1e-30).log()
        misfit = (cost - self._pulled(x)) / self._freedom(windows)
        posterior = Posterior(Gaussian(raw, log_std, parameters), Gaussian(z_a, spread))
        return Estimates(start, z_e, z_a, posterior, misfit, root=root)

    @torch.no_grad()
    def draws(self, found: Estimates, first: Tensor, normal: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """z_e (K, S, B, P), z_a (K, S, B, Q) and y0 (K, S, B, *state) of Laplace's approximation.

        Arguments:
            found: of this fit.
            first: observed first points (S, B, *state).
            normal: standard normal numbers (S, K, B, D), D the number of coordinates.
        """
        seeds, count = normal.shape[:2]
        here, y0 = found.to(first.cpu().double()), first.cpu().double()
        assert here.root is not None
        x = self.coordinates(here, y0).unsqueeze(1) + torch.einsum("sbij,skbj->skbi", here.root, normal.cpu().double())
        y0 = y0.unsqueeze(1).expand(-1, count, *y0.shape[1:]).flatten(1, 2)
        parts = self.parts(x.flatten(1, 2), y0)
        z_e, z_a, start = (part.unflatten(1, (count, -1)).transpose(0, 1).to(first) for part in parts)
        return z_e, z_a.expand(-1, seeds, *z_a.shape[2:]), start

"""What an estimator makes of observed windows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import torch
from torch import Tensor

from expertaug.models.posterior import Delta, Gaussian, Posterior


@dataclass(frozen=True)
class Estimates:
    """Where a forecast starts and with which parameters.

    Attributes:
        y0: the known first point, (…, B, *state).
        z_e: expert parameters (…, B, P), in their units; None where nothing is estimated.
        z_a: latent of the interaction model, (…, B, Q); None where nothing is estimated.
        posterior: the distribution that z_e and z_a are the means of, where the estimator has one.
        chi2: how well they fit each window, (…, B), where the estimator has compared them with it.
        draws: of the posterior of z_e, z_a and y0, each (…, B, K, ·), where the estimator's forecast is their mean.
        root: a matrix (…, B, D, D) whose square is the covariance of a fit's D coordinates (Laplace's approximation).
    """

    y0: Tensor
    z_e: Tensor | None
    z_a: Tensor | None
    posterior: Posterior | None = None
    chi2: Tensor | None = None
    draws: tuple[Tensor, Tensor, Tensor] | None = None
    root: Tensor | None = None

    def part(self, samples: slice | Tensor) -> Estimates:
        """Estimates (S, B, …) of some samples, by a slice or their places; ``chi2`` and the posterior with them."""
        return self._each(lambda value: value[:, samples])

    def to(self, like: Tensor) -> Estimates:
        """The same in another tensor's type and on its device."""
        return self._each(lambda value: value.to(like))

    def expand(self, seeds: int) -> Estimates:
        """Those of one seed (1, B, …) for each of S seeds that share them: (S, B, …)."""
        return self._each(lambda value: value.expand(seeds, *value.shape[1:]))

    @staticmethod
    def joined(parts: Sequence[Estimates]) -> Estimates:
        """Estimates (S, B, …) of parts of a set of samples, one after the other."""
        if len(parts) == 1:
            return parts[0]
        each = [iter(_tensors(part)) for part in parts]
        return parts[0]._each(lambda _: torch.cat([next(one) for one in each], dim=1))

    def _each(self, change: Callable[[Tensor], Tensor]) -> Estimates:
        """The same with every tensor changed, in the order of :func:`_tensors`."""

        def changed(value: Tensor | None) -> Tensor | None:
            return None if value is None else change(value)

        found = {name: changed(getattr(self, name)) for name in ("y0", "z_e", "z_a", "chi2", "root")}
        posterior = self.posterior
        if posterior is not None:
            posterior = replace(posterior, z_e=_changed(posterior.z_e, change), z_a=_changed(posterior.z_a, change))
            posterior = replace(posterior, z_a_used=changed(posterior.z_a_used), filtered=None)
        draws = None if self.draws is None else tuple(change(value) for value in self.draws)
        return replace(self, **found, posterior=posterior, draws=draws)


def _changed(one: Delta | Gaussian, change: Callable[[Tensor], Tensor]) -> Delta | Gaussian:
    if isinstance(one, Gaussian):
        return Gaussian(change(one.loc), change(one.log_std), one.parameters)
    return Delta(change(one.loc), one.scale)


def _tensors(one: Estimates) -> list[Tensor]:
    found: list[Tensor] = []
    one._each(lambda value: (found.append(value), value)[1])
    return found


class Estimator(Protocol):
    """Anything that reads (y0, z_e, z_a) off observed windows: an encoder, least squares, a flow."""

    def estimate(self, windows: Tensor) -> Estimates:
        """Observed windows (T1, …, B, *state) → estimates."""
        ...

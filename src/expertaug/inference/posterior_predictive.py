"""Posterior predictive forecasts: draws from what an estimator says of each window, their forecasts, and quantiles."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import torch
from torch import Tensor

from expertaug.errors import InputError
from expertaug.learning.divergence import BoundedSolver, clamp_to_bound, solve_with_sample_fallback
from expertaug.learning.random_streams import RandomStreams
from expertaug.models.decoder import Decoder
from expertaug.models.posterior import Estimates, Gaussian, Predictor, constrain
from expertaug.systems import System
from expertaug.systems.solvers.solver import Solver
from expertaug.windows import Windows

CHUNK_BYTES = 2**27  # of the forecasts made at a time
COUNT = 119  # so that intervals of 50 % and 90 % end at draws
DRAWS = 6  # of the keys of random numbers


class Sampler(Protocol):
    """An estimator with a distribution over (z_e, z_a, y0)."""

    bound: Tensor | None

    @property
    def system(self) -> System: ...

    @property
    def decoder(self) -> Decoder: ...

    def sample(self, windows: Windows, count: int, seed: int | None = None) -> tuple[Tensor, Tensor, Tensor]:
        """Windows, y (T1, S, B, *state) → z_e (K, S, B, P), z_a (K, S, B, Q), y0 (K, S, B, *state)."""
        ...


@runtime_checkable
class JointPosterior(Protocol):
    """An estimator that draws from its joint distribution of (z_e, z_a, y0) itself."""

    def joint_draws(
        self, estimates: Estimates, windows: Windows, count: int, random: RandomStreams
    ) -> tuple[Tensor, Tensor, Tensor]:
        """As :func:`joint_draws`."""
        ...


@dataclass(frozen=True)
class Predictive:
    """What a posterior says of B windows.

    Attributes:
        mean: of the forecasts, (T, S, B, *state): what minimises the expected squared error.
        quantiles: of every value on its own, (L, T, S, B, *state), in the order of the levels asked for.
        samples: (K, T, S, B, *state), where they were asked for.
        z_e, z_a: the draws (K, S, B, ·) that they start from.
    """

    mean: Tensor
    quantiles: Tensor
    samples: Tensor | None
    z_e: Tensor
    z_a: Tensor


@torch.no_grad()
def predictive(
    estimator: Sampler,
    windows: Windows,
    solver: Solver,
    count: int,
    levels: Sequence[float] = (0.05, 0.95),
    seed: int | None = None,
    keep: bool = False,
    pooled: bool = False,
) -> Predictive:
    """Forecast every window from draws of its posterior; a forecast that runs away is cut off at the bound.

    Arguments:
        windows: observed, y (T1, S, B, *state), with all times of the forecasts and the known inputs then.
        count: K, draws of each window.
        levels: of the quantiles, in (0, 1).
        seed: of the draws; None: evenly spread points, the same for every window.
        keep: whether to return the samples.
        pooled: whether all seeds' draws are one posterior's: of one seed with S·K draws.
    """
    z_e, z_a, y0 = estimator.sample(windows, count, seed)
    t, u = windows.t, windows.u
    seeds, samples, each = y0.shape[1], y0.shape[2], y0[0, 0, 0].numel() * y0.element_size()
    size = max(CHUNK_BYTES // (count * seeds * len(t) * each), 1)
    at = torch.tensor(levels, dtype=y0.dtype, device=y0.device)
    means, quantiles, kept = [], [], []
    for start in range(0, samples, size):
        part = slice(start, start + size)
        draws, inputs = [x[:, :, part] for x in (y0, z_e, z_a)], None if u is None else u[:, :, part]
        y = forecasts(estimator.decoder, *draws, t, solver, estimator.bound, inputs)
        if pooled:
            y = _pool(y, 2)
        means.append(y.mean(0))
        quantiles.append(torch.quantile(y, at, dim=0))
        kept += [y] if keep else []
    if pooled:
        z_e, z_a = _pool(z_e, 1), _pool(z_a, 1)
    return Predictive(
        torch.cat(means, dim=2), torch.cat(quantiles, dim=3), torch.cat(kept, dim=3) if keep else None, z_e, z_a
    )


@torch.no_grad()
def mean_forecast(
    decoder: Decoder,
    z_e: Tensor,
    z_a: Tensor,
    y0: Tensor,
    t: Tensor,
    solver: Solver | BoundedSolver,
    bound: Tensor | None,
    u: Tensor | None = None,
) -> Tensor:
    """Mean (T, S, B, *state) of the forecasts from draws (K, S, B, ·), a part of the draws at a time."""
    total = sum(
        forecasts(decoder, y0[part], z_e[part], z_a[part], t, solver, bound, u).sum(0) for part in _parts(y0, len(t))
    )
    return total / len(y0)


def forecasts(
    decoder: Decoder,
    y0: Tensor,
    z_e: Tensor,
    z_a: Tensor,
    t: Tensor,
    solver: Solver | BoundedSolver,
    bound: Tensor | None,
    u: Tensor | None = None,
) -> Tensor:
    """Forecasts (K, T, S, B, *state) from draws y0 (K, S, B, *state), z_e (K, S, B, P) and z_a (K, S, B, Q), bounded.

    Arguments:
        bound: (C,) for the components of a state, or (B, C).
        u: known inputs (T, S, B, U), the same for every draw.
    """
    draws = len(y0)

    def of(windows: slice, stopping: BoundedSolver) -> Tensor:
        flat = [x[:, :, windows].transpose(0, 1).flatten(1, 2) for x in (y0, z_e, z_a)]  # (S, K·B, …)
        inputs = None if u is None else u[:, :, windows].repeat(1, 1, draws, 1)
        return decoder.forecast(*flat, t, stopping, inputs).unflatten(2, (draws, -1))  # type: ignore[arg-type]

    y, _ = solve_with_sample_fallback(of, y0.shape[2], solver, bound, axis=3)  # (T, S, K, B, *state)
    limit = bound if bound is None or bound.dim() == 1 else bound.repeat(draws, 1)
    return clamp_to_bound(y.flatten(2, 3), limit).unflatten(2, (draws, -1)).movedim(2, 0)


def _pool(draws: Tensor, axis: int) -> Tensor:
    """Draws (K, …, S, …) with the seeds' axis as those of one seed, (S·K, …, 1, …)."""
    return draws.movedim(axis, 0).flatten(0, 1).unsqueeze(axis)


def _parts(y0: Tensor, times: int) -> Iterator[slice]:
    """Slices of the draws whose forecasts fit into the memory."""
    size = max(CHUNK_BYTES // (y0[0].numel() * y0.element_size() * times), 1)
    return (slice(k, k + size) for k in range(0, len(y0), size))


def z_e_draws(estimates: Estimates, count: int = COUNT) -> Tensor | None:
    """Draws of z_e (S, B, K, P), in its units, evenly spread (Sobol); None where the estimator has a point alone.

    Arguments:
        estimates: of windows; a flow's have draws of their own, as many as it was asked for.
        count: K, for a Gaussian.
    """
    if estimates.draws is not None:
        return estimates.draws[0]
    if estimates.posterior is None or not isinstance(estimates.posterior.z_e, Gaussian):
        return None
    q = estimates.posterior.z_e
    sobol = torch.quasirandom.SobolEngine(q.loc.shape[-1], scramble=True, seed=0)
    normal = torch.special.ndtri(sobol.draw(count, dtype=torch.float64).clamp(1e-9, 1 - 1e-9)).to(q.loc)
    raw = q.loc.unsqueeze(-2) + q.log_std.exp().unsqueeze(-2) * normal
    return raw if q.parameters is None else constrain(raw, q.parameters)


@torch.no_grad()
def joint_draws(
    model: Predictor, estimates: Estimates, windows: Windows, count: int, random: RandomStreams
) -> tuple[Tensor, Tensor, Tensor] | None:
    """Independent draws of (z_e, z_a, y0) for each window: of a flow, of Laplace's approximation of a fit, or of an
    encoder's Gaussian (whose first point is the observed one); None where the estimator has a point alone.

    Arguments:
        model: an estimator, which gave ``estimates``.
        windows: observed, y (T1, S, B, *state).
        count: K.
        random: whence they come.

    Returns:
        z_e (K, S, B, P), z_a (K, S, B, Q) and y0 (K, S, B, *state).
    """
    if isinstance(model, JointPosterior):
        return model.joint_draws(estimates, windows, count, random)
    posterior = estimates.posterior
    if posterior is None or not any(isinstance(q, Gaussian) for q in (posterior.z_e, posterior.z_a)):
        return None

    def drawn(q: object, mean: Tensor) -> Tensor:
        if not isinstance(q, Gaussian):
            return mean.expand(count, *mean.shape)
        raw = q.loc + q.log_std.exp() * random.normal(count, *q.loc.shape[1:]).transpose(0, 1).to(q.loc)
        return raw if q.parameters is None else constrain(raw, q.parameters)

    assert estimates.z_e is not None and estimates.z_a is not None
    z_e, z_a = drawn(posterior.z_e, estimates.z_e), drawn(posterior.z_a, estimates.z_a)
    return z_e, z_a, estimates.y0.expand(count, *estimates.y0.shape)


class Drawn:
    """An estimator with a distribution but no draws of its own, as a :class:`Sampler`.

    Arguments:
        model: a fit, or an encoder whose posterior is Gaussian.
        seeds: of the group: what is drawn depends on them alone.
        bound: (C,), how far a forecast's components may go.
    """

    def __init__(self, model: Predictor, seeds: Sequence[int], bound: Tensor | None) -> None:
        self.model, self.seeds, self.bound = model, list(seeds), bound

    @property
    def system(self) -> System:
        return self.model.system  # type: ignore[attr-defined]

    @property
    def decoder(self) -> Decoder:
        return self.model.decoder  # type: ignore[attr-defined]

    def sample(self, windows: Windows, count: int, seed: int | None = None) -> tuple[Tensor, Tensor, Tensor]:
        """As of a flow.

        Raises:
            InputError: the model estimates a point alone.
        """
        estimates = self.model.estimate(windows)  # type: ignore[attr-defined]
        drawn = joint_draws(
            self.model, estimates, windows, count, RandomStreams(self.seeds, 0 if seed is None else seed, DRAWS)
        )
        if drawn is None:
            remedy = "give one of expertaug.fit_posterior, or a refined one"
            raise InputError("model", "estimates a point and has no draws", remedy)
        return drawn

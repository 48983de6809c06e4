"""What an observed window tells: q(z_e, z_a | x, y), estimates by it, and the forecast that follows from them.

Principal axes of the z_a of many windows as well.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import torch
from torch import Tensor, nn
from torch.distributions import Distribution, constraints

from expertaug.systems import Parameter, System
from expertaug.systems.base import constant_like
from expertaug.systems.solvers.solver import Solver
from expertaug.windows import Windows

# normal(k) gives (…, B, k) standard normal numbers: whoever samples says where randomness comes from.
Normal = Callable[[int], Tensor]

LOG_STD, SPREAD = -3.0, 4.0  # standard deviations begin near e⁻³ and stay within e⁻⁷ and e
DEAD = 1e-5  # of the whole: a principal component with a smaller standard deviation does not vary


def bound_log_std(raw: Tensor) -> Tensor:
    """Unbounded outputs (…) → logarithms of standard deviations, bounded smoothly on both sides."""
    return LOG_STD + SPREAD * torch.tanh(raw / SPREAD)


def constrain(raw: Tensor, parameters: Sequence[Parameter]) -> Tensor:
    """Unbounded network outputs (…, P) → parameters in their units: softplus where positive, scaled to their size."""
    scale, positive = _of(parameters, raw)
    return scale * torch.where(positive, nn.functional.softplus(raw), raw)


def unconstrain(value: Tensor, parameters: Sequence[Parameter]) -> Tensor:
    """The inverse of :func:`constrain`; NaN where a positive parameter is not positive."""
    scale, positive = _of(parameters, value)
    size = value / scale
    unit = torch.ones_like(size)
    return size + torch.where(positive, torch.log(-torch.expm1(-torch.where(positive, size, unit))), 0 * unit)


def log_slope(raw: Tensor, parameters: Sequence[Parameter]) -> Tensor:
    """Logarithm of the derivative of :func:`constrain`, (…, P)."""
    scale, positive = _of(parameters, raw)
    return scale.log() + torch.where(positive, nn.functional.logsigmoid(raw), torch.zeros_like(raw))


def _of(parameters: Sequence[Parameter], like: Tensor) -> tuple[Tensor, Tensor]:
    scale = constant_like(like, [p.scale for p in parameters], like.dtype)
    return scale, constant_like(like, [p.positive for p in parameters], torch.bool)


class Delta(Distribution):
    """A point estimate as a distribution: APHYNITY's posterior.

    Its log-density is that of a Gaussian of fixed standard deviation ``scale`` around ``loc``, up to a constant: the
    paper (section 3) supervises z_e with a Gaussian log-density, equal to a mean squared error.

    Arguments:
        loc: (…, K).
        scale: (K,) or a number, > 0.
    """

    arg_constraints = {}  # noqa: RUF012
    support = constraints.real_vector
    has_rsample = True

    def __init__(self, loc: Tensor, scale: Tensor | float = 1.0) -> None:
        self.loc, self.scale = loc, scale
        super().__init__(loc.shape[:-1], loc.shape[-1:], validate_args=False)

    @property
    def mean(self) -> Tensor:
        return self.loc

    def rsample(self, sample_shape: torch.Size = torch.Size()) -> Tensor:  # noqa: B008
        return self.loc.expand(sample_shape + self.loc.shape)

    def draw(self, normal: Normal) -> Tensor:
        """The point, whatever the noise."""
        return self.loc

    def log_prob(self, value: Tensor) -> Tensor:
        """(…,): −½ ‖(value − loc) / scale‖²."""
        return -0.5 * ((value - self.loc) / self.scale).square().sum(-1)

    def log_prob_in(self, value: Tensor, unit: Tensor | float) -> Tensor:
        """(…,): the log-density whose standard deviation is ``unit`` (P,)."""
        return Delta(self.loc, unit).log_prob(value)


class Gaussian(Distribution):
    """Independent Gaussians in an unbounded space, pushed through :func:`constrain`: the hybrid-VAE's posterior.

    Parameters that are positive come out positive, the others Gaussian; without ``parameters`` all stay as they are.

    Arguments:
        loc: (…, K), before the transformation.
        log_std: (…, K), of the same.
        parameters: K of them, or None.
    """

    arg_constraints = {}  # noqa: RUF012
    support = constraints.real_vector
    has_rsample = True

    def __init__(self, loc: Tensor, log_std: Tensor, parameters: Sequence[Parameter] | None = None) -> None:
        self.loc, self.log_std, self.parameters = loc, log_std, parameters
        super().__init__(loc.shape[:-1], loc.shape[-1:], validate_args=False)

    @property
    def mean(self) -> Tensor:
        """The transformed mean: every component's median, and its mean where it is not positive."""
        return self._constrained(self.loc)

    def rsample(self, sample_shape: torch.Size = torch.Size()) -> Tensor:  # noqa: B008
        noise = torch.randn(sample_shape + self.loc.shape, dtype=self.loc.dtype, device=self.loc.device)
        return self._constrained(self.loc + self.log_std.exp() * noise)

    def draw(self, normal: Normal) -> Tensor:
        """A reparameterised sample (…, K) by the given noise."""
        return self._constrained(self.loc + self.log_std.exp() * normal(self.loc.shape[-1]))

    def log_prob(self, value: Tensor) -> Tensor:
        """(…,): log-density at ``value`` (…, K), with the transformation's Jacobian."""
        raw = value if self.parameters is None else unconstrain(value, self.parameters)
        each = -0.5 * ((raw - self.loc) / self.log_std.exp()).square() - self.log_std - 0.5 * math.log(2 * math.pi)
        return (each if self.parameters is None else each - log_slope(raw, self.parameters)).sum(-1)

    def log_prob_in(self, value: Tensor, unit: Tensor | float) -> Tensor:
        """(…,): the log-density of the value counted in ``unit`` (P,) or (…, P), which has no unit itself."""
        unit = torch.as_tensor(unit, dtype=self.loc.dtype).to(self.loc.device, non_blocking=True)
        logs = unit.log().expand(self.loc.shape if unit.dim() > 1 else self.loc.shape[-1:])
        return self.log_prob(value) + logs.sum(-1)

    @property
    def spread(self) -> Tensor:
        """Standard deviation (…, K) of the components, to first order."""
        slope = 0.0 if self.parameters is None else log_slope(self.loc, self.parameters)
        return (self.log_std + slope).exp()

    def divergence(self, mean: Tensor | float = 0.0, std: Tensor | float = 1.0) -> Tensor:
        """(…,): KL divergence to Gaussians of ``mean`` and ``std`` (K,) in the unbounded space (and so in any)."""
        return self.divergences(mean, std).sum(-1)

    def divergences(self, mean: Tensor | float = 0.0, std: Tensor | float = 1.0) -> Tensor:
        """The same of each component, (…, K)."""
        each = (torch.as_tensor(x, dtype=self.loc.dtype) for x in (mean, std))
        mean, std = (x.to(self.loc.device, non_blocking=True) for x in each)
        ratio = ((2 * self.log_std).exp() + (self.loc - mean).square()) / std.square()
        return 0.5 * (ratio - 1) - self.log_std + std.log()

    def _constrained(self, raw: Tensor) -> Tensor:
        return raw if self.parameters is None else constrain(raw, self.parameters)


@dataclass(frozen=True)
class Posterior:
    """What is known of z_e (…, P) and z_a (…, Q) from an observation; each a :class:`Delta` or a :class:`Gaussian`.

    Attributes:
        z_e: its distribution, given ``z_a_used`` where an encoder infers z_a first.
        z_a: its distribution.
        z_a_used: the z_a (…, Q) on which z_e depends; None where it depends on none.
        filtered: the observation as the expert alone could have made it, as the encoder's ``view`` of it (…, B, *seen);
            None where an encoder does not filter.
    """

    z_e: Distribution
    z_a: Distribution
    z_a_used: Tensor | None = None
    filtered: Tensor | None = None

    @property
    def mean(self) -> tuple[Tensor, Tensor]:
        """The means of z_e and z_a, which evaluation uses."""
        return self.z_e.mean, self.z_a.mean


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
        stuck: whether a fit never found a better point than its start and does not explain the window, (…, B), bool.
    """

    y0: Tensor
    z_e: Tensor | None
    z_a: Tensor | None
    posterior: Posterior | None = None
    chi2: Tensor | None = None
    draws: tuple[Tensor, Tensor, Tensor] | None = None
    root: Tensor | None = None
    stuck: Tensor | None = None

    @property
    def z_e_std(self) -> Tensor | None:
        """Standard deviation (…, B, P) of z_e, where the estimator has one: to first order, or of its draws."""
        distribution = None if self.posterior is None else self.posterior.z_e
        if isinstance(distribution, Gaussian):
            return distribution.spread
        return None if self.draws is None else self.draws[0].std(dim=-2, correction=0)

    def stated(self, with_z_a: bool) -> tuple[Tensor, Tensor | None]:
        """z_e, or z_e and z_a behind each other, (…, B, K), and their standard deviations, where there are any."""
        assert self.z_e is not None
        if not with_z_a:
            return self.z_e, self.z_e_std
        assert self.z_a is not None
        other = None if self.posterior is None else self.posterior.z_a
        has_std = self.z_e_std is not None and isinstance(other, Gaussian)
        std = torch.cat((self.z_e_std, other.spread), -1) if has_std else None  # type: ignore[arg-type,union-attr]
        return torch.cat((self.z_e, self.z_a), -1), std

    def part(self, samples: slice | Tensor) -> Estimates:
        """Estimates (S, B, …) of some samples, by a slice or their places; ``chi2`` and the posterior with them."""
        return self._each(lambda value: value[:, samples])

    def to(self, like: Tensor) -> Estimates:
        """The same in another tensor's type and on its device."""
        return self._each(lambda value: value.to(like.device) if value.dtype is torch.bool else value.to(like))

    def expand(self, seeds: int) -> Estimates:
        """Those of one seed (1, B, …) for each of S seeds that share them: (S, B, …)."""
        return self._each(lambda value: value.expand(seeds, *value.shape[1:]))

    @staticmethod
    def joined(parts: Sequence[Estimates]) -> Estimates:
        """Estimates (S, B, …) of parts of a set of samples, one after the other."""
        if len(parts) == 1:
            return parts[0]
        each = [iter(_tensors_of(part)) for part in parts]
        return parts[0]._each(lambda _: torch.cat([next(tensors) for tensors in each], dim=1))

    def _each(self, change: Callable[[Tensor], Tensor]) -> Estimates:
        """The same with every tensor changed, in the order of :func:`_tensors`."""

        def changed(value: Tensor | None) -> Tensor | None:
            return None if value is None else change(value)

        tensors = {name: changed(getattr(self, name)) for name in ("y0", "z_e", "z_a", "chi2", "root", "stuck")}
        posterior = self.posterior
        if posterior is not None:
            posterior = replace(posterior, z_e=_transform(posterior.z_e, change), z_a=_transform(posterior.z_a, change))
            posterior = replace(posterior, z_a_used=changed(posterior.z_a_used), filtered=None)
        draws = None if self.draws is None else tuple(change(value) for value in self.draws)
        return replace(self, **tensors, posterior=posterior, draws=draws)


def _transform(distribution: Delta | Gaussian, change: Callable[[Tensor], Tensor]) -> Delta | Gaussian:
    if isinstance(distribution, Gaussian):
        return Gaussian(change(distribution.loc), change(distribution.log_std), distribution.parameters)
    return Delta(change(distribution.loc), distribution.scale)


def _tensors_of(estimates: Estimates) -> list[Tensor]:
    tensors: list[Tensor] = []
    estimates._each(lambda value: (tensors.append(value), value)[1])
    return tensors


class Estimator(Protocol):
    """Anything that reads (y0, z_e, z_a) off observed windows: an encoder, least squares, a flow."""

    def estimate(self, windows: Windows) -> Estimates:
        """Observed windows → estimates (…, B, ·)."""
        ...


class Predictor:
    """What has ``estimate`` (an :class:`~expertaug.models.posterior.Estimator`) and ``forecast`` (a decoder's)."""

    system: System

    @property
    def knows_z_e(self) -> bool:
        """Whether an estimate of z_e is one of the expert's parameters, which can be compared with their truth: as the
        decoder says, where there is one."""
        decoder = getattr(self, "decoder", None)
        return decoder is not None and decoder.knows_z_e

    def state_of(self, measured: Tensor) -> Tensor:
        """What is measured (…, *state) → the states from which the decoder forecasts; the same but for sensors."""
        decoder = getattr(self, "decoder", None)
        return measured if decoder is None else decoder.state_of(measured)

    def predicted(
        self,
        estimates: Estimates,
        windows: Windows,
        solver: Solver,
        start: str = "y0",
    ) -> Tensor:
        """The forecast that follows from estimates.

        Arguments:
            estimates: of the observed windows.
            windows: observed, with all times of the forecast and the known inputs then.
            start: y0, or y_t1: integrate onwards from the last observed point and return the observation before it.

        Returns:
            states (T, …, B, *state).
        """
        z_e, z_a, t, u = estimates.z_e, estimates.z_a, windows.t, windows.u
        if start == "y0" or z_e is None or windows.has_gaps:  # what was not measured has no rates
            return self.forecast(estimates.y0, z_e, z_a, t, solver, u)  # type: ignore[attr-defined]
        last = windows.points - 1
        later = None if u is None else u[last:]
        onwards = self.forecast(self.state_of(windows.y[last]), z_e, z_a, t[last:], solver, later)  # type: ignore[attr-defined]
        return torch.cat((windows.y[:last], onwards))

    def predict(self, windows: Windows, solver: Solver, start: str = "y0") -> tuple[Tensor, Tensor | None]:
        """The forecast of the estimates from windows, and the estimate of z_e (…, B, P) where :attr:`knows_z_e`; as
        :meth:`predicted`."""
        estimates = self.estimate(windows)  # type: ignore[attr-defined]
        return self.predicted(estimates, windows, solver, start), estimates.z_e if self.knows_z_e else None


def principal_axes(latents: Tensor, components: int) -> Tensor:
    """The first axes (C, Q) of z_a (N, Q), each as long as its standard deviation; zero where nothing varies."""
    spread = (latents - latents.mean(0, keepdim=True)).double()
    squares, columns = torch.linalg.eigh(spread.mT @ spread / max(len(latents) - 1, 1))
    std = squares.flip(0)[:components].clamp_min(0.0).sqrt()
    alive = std > DEAD * squares.clamp_min(0.0).sum().sqrt()
    return columns.mT.flip(0)[:components] * torch.where(alive, std, 0.0).unsqueeze(-1)


def scores_of(deviations: Tensor, axes: Tensor) -> Tensor:
    """Scores (…, N, C), in standard deviations, of deviations from the mean (…, N, Q) along axes (…, C, Q)."""
    squares = axes.square().sum(-1)
    inverse = torch.where(squares > 0, 1 / squares.clamp_min(1e-30), 0.0).unsqueeze(-1) * axes
    return deviations @ inverse.transpose(-1, -2)

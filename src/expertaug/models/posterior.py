"""What an encoder returns: q(z_e, z_a | x, y)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.distributions import Distribution, constraints

from expertaug.systems import Parameter
from expertaug.systems.base import constant_like

# normal(k) gives (…, B, k) standard normal numbers: whoever samples says where randomness comes from.
Normal = Callable[[int], Tensor]


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

    def divergence(self, mean: Tensor | float = 0.0, std: Tensor | float = 1.0) -> Tensor:
        """(…,): KL divergence to Gaussians of ``mean`` and ``std`` (K,) in the unbounded space (and so in any)."""
        each = (torch.as_tensor(x, dtype=self.loc.dtype) for x in (mean, std))
        mean, std = (x.to(self.loc.device, non_blocking=True) for x in each)
        ratio = ((2 * self.log_std).exp() + (self.loc - mean).square()) / std.square()
        return (0.5 * (ratio - 1) - self.log_std + std.log()).sum(-1)

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

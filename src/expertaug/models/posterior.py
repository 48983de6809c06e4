"""What an encoder returns: q(z_e, z_a | x, y)."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.distributions import Distribution, constraints


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

    def log_prob(self, value: Tensor) -> Tensor:
        """(…,): −½ ‖(value − loc) / scale‖²."""
        return -0.5 * ((value - self.loc) / self.scale).square().sum(-1)


@dataclass(frozen=True)
class Posterior:
    """Distributions of z_e (…, P) and z_a (…, Q), independent given the observation."""

    z_e: Distribution
    z_a: Distribution

    def rsample(self) -> tuple[Tensor, Tensor]:
        """One reparameterised sample of each."""
        return self.z_e.rsample(), self.z_a.rsample()

    @property
    def mean(self) -> tuple[Tensor, Tensor]:
        """The means, which evaluation uses."""
        return self.z_e.mean, self.z_a.mean

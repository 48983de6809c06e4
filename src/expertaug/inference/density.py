"""A conditional density of a group of seeds: neural spline flows (Durkan et al. 2019) by zuko."""

from __future__ import annotations

import torch
import zuko
from torch import Tensor, nn

from expertaug.inference.settings import FlowSettings
from expertaug.models.networks.layers import MLP, Linear, Standardise
from expertaug.models.stacking import SeedWise

NARROWEST = 9.0  # standard deviations of a posterior are at least exp(−9) of the prior's
FARTHEST = 10.0  # standard deviations of the draws: a number of a window that no draw is like says no more than that


class Density(nn.Module):
    """q(θ | x): a Gaussian whose location and scale a network gives, bent by splines that see a summary of x as well.

    The Gaussian goes first because posteriors are orders of magnitude narrower than their prior, on which a spline's
    bins lie.  A linear map of x is added to its location.

    Arguments:
        inputs: numbers of x.
        unknowns: numbers of θ, each with a prior about as wide as a standard normal one.
    """

    def __init__(self, inputs: int, unknowns: int, settings: FlowSettings) -> None:
        super().__init__()
        self.unknowns = unknowns
        self.scale = Standardise(inputs)
        self.trunk = MLP(inputs, settings.layers, settings.summary, "silu")
        self.gaussian = MLP(settings.summary, (), 2 * unknowns)
        self.skip = Linear(inputs, unknowns, bias=False)
        nn.init.zeros_(self.skip.weight)
        self.splines = SeedWise(Splines(unknowns, settings), "flow")

    def fit(self, x: Tensor) -> None:
        """Standardise by contexts x (N, inputs)."""
        self.scale.fit(x)

    def log_prob(self, x: Tensor, theta: Tensor) -> Tensor:
        """(S, B) at θ (S, B, D), for contexts x (S, B, inputs)."""
        summary, loc, log_std = self._summary(x)
        bent = (theta - loc) * torch.exp(-log_std)
        (found,) = self.splines.each("log_prob", [bent, summary], [0, 0], lambda value: (value,))
        return found - log_std.sum(-1)

    def sample(self, x: Tensor, normal: Tensor) -> Tensor:
        """θ (K, S, B, D) from standard normal numbers of the same shape, for contexts x (S, B, inputs)."""
        summary, loc, log_std = self._summary(x)
        (bent,) = self.splines.each("sample", [normal, summary], [1, 0], lambda value: (value,))  # (S, K, B, D)
        return loc + log_std.exp() * bent.transpose(0, 1)

    def _summary(self, x: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Summary, location and logarithm of the scale; the latter bounded smoothly."""
        x = self.scale(x).clamp(-FARTHEST, FARTHEST)
        hidden = self.trunk.activation(self.trunk(x))
        loc, raw = self.gaussian(hidden).chunk(2, dim=-1)
        return hidden, loc + self.skip(x), NARROWEST * torch.tanh(raw / NARROWEST)


class Splines(nn.Module):
    """zuko's flow of one seed, with what :class:`SeedWise` calls."""

    def __init__(self, unknowns: int, settings: FlowSettings) -> None:
        super().__init__()
        self.flow = zuko.flows.NSF(
            unknowns,
            settings.summary,
            transforms=settings.transforms,
            hidden_features=settings.hidden,
            bins=settings.bins,
        )

    def log_prob(self, u: Tensor, context: Tensor) -> Tensor:
        """(B,) at u (B, D) for contexts (B, C)."""
        return self.flow(context).log_prob(u)

    def sample(self, normal: Tensor, context: Tensor) -> Tensor:
        """Samples (K, B, D) from standard normal numbers."""
        return self.flow.transform(context.expand(len(normal), *context.shape)).inv(normal)

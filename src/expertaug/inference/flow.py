"""Posteriors by conditional normalising flows: what one sees of a window, its density, and the estimator.

The density is a neural spline flow (Durkan et al. 2019) by zuko.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import torch
import zuko
from torch import Tensor, nn

from expertaug.inference.coordinates import PriorTransform, widen_box
from expertaug.inference.posterior_predictive import mean_forecast
from expertaug.inference.settings import FlowSettings
from expertaug.learning.augment import prior_ends
from expertaug.learning.divergence import BoundedSolver, bound_of_card
from expertaug.learning.random_streams import RandomStreams
from expertaug.models import store
from expertaug.models.card import ModelCard
from expertaug.models.decoder import Decoder
from expertaug.models.encoders.fields import Moments
from expertaug.models.encoders.window import ComponentView
from expertaug.models.estimators import Classes, EstimatorKind, register
from expertaug.models.gaps import ends_of
from expertaug.models.hybrid import HybridNet
from expertaug.models.networks.layers import MLP, Linear, Standardise
from expertaug.models.posterior import Estimates, Predictor
from expertaug.models.stacking import SeedWise, stack
from expertaug.models.store import StoredModel
from expertaug.systems import System
from expertaug.systems.inputs import as_observed
from expertaug.systems.solvers.solver import Solver
from expertaug.windows import Windows, fill

NARROWEST = 9.0  # standard deviations of a posterior are at least exp(−9) of the prior's
FARTHEST = 10.0  # standard deviations of the draws: a number of a window that no draw is like says no more than that
CHUNK = 2**11  # draws made at a time: 2**17 take eight times the memory and no less time (benchmarks/flow_draws.py)
KERNELS = 3  # widths of the bootstrap's kernel by which drawn z_a may lie beyond the training windows'


class SummaryNetwork(nn.Module):
    """The observed window as the base model's encoder is allowed to see it: its windows of components where it has
    some, else every observed quantity and known input; of fields their moments.  Where values may not have been
    measured, straight lines stand for them, and which ones they are is seen as well.

    Arguments:
        times: of the observed window in s, (T1,).
        encoder: the base model's settings of its encoder.
        ranges: of the components of first points, where values may not have been measured (NaN).

    Attributes:
        inputs: how many numbers :meth:`forward` gives.
    """

    def __init__(
        self,
        system: System,
        times: Tensor,
        encoder: Mapping,
        ranges: Mapping[str, Sequence[float]] | None = None,
    ) -> None:
        super().__init__()
        system = as_observed(system)
        self.system, self.moments, self.windows = system, None, None
        self.times, self.middle = times, None if ranges is None else ends_of(ranges)[0]
        if len(system.state_shape) > 1:
            self.moments = Moments(system, len(times), encoder.get("powers") or (1, 3))
            self.inputs = self.moments.outputs
        elif encoder.get("windows"):
            self.windows = ComponentView(system, times, encoder["windows"], encoder.get("angles", ()))
            self.inputs = self.windows.inputs
        else:
            self.inputs = len(times) * system.observe(torch.zeros(1, *system.state_shape)).shape[-1]
        if ranges is not None:
            self.inputs += len(times) * len(ranges)

    def fit(self, observed: Tensor) -> None:
        """Learn the moments' scales from windows (T1, N, *observed)."""
        if self.moments is not None:
            self.moments.fit(observed.movedim(0, 1))

    def forward(self, observed: Tensor) -> Tensor:
        """(T1, …, B, *observed) → (…, B, inputs)."""
        if self.middle is None:
            return self._seen(observed)
        gaps = torch.isnan(observed[..., : len(self.middle)]).to(observed)
        filled = fill(observed, self.times, self.middle.to(observed))
        return torch.cat((self._seen(filled), gaps.movedim(0, -2).flatten(-2)), dim=-1)

    def _seen(self, observed: Tensor) -> Tensor:
        if self.moments is not None:
            return self.moments(observed.movedim(0, -2 - self.moments.rank))
        if self.windows is not None:
            return self.windows.features(self.windows(observed))
        return self.system.observe(observed).movedim(0, -2).flatten(-2)


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
        (log_density,) = self.splines.each("log_prob", [bent, summary], [0, 0], lambda value: (value,))
        return log_density - log_std.sum(-1)

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


class Head(nn.Module):
    """What one seed learns of its own: window → x → q(θ | x), and θ ↔ (z_e, z_a, y0); model files name its parts."""

    def __init__(self, context: SummaryNetwork, unknowns: PriorTransform, settings: FlowSettings) -> None:
        super().__init__()
        self.context, self.unknowns = context, unknowns
        self.density = Density(context.inputs, unknowns.count, settings)


class FlowEstimator(Predictor, nn.Module):
    """q(z_e, z_a, y0 | window) beside the model from whose draws it learned: an
    :class:`~expertaug.models.posterior.Estimator` with samples.

    What a state's initial speeds or an exact first point leave open is not inferred: y0 is part of it only where data
    are noisy, and only in the components that a forecast starts from.

    Arguments:
        base: the trained model, stacked, whose decoder forecasts; or a decoder that was trained without an encoder.
        head: stacked over the same seeds.
        samples: K, draws in an estimate.
        forecasts: of the first so many of them a forecast is the mean.
        bound: (C,), how far a forecast's components may go.
    """

    def __init__(
        self, base: HybridNet | Decoder, head: Head, samples: int, forecasts: int, bound: Tensor | None
    ) -> None:
        super().__init__()
        self.base, self.head, self.bound = base, head, bound
        self.samples, self.forecasts = samples, forecasts

    @property
    def system(self) -> System:
        return self.base.system

    @property
    def decoder(self) -> Decoder:
        return self.base if isinstance(self.base, Decoder) else self.base.decoder

    @property
    def interaction(self) -> nn.Module | None:
        return self.base.interaction

    @torch.no_grad()
    def sample(self, windows: Windows, count: int, seed: int | None = None) -> tuple[Tensor, Tensor, Tensor]:
        """Draws of the posterior.

        Arguments:
            windows: observed, y (T1, S, B, *state).
            count: K.
            seed: of independent draws for every window, the same for all seeds of the group; None: Sobol points, the
                same for every window, whose means are more accurate.

        Returns:
            z_e (K, S, B, P), z_a (K, S, B, Q) and y0 (K, S, B, *state).
        """
        unknowns, (seeds, samples) = self.head.unknowns, windows.y.shape[1:3]
        if seed is None:
            engine = torch.quasirandom.SobolEngine(unknowns.count, scramble=True, seed=0)
            share = engine.draw(count).clamp(1e-6, 1 - 1e-6)
            normal = torch.special.ndtri(share)[:, None].expand(-1, samples, -1)
        else:
            normal = torch.randn(count, samples, unknowns.count, generator=torch.Generator().manual_seed(seed))
        return self.draws(windows, normal.to(windows.y)[:, None].expand(-1, seeds, -1, -1))

    @torch.no_grad()
    def draws(self, windows: Windows, normal: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """As :meth:`sample`, from standard normal numbers (K, S, B, unknowns)."""
        transform, observed = self.head.unknowns.transform, windows.joined
        size, parts = max(CHUNK // len(normal), 1), []
        for start in range(0, observed.shape[2], size):
            part = slice(start, start + size)
            x = self.head.context(observed[:, :, part])
            theta = self.head.density.sample(x, normal[:, :, part])
            parts.append(transform.unpack(theta, windows.y[0, :, part]))
        z_e, z_a, y0 = (torch.cat(chunks, dim=2) for chunks in zip(*parts, strict=True))
        return z_e, z_a, y0

    def joint_draws(
        self, estimates: Estimates, windows: Windows, count: int, random: RandomStreams
    ) -> tuple[Tensor, Tensor, Tensor]:
        """As :func:`expertaug.inference.posterior_predictive.joint_draws`."""
        normal = random.normal(count, windows.y.shape[2], self.head.unknowns.count).transpose(0, 1)
        return self.draws(windows, normal.to(windows.y))

    def estimate(self, windows: Windows) -> Estimates:
        """Observed windows, y (T1, S, B, *state) → the posterior's means, with the draws that they are the means of."""
        draws = self.sample(windows, self.samples)
        z_e, z_a, y0 = (value.mean(0) for value in draws)
        return Estimates(y0, z_e, z_a, draws=tuple(value.movedim(0, 2) for value in draws))  # type: ignore[arg-type]

    def log_prob(self, windows: Windows, z_e: Tensor, z_a: Tensor, y0: Tensor) -> Tensor:
        """Log-density (S, B) of z_e (S, B, P), of the principal components of z_a (S, B, Q), and of the inferred
        components of y0 (S, B, *state)."""
        unknowns = self.head.unknowns
        first = windows.y[0]
        theta = unknowns.transform.pack(z_e, unknowns.transform.latent.coordinates(z_a), y0, first)
        return self.head.density.log_prob(self.head.context(windows.joined), theta) - unknowns.log_slope(theta, first)

    def forecast(
        self, y0: Tensor, z_e: Tensor, z_a: Tensor, t: Tensor, solver: Solver, u: Tensor | None = None
    ) -> Tensor:
        """The decoder's: states (T, …, B, *state) at the times t (T,), from y0 (…, B, *state)."""
        return self.decoder.forecast(y0, z_e, z_a, t, solver, u)

    def predicted(
        self, estimates: Estimates, windows: Windows, solver: Solver | BoundedSolver, start: str = "y0"
    ) -> Tensor:
        """The mean of the forecasts from the estimates' draws, from ``forecasts`` of them: posterior predictive; as
        :meth:`Predictor.predicted`."""
        assert estimates.draws is not None, "estimates of a flow"
        z_e, z_a, y0 = (value.movedim(2, 0)[: self.forecasts] for value in estimates.draws)
        bound = solver.bound if isinstance(solver, BoundedSolver) else self.bound
        t, u = windows.t, windows.u
        if start == "y0" or windows.has_gaps:
            return mean_forecast(self.decoder, z_e, z_a, y0, t, solver, bound, u)
        last = windows.points - 1
        y0, later = windows.y[last].expand_as(y0), None if u is None else u[last:]
        onwards = mean_forecast(self.decoder, z_e, z_a, y0, t[last:], solver, bound, later)
        return torch.cat((windows.y[:last], onwards))


def build(base: HybridNet | Decoder, card: ModelCard, latents: Tensor | None = None) -> FlowEstimator:
    """A flow beside a trained model, untrained.

    Arguments:
        base: the model, or a decoder of kind alternating; a copy of it is kept.
        card: of kind flow.
        latents: z_a (S, N, Q) of the training windows; None: a file's tensors will say what is known of them.
    """
    of_base, settings, system = card.base, FlowSettings.from_mapping(card.flow), base.system
    low, high = widen_box(system, *prior_ends(system, card.prior), settings.margin)
    width = of_base.latent_size if isinstance(base, Decoder) else base.encoder.latent
    components = 0 if base.interaction is None else min(settings.latent, width)
    if latents is None:
        latents = torch.zeros(len(card.seeds), 1, width)
    times, ranges = torch.tensor(of_base.t[: of_base.observed], dtype=torch.float64), of_base.start
    heads = []
    for seed, own in zip(card.seeds, latents.cpu(), strict=True):
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            beyond = KERNELS * settings.jitter
            unknowns = PriorTransform(system, low, high, own, components, card.noise, ranges, beyond)
            heads.append(Head(SummaryNetwork(system, times, of_base.model.encoder or {}, ranges), unknowns, settings))
    base, bound = copy.deepcopy(base).requires_grad_(False), bound_of_card(of_base)
    return FlowEstimator(base, stack(heads), settings.samples, settings.forecasts, bound)


@register
class Flow(EstimatorKind):
    """A posterior that a flow learned from draws of a trained model, beside that model."""

    name = "flow"
    summary = "a posterior of a trained model, learned from its own draws"
    is_method = False
    stage = "flow"
    has_expert = True
    needs = ("flow", "prior", "noise", "base")
    base = "base."

    @classmethod
    def network(
        cls, system: System, card: ModelCard, tensors: Mapping[str, Tensor], classes: Classes, base: Any = None
    ) -> nn.Module:
        return build(base, card)


def load(path: str | Path, device: torch.device | str = "cpu", classes: Collection[str | Callable] = ()) -> StoredModel:
    """Read a model file of any kind, a flow's too; arguments and errors as :func:`expertaug.models.store.load`.

    A flow's ``model`` is a :class:`FlowEstimator`, and its card has its base model's under ``base``.
    """
    return store.load(path, device, classes)

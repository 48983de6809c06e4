"""Posteriors by conditional normalising flows, as estimators of a group of seeds."""

from __future__ import annotations

import copy

import torch
from torch import Tensor, nn

from expertaug.inference.context import Context
from expertaug.inference.density import Density
from expertaug.inference.predictive import mean_forecast
from expertaug.inference.settings import FlowSettings
from expertaug.inference.unknowns import Unknowns, box
from expertaug.learning.augment import ranges_of
from expertaug.learning.divergence import Stopping, stored_bound
from expertaug.models.card import ModelCard
from expertaug.models.decoder import Decoder
from expertaug.models.hybrid import HybridNet
from expertaug.models.posterior import Estimates, Predictor
from expertaug.models.stacking import stack
from expertaug.systems import System
from expertaug.systems.inputs import states_of
from expertaug.systems.solvers.solver import Solver

CHUNK = 2**11  # draws made at a time: 2**17 take eight times the memory and no less time (benchmarks/flow_draws.py)
KERNELS = 3  # widths of the bootstrap's kernel by which drawn z_a may lie beyond the training windows'


class Head(nn.Module):
    """What one seed learns of its own: window → x → q(θ | x), and θ ↔ (z_e, z_a, y0)."""

    def __init__(self, context: Context, unknowns: Unknowns, settings: FlowSettings) -> None:
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
    def sample(self, windows: Tensor, count: int, seed: int | None = None) -> tuple[Tensor, Tensor, Tensor]:
        """Draws of the posterior.

        Arguments:
            windows: observed, (T1, S, B, *observed).
            count: K.
            seed: of independent draws for every window, the same for all seeds of the group; None: Sobol points, the
                same for every window, whose means are more accurate.

        Returns:
            z_e (K, S, B, P), z_a (K, S, B, Q) and y0 (K, S, B, *state).
        """
        unknowns, samples = self.head.unknowns, windows.shape[2]
        if seed is None:
            engine = torch.quasirandom.SobolEngine(unknowns.count, scramble=True, seed=0)
            share = engine.draw(count).clamp(1e-6, 1 - 1e-6)
            normal = torch.special.ndtri(share)[:, None].expand(-1, samples, -1)
        else:
            normal = torch.randn(count, samples, unknowns.count, generator=torch.Generator().manual_seed(seed))
        return self.draws(windows, normal.to(windows)[:, None].expand(-1, windows.shape[1], -1, -1))

    @torch.no_grad()
    def draws(self, windows: Tensor, normal: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """As :meth:`sample`, from standard normal numbers (K, S, B, unknowns)."""
        unknowns, known = self.head.unknowns, states_of(self.system, windows[0])
        size, parts = max(CHUNK // len(normal), 1), []
        for start in range(0, windows.shape[2], size):
            part = slice(start, start + size)
            x = self.head.context(windows[:, :, part])
            theta = self.head.density.sample(x, normal[:, :, part])
            parts.append(unknowns.unpack(theta, known[:, part]))
        z_e, z_a, y0 = (torch.cat(found, dim=2) for found in zip(*parts, strict=True))
        return z_e, z_a, y0

    def estimate(self, windows: Tensor) -> Estimates:
        """Observed windows (T1, S, B, *observed) → the posterior's means, with the draws that they are the means of."""
        draws = self.sample(windows, self.samples)
        z_e, z_a, y0 = (value.mean(0) for value in draws)
        return Estimates(y0, z_e, z_a, draws=tuple(value.movedim(0, 2) for value in draws))  # type: ignore[arg-type]

    def log_prob(self, windows: Tensor, z_e: Tensor, z_a: Tensor, y0: Tensor) -> Tensor:
        """Log-density (S, B) of z_e (S, B, P), of the principal components of z_a (S, B, Q), and of the inferred
        components of y0 (S, B, *state)."""
        unknowns = self.head.unknowns
        first = states_of(self.system, windows[0])
        theta = unknowns.pack(z_e, unknowns.scores(z_a), y0, first)
        return self.head.density.log_prob(self.head.context(windows), theta) - unknowns.log_slope(theta, first)

    def forecast(
        self, y0: Tensor, z_e: Tensor, z_a: Tensor, t: Tensor, solver: Solver, u: Tensor | None = None
    ) -> Tensor:
        """The decoder's: states (T, …, B, *state) at the times t (T,), from y0 (…, B, *state)."""
        return self.decoder.forecast(y0, z_e, z_a, t, solver, u)

    def predicted(
        self,
        found: Estimates,
        observed: Tensor,
        t: Tensor,
        solver: Solver | Stopping,
        start: str = "y0",
        u: Tensor | None = None,
    ) -> Tensor:
        """The mean of the forecasts from the estimates' draws, from ``forecasts`` of them: posterior predictive; as
        :meth:`Predictor.predicted`."""
        assert found.draws is not None, "estimates of a flow"
        z_e, z_a, y0 = (value.movedim(2, 0)[: self.forecasts] for value in found.draws)
        bound = solver.bound if isinstance(solver, Stopping) else self.bound
        if start == "y0" or torch.isnan(observed).any():
            return mean_forecast(self.decoder, z_e, z_a, y0, t, solver, bound, u)
        observed, last = states_of(self.system, observed), len(observed) - 1
        y0, later = observed[last].expand_as(y0), None if u is None else u[last:]
        onwards = mean_forecast(self.decoder, z_e, z_a, y0, t[last:], solver, bound, later)
        return torch.cat((observed[:last], onwards))


def build(base: HybridNet | Decoder, card: ModelCard, latents: Tensor | None = None) -> FlowEstimator:
    """A flow beside a trained model, untrained.

    Arguments:
        base: the model, or a decoder of kind alternating; a copy of it is kept.
        card: of kind flow.
        latents: z_a (S, N, Q) of the training windows; None: a file's tensors will say what is known of them.
    """
    of_base, settings, system = card.base, FlowSettings.from_mapping(card.flow), base.system
    low, high = box(system, *ranges_of(system, card.prior), settings.margin)
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
            unknowns = Unknowns(system, low, high, own, components, card.noise, ranges, beyond)
            heads.append(Head(Context(system, times, of_base.model.encoder or {}, ranges), unknowns, settings))
    base, bound = copy.deepcopy(base).requires_grad_(False), stored_bound(of_base)
    return FlowEstimator(base, stack(heads), settings.samples, settings.forecasts, bound)

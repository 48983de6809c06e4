"""Simulations by a frozen hybrid model, for a posterior to learn from and to be tested on.

Windows that a model itself has made over p⁺ are the only ones on which a right posterior must be calibrated.  No
gradient passes the solver.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from expertaug.inference.coordinates import PriorTransform
from expertaug.inference.flow import FlowEstimator
from expertaug.inference.least_squares import LeastSquares
from expertaug.inference.settings import FlowSettings, OwnWindows
from expertaug.learning.augment import CHUNK, NUMBERS, prior_ends, sample_latent
from expertaug.learning.divergence import (
    BoundedSolver,
    bound_of_card,
    clamp_to_bound,
    forecast_or_fallback,
    within_bound,
)
from expertaug.learning.random_streams import RandomStreams
from expertaug.learning.training_data import Task
from expertaug.models.card import ModelCard
from expertaug.models.decoder import Decoder
from expertaug.models.gaps import ends_of
from expertaug.models.hybrid import HybridNet
from expertaug.models.observation_noise import GivenNoise, NoiseLike, is_some, noise_of, shape_as_state
from expertaug.models.posterior import Predictor
from expertaug.models.stacking import stack
from expertaug.models.store import StoredModel
from expertaug.settings import given_ranges
from expertaug.systems.solvers.solver import Solver
from expertaug.windows import Windows

logger = logging.getLogger(__name__)
FLOW = 3  # of the keys of random numbers: augmentation's end in 1
LATENTS, HELD_OUT, POOL = 0, 1, 2  # what they are for
LOST = 0.05  # share of draws that may run away without a word
OWN = 4  # what the random numbers are for (expertaug.inference.simulations)
# Of the training, spread evenly, that z_a and first points come from: to encode all takes longer than to simulate few.
WINDOWS = 500


@dataclass(frozen=True)
class Draws:
    """M draws of each of S seeds: contexts x (S, M, inputs) and θ (S, M, D)."""

    x: Tensor
    theta: Tensor

    def __len__(self) -> int:
        return self.theta.shape[1]

    def __add__(self, other: Draws) -> Draws:
        return Draws(torch.cat((self.x, other.x), dim=1), torch.cat((self.theta, other.theta), dim=1))

    def __getitem__(self, part: slice) -> Draws:
        return Draws(self.x[:, part], self.theta[:, part])

    def steps(self, size: int) -> int:
        """Batches in one pass."""
        return max(len(self) // min(size, len(self)), 1)

    def batches(self, seeds: Sequence[int], epoch: int, size: int) -> Iterator[Draws]:
        """One pass: full batches in an order that depends on the seed and the epoch alone (a rest is left out)."""
        order = np.stack([np.random.default_rng([seed, epoch]).permutation(len(self)) for seed in seeds])
        row, size = torch.arange(len(seeds), device=self.x.device).unsqueeze(1), min(size, len(self))
        for start in range(0, len(self) - size + 1, size):
            index = torch.from_numpy(order[:, start : start + size]).to(self.x.device)
            yield Draws(self.x[row, index], self.theta[row, index])


class Simulated(NamedTuple):
    """Observed trajectories, y (T, S, M, *state), with their z_e (S, M, P), components of z_a (S, M, ·), true first
    points (S, M, *state), and whether each stayed within the bound (S, M)."""

    windows: Windows
    z_e: Tensor
    scores: Tensor
    y0: Tensor
    good: Tensor


@dataclass(frozen=True)
class Simulator:
    """What draws (window, θ) of a group of seeds: z_e ~ p⁺, z_a and the first point from the training windows, each on
    its own, y by the model, and the data's noise on every point.

    z_a and y0 are drawn apart (in Algorithm 1 both come from one window): a posterior would else infer z_a from the
    few training windows that begin nearly alike.  A smooth bootstrap fills the gaps between those windows.

    Attributes:
        decoder: stacked, trained.
        unknowns: the transform of what is inferred, stacked.
        context: stacked; windows → x.
        scores: principal components of z_a (S, N, ·) of the training windows.
        starts: their first points (N, *state).
        inputs: their known inputs (T, N, U), which a draw takes with its first point; None for a system without.
        low, high: ends (P,) of p⁺.
        noise: standard deviation of the data's noise.
        gaps: where windows were not measured, (T, N, *state); None: they have no gaps.  A draw gets those of one of
            them, and where its first point has one, any value of its range.
        ranges: of the components of first points, where windows have gaps.
        jitter: width of the bootstrap's kernel, in standard deviations of what it smooths.
        resample_x: whether x is drawn anew (:meth:`System.resample_known`).
        task: its T times, solver and bound.
        seeds: in the group's order.
    """

    decoder: Decoder
    unknowns: PriorTransform
    context: nn.Module
    scores: Tensor
    starts: Tensor
    inputs: Tensor | None
    low: Tensor
    high: Tensor
    noise: NoiseLike
    gaps: Tensor | None
    ranges: Mapping[str, Sequence[float]] | None
    jitter: float
    resample_x: bool
    task: Task
    seeds: Sequence[int]

    @torch.no_grad()
    def draw(self, count: int, *key: int) -> Draws:
        """``count`` draws of each seed, which depend on the seed and the key alone.

        A draw that runs away (:mod:`~expertaug.learning.divergence`) is replaced by the next: θ is then drawn given
        that it does not.
        """
        random = RandomStreams(self.seeds, *key, FLOW, device=self.starts.device)
        size = max(min(CHUNK, NUMBERS // self.starts[0].numel()), 1)
        parts, lost = [], 0
        for start in range(0, count, size):
            part, bad = self._part(min(size, count - start), random)
            parts.append(part)
            lost = lost + bad
        for seed, share in zip(self.seeds, (lost / count).tolist(), strict=True):
            if share > LOST:
                text = "flow, seed %d: %.0f %% of the draws run away; consider a narrower augmentation.prior"
                logger.warning(text, seed, 100 * share)
        x, theta = (torch.cat([getattr(part, name) for part in parts], dim=1) for name in ("x", "theta"))
        return Draws(x, theta)

    def simulated(self, count: int, random: RandomStreams) -> Simulated:
        """Trajectories over the task's times, what they were made with, and which of them stayed within the bound."""
        system, kept = self.decoder.system, (1 - self.jitter**2) ** 0.5
        z_e = self.low + (self.high - self.low) * random.uniform(count, len(self.low))
        row = torch.arange(len(self.seeds), device=self.starts.device).unsqueeze(1)
        scores = kept * self.scores[row, self._index(count, random)]
        scores = scores + self.jitter * random.normal(count, scores.shape[-1])
        index = self._index(count, random)
        y0, u = self.starts[index], None if self.inputs is None else self.inputs[:, index]
        if len(system.state_shape) == 1:
            y0 = y0 if self.ranges is None else self._anywhere(y0, random)
            mean, std = self._spread()
            y0 = mean + kept * (y0 - mean) + self.jitter * std * random.normal(count, *system.state_shape)
        if self.resample_x:
            y0 = system.resample_known(y0, partial(random.uniform, count))
        z_a = self.unknowns.transform.latent.z_a(scores)
        y = forecast_or_fallback(self.decoder, y0, z_e, z_a, self.task.t, self.task.solver, u)
        good = within_bound(y, self.task.bound)
        y = clamp_to_bound(y, self.task.bound)
        if is_some(self.noise):
            noise = shape_as_state(self.noise, y, system) * random.normal(len(y), *y.shape[2:]).movedim(0, 1)
            if not self.unknowns.start.size:  # a field's first point has noise already, and forecasts start from it
                noise[0] = 0.0
            y = y + noise
        if self.gaps is not None:
            y = y.masked_fill(self.gaps[:, self._index(count, random)], torch.nan)
        return Simulated(Windows(self.task.t, y, u), z_e, scores, y0, good)

    def _part(self, count: int, random: RandomStreams) -> tuple[Draws, Tensor]:
        """Draws, and how many (S,) of them ran away."""
        windows, z_e, scores, y0, good = self.simulated(count, random)
        draws = Draws(self.context(windows.joined), self.unknowns.transform.pack(z_e, scores, y0, windows.y[0]))
        return (draws if good.all() else _without(draws, good)), (~good).sum(1).cpu()

    def _anywhere(self, y0: Tensor, random: RandomStreams) -> Tensor:
        """First points (S, M, K) with values of their ranges where they were not measured."""
        middle, width = ends_of(self.ranges or {}, y0)
        return torch.where(torch.isnan(y0), middle + width * (2 * random.uniform(*y0.shape[1:]) - 1), y0)

    def _spread(self) -> tuple[Tensor, Tensor]:
        """Mean and standard deviation (K,) of the first points, of those that were measured."""
        if self.ranges is None:
            return self.starts.mean(0), self.starts.std(0)
        middle, width = ends_of(self.ranges, self.starts)
        measured = ~torch.isnan(self.starts)
        count, filled = measured.sum(0), self.starts.nan_to_num()
        mean = filled.sum(0) / count.clamp_min(1)
        std = (torch.where(measured, filled - mean, 0.0).square().sum(0) / (count - 1).clamp_min(1)).sqrt()
        return torch.where(count > 1, mean, middle), torch.where(count > 1, std, width / 3**0.5)

    def _index(self, count: int, random: RandomStreams) -> Tensor:
        """(S, count) places of training windows."""
        return (random.uniform(count) * len(self.starts)).long().clamp_max(len(self.starts) - 1)


class Pool:
    """The training sets of the passes: after each the oldest draws make room for new ones.

    Nothing of it is kept in a checkpoint: a pool follows from the seeds and the pass.

    Arguments:
        draw: count and key → draws.
        renewed: draws that are replaced after each pass.
        uses: passes that a draw stays for.
    """

    def __init__(self, simulator: Simulator, renewed: int, uses: int) -> None:
        self.simulator, self.renewed, self.uses = simulator, renewed, uses
        self.number, self.held = -1, None

    def __call__(self, epoch: int) -> Draws:
        """The pool of a pass: the renewals ``epoch`` to ``epoch + uses − 1``."""
        if self.held is None or epoch != self.number:
            after = self.held is not None and epoch == self.number + 1
            wanted = range(epoch + self.uses - 1, epoch + self.uses) if after else range(epoch, epoch + self.uses)
            kept = [self.held[slice(self.renewed, None)]] if after else []
            parts = [*kept, *(self.simulator.draw(self.renewed, POOL, number) for number in wanted)]
            self.held = sum(parts[1:], parts[0])
            self.number = epoch
        return self.held


def _without(draws: Draws, good: Tensor) -> Draws:
    """Draws in which the good (S, M) draw of their seed that follows, in a circle, replaces one that is not."""
    index = torch.arange(good.shape[1], device=good.device).repeat(len(good), 1)
    for place in range(len(good)):
        fine = good[place].nonzero().flatten()
        if len(fine):
            index[place] = fine[torch.searchsorted(fine, index[place]) % len(fine)]
    row = torch.arange(len(good), device=good.device).unsqueeze(1)
    return Draws(draws.x[row, index], draws.theta[row, index])


@torch.no_grad()
def latents_of(model: Predictor | nn.Module, card: ModelCard, windows: Windows, z_a_from: str) -> Tensor:
    """z_a (S, N, Q) as a model's own windows have them: draws of the encoder's posterior of the training windows; of a
    model without an encoder draws of the Gaussian that its fits take z_a from.

    Arguments:
        model: stacked over the seeds.
        windows: observed windows of the training, y (T1, 1, N, *state).
        z_a_from: as of :func:`expertaug.learning.augment.sample_latent`.
    """
    seeds = card.seeds
    random = RandomStreams(seeds, LATENTS, FLOW, device=windows.y.device)
    if isinstance(model, FlowEstimator):
        model = model.base
    if not isinstance(model, HybridNet):
        moments = ([[]], [[]]) if card.latent is None else (card.latent.mean, card.latent.std)
        mean, std = (torch.tensor(value).float().to(windows.y.device).unsqueeze(1) for value in moments)
        return mean + std * random.normal(windows.y.shape[2], mean.shape[-1])
    parts = []
    for part in windows.split(1024):
        posterior = model.encode(part.expand(len(seeds)))
        parts.append(sample_latent(posterior, z_a_from, partial(random.normal, part.y.shape[2])))
    return torch.cat(parts, dim=1)


@torch.no_grad()
def draw_simulations(
    stored: StoredModel, train: Windows, own: OwnWindows, noise: GivenNoise, count: int
) -> tuple[Windows, Tensor]:
    """Trajectories that a model makes with z_e of p⁺, z_a and first points of the training windows, and with noise.

    Arguments:
        stored: any estimator with an expert.
        train: trajectories of the training, y (T, 1, N, *state).
        own: over which p⁺, and from what.
        noise: standard deviation of the data's noise.
        count: of each seed.

    Returns:
        y (T, S, M, *state) and z_e (S, M, P); those that run away are left out, of all seeds alike.
    """
    model, card, seeds = stored.model, stored.card, stored.seeds
    first = model
    if isinstance(model, LeastSquares) and model.__dict__["first"] is not None:
        first = model.__dict__["first"]
    decoder, system, device = model.decoder, model.system, train.y.device
    number = train.y.shape[2]
    train = train.samples(torch.linspace(0, number - 1, min(WINDOWS, number)).long().to(device))
    windows, states = train.until(card.observed), train.y[:, 0]
    latents = latents_of(first, card, windows, own.z_a_from)
    low, high = (end.to(device) for end in prior_ends(system, given_ranges(own.prior)))
    noise_std, ranges = noise_of(noise, system, card), card.start
    if decoder.sensors is not None and ranges is not None:
        ranges = decoder.sensors.state_ranges(ranges)
    if isinstance(first, FlowEstimator):
        unknowns = first.head.unknowns
    else:
        width = latents.shape[-1]
        each = [PriorTransform(system, low.cpu(), high.cpu(), z_a, width, noise_std, ranges) for z_a in latents.cpu()]
        unknowns = stack(each).to(device)
    t = torch.tensor(card.t, dtype=torch.float32)
    bound = bound_of_card(card, device)
    solver: Solver | BoundedSolver = stored.solver if bound is None else BoundedSolver(stored.solver, bound)
    simulator = Simulator(
        decoder=decoder,
        unknowns=unknowns,
        context=nn.Identity(),
        scores=unknowns.transform.latent.coordinates(latents),
        starts=decoder.state_of(states[0]),
        inputs=None if train.u is None else train.u[:, 0],
        gaps=None if ranges is None else torch.isnan(states),
        ranges=ranges,
        low=low,
        high=high,
        noise=noise_std,
        jitter=FlowSettings().jitter,
        resample_x=own.resample_x,
        task=Task(t, card.observed, len(t), solver, bound=bound),  # type: ignore[arg-type]
        seeds=seeds,
    )
    simulated = simulator.simulated(count, RandomStreams(seeds, OWN, FLOW, device=device))
    good = simulated.good.all(0)
    return simulated.windows.samples(good), simulated.z_e[:, good]

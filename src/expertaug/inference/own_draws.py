"""Windows that a model itself has made over p⁺: the only ones on which a right posterior must be calibrated."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import torch
from torch import Tensor, nn

from expertaug.inference.draws import FLOW, LATENTS, Simulator
from expertaug.inference.flow import FlowEstimator
from expertaug.inference.least_squares import LeastSquares
from expertaug.inference.settings import FlowSettings
from expertaug.inference.unknowns import Unknowns
from expertaug.learning.augment import latent, ranges_of
from expertaug.learning.divergence import Stopping, stored_bound
from expertaug.learning.random_streams import RandomStreams
from expertaug.learning.training_data import Task
from expertaug.models.card import ModelCard
from expertaug.models.hybrid import HybridNet
from expertaug.models.observation_noise import noise_of
from expertaug.models.posterior import Predictor
from expertaug.models.stacking import stack
from expertaug.models.store import StoredModel
from expertaug.systems.inputs import inputs_of, states_of
from expertaug.systems.solvers.solver import Solver

OWN = 4  # what the random numbers are for (expertaug.inference.draws)
# Of the training, spread evenly, that z_a and first points come from: to encode all takes longer than to simulate few.
WINDOWS = 500


@torch.no_grad()
def latents_of(model: Predictor | nn.Module, card: ModelCard, windows: Tensor, z_a_from: str) -> Tensor:
    """z_a (S, N, Q) as a model's own windows have them: draws of the encoder's posterior of the training windows; of a
    model without an encoder draws of the Gaussian that its fits take z_a from.

    Arguments:
        model: stacked over the seeds.
        windows: observed windows of the training, (T1, 1, N, *observed).
        z_a_from: as of :func:`expertaug.learning.augment.latent`.
    """
    seeds = card.seeds
    random = RandomStreams(seeds, LATENTS, FLOW, device=windows.device)
    if isinstance(model, FlowEstimator):
        model = model.base
    if not isinstance(model, HybridNet):
        known = ([[]], [[]]) if card.latent is None else (card.latent.mean, card.latent.std)
        mean, std = (torch.tensor(value).float().to(windows.device).unsqueeze(1) for value in known)
        return mean + std * random.normal(windows.shape[2], mean.shape[-1])
    parts = []
    for part in windows.split(1024, dim=2):
        posterior = model.encode(part.expand(-1, len(seeds), *part.shape[2:]))
        parts.append(latent(posterior, z_a_from, partial(random.normal, part.shape[2])))
    return torch.cat(parts, dim=1)


@torch.no_grad()
def own_draws(stored: StoredModel, train: Tensor, settings: Mapping, count: int) -> tuple[Tensor, Tensor]:
    """Trajectories that a model makes with z_e of p⁺, z_a and first points of the training windows, and with noise.

    Arguments:
        stored: any estimator with an expert.
        train: trajectories of the training, (T, N, *observed).
        settings: {prior, noise, resample_x, z_a_from}.
        count: of each seed.

    Returns:
        y (T, S, M, *observed) and z_e (S, M, P); those that run away are left out, of all seeds alike.
    """
    model, card, seeds = stored.model, stored.card, stored.seeds
    first = model
    if isinstance(model, LeastSquares) and model.__dict__["first"] is not None:
        first = model.__dict__["first"]
    decoder, system, device = model.decoder, model.system, train.device
    train = train[:, torch.linspace(0, train.shape[1] - 1, min(WINDOWS, train.shape[1])).long().to(device)]
    windows, states = train[: card.observed].unsqueeze(1), states_of(system, train)
    latents = latents_of(first, card, windows, settings["z_a_from"])
    low, high = (end.to(device) for end in ranges_of(system, settings["prior"]))
    noise, ranges = noise_of(settings["noise"], system, card), card.start
    if isinstance(first, FlowEstimator):
        unknowns = first.head.unknowns
    else:
        width = latents.shape[-1]
        own = [Unknowns(system, low.cpu(), high.cpu(), one, width, noise, ranges) for one in latents.cpu()]
        unknowns = stack(own).to(device)
    t = torch.tensor(card.t, dtype=torch.float32)
    bound = stored_bound(card, device)
    solver: Solver | Stopping = stored.solver if bound is None else Stopping(stored.solver, bound)
    simulator = Simulator(
        decoder=decoder,
        unknowns=unknowns,
        context=nn.Identity(),
        scores=unknowns.scores(latents),
        starts=states[0],
        inputs=inputs_of(system, train),
        gaps=None if ranges is None else torch.isnan(states),
        ranges=ranges,
        low=low,
        high=high,
        noise=noise,
        jitter=FlowSettings().jitter,
        resample_x=bool(settings["resample_x"]),
        task=Task(t, card.observed, len(t), solver, bound=bound),  # type: ignore[arg-type]
        seeds=seeds,
    )
    found = simulator.simulated(count, RandomStreams(seeds, OWN, FLOW, device=device))
    good = found.good.all(0)
    return found.y[:, :, good], found.z_e[:, good]

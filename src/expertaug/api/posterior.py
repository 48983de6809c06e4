"""Posteriors in memory: a flow learned from a trained model's own draws, and forecasts with bands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypedDict, Unpack

import numpy as np
import torch

from expertaug.api import arguments
from expertaug.api.arguments import Array, Noise, Ranges
from expertaug.api.inference import check_or_grow_ranges
from expertaug.api.trained import TrainedModel
from expertaug.api.training import course
from expertaug.errors import InputError
from expertaug.inference.flow import FlowEstimator
from expertaug.inference.flow_training import fit_flow
from expertaug.inference.posterior_predictive import Drawn
from expertaug.inference.posterior_predictive import predictive as of_windows
from expertaug.inference.settings import FlowSettings, FlowTrainingOptions
from expertaug.learning.divergence import bound_of_card
from expertaug.learning.trainer import History
from expertaug.systems.solvers.solver import Solver
from expertaug.trajectories import Trajectories, brief


class FlowOptions(TypedDict, total=False):
    """How to learn a posterior; see :class:`expertaug.inference.settings.FlowSettings` for meaning and defaults."""

    steps: int
    batch_size: int
    learning_rate: float
    warmup: float
    clip_norm: float | None
    pool: int
    uses: int
    held_out: int
    layers: Sequence[int]
    summary: int
    transforms: int
    hidden: Sequence[int]
    bins: int
    latent: int
    jitter: float
    resample_x: bool
    margin: float
    samples: int
    forecasts: int
    solver: Mapping


@dataclass(frozen=True)
class Band:
    """A posterior's forecasts of N windows; of S seeds whose posteriors are not pooled every array has an axis (S,)
    before N.

    Attributes:
        t: times in s, (T,).
        mean: states (N, T, *state), what minimises the expected squared error.
        levels: L of them, between 0 and 1.
        quantiles: of every value on its own, (L, N, T, *state).
        z_e: draws by name, (K, N) each; pooled, (S·K, N).
    """

    t: np.ndarray
    mean: Array
    levels: tuple[float, ...]
    quantiles: Array
    z_e: dict[str, Array]

    def __repr__(self) -> str:
        """In one line, whatever the size."""
        levels = ", ".join(f"{level:g}" for level in self.levels)
        draws = f", draws of {', '.join(self.z_e)}" if self.z_e else ""
        return f"Band({brief(self.t)}, quantiles {levels}{draws})"


def fit_posterior(
    model: TrainedModel,
    train: Trajectories,
    validation: Trajectories | None = None,
    *,
    prior: Ranges | None = None,
    noise: Noise = 0.0,
    label: str | None = None,
    **options: Unpack[FlowOptions],
) -> TrainedModel:
    """Learn the posterior over (z_e, z_a, y0) by a conditional normalising flow (zuko's neural spline flow).

    It learns from endless fresh draws of the trained model itself over p⁺(z_e): expert augmentation as simulation-based
    inference.  No gradient passes the solver, and the model stays as it is.

    Arguments:
        model: a trained hybrid model.
        train: the set of its training, whose starts and z_a the draws have.
        validation: the misfits of its windows tell later which forecasts to distrust; None: :attr:`Forecast.trusted` is
            not known.
        prior: ranges [low, high] of p⁺ by expert parameter, in its unit; None: those that
            :func:`expertaug.own_prior` finds without further windows.
        noise: standard deviation of the data's noise.
        label: default: the model's own with "+ flow".
        options: see :class:`FlowOptions`.

    Returns:
        a model that forecasts by the mean over its posterior's draws; :func:`predictive` gives bands.

    Raises:
        InputError: an argument that cannot be used, or a model that is no hybrid one.
    """
    card = model.stored.card
    label = label or f"{model.label}+ flow"
    settings = FlowTrainingOptions.of(
        experiment=card.experiment,
        method=label,
        label=label,
        preset=card.preset,
        choices=card.choices,
        seeds=model.seeds,
        flow=FlowSettings.from_mapping(options),
        prior=check_or_grow_ranges(model, train, prior, arguments.noise(noise)),
        noise=arguments.noise(noise),
    )
    history = History()
    with arguments.one_thread():
        stored = fit_flow(model.stored, train, settings, "model", validation, history)
    return TrainedModel(stored, course(history, stored.seeds), model.single)


def predictive(
    model: TrainedModel,
    window: Array,
    t: Array | Sequence[float],
    *,
    u: Array | None = None,
    levels: Sequence[float] = (0.05, 0.5, 0.95),
    draws: int = 119,
    solver: Solver | None = None,
    pooled: bool = True,
) -> Band:
    """Posterior predictive forecasts: mean and quantiles over draws, without the noise of a measurement.

    Of a flow, of Laplace's approximation of a refined model's fits, or of a hybrid-VAE's Gaussian.  Each seed learned
    another F_a, which its own posterior takes for the truth; the seeds' draws together know of that error as well
    (ensembles of posteriors: Hermans et al. 2022).

    Arguments:
        model: of :func:`fit_posterior`, refined, of :func:`least_squares`, or trained as a hybrid-VAE.
        window, t, u, solver: as of :meth:`TrainedModel.forecast`.
        levels: of the quantiles.
        draws: K, of each seed.
        pooled: whether all S seeds' draws make one posterior, as of one seed with S·K draws; False: one of each seed,
            whose intervals leave out how far off its own F_a is.

    Raises:
        InputError: a model without a posterior that can be drawn from, or levels beyond 0 and 1.
    """
    if not levels or any(not 0 < level < 1 for level in levels):
        raise InputError("levels", f"found {list(levels)}", "give numbers between 0 and 1, as 0.05")
    windows, times = model._windows(window, t, u)
    with torch.no_grad(), arguments.one_thread():
        sampler = model.predictor
        if not isinstance(sampler, FlowEstimator):
            sampler = Drawn(sampler, model.seeds, bound_of_card(model.stored.card, windows.y.device))
        drawn = of_windows(sampler, windows, solver or model.solver, draws, levels, pooled=pooled)
    mean, quantiles = drawn.mean.movedim(0, 2), drawn.quantiles.movedim(1, 3)
    z_e = drawn.z_e
    if model.single or pooled:
        mean, quantiles, z_e = mean[0], quantiles[:, 0], z_e[:, 0]
    named = {p.name: arguments.like(z_e[..., k], window) for k, p in enumerate(model.system.expert_parameters)}
    return Band(times, arguments.like(mean, window), tuple(levels), arguments.like(quantiles, window), named)

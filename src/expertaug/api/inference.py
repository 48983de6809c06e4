"""Inference in memory: fits of each window, with the expert alone or to learn F_a, ranges of p⁺, validity of F_a."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import TypedDict, TypeVar, Unpack

import numpy as np
import torch
from torch import Tensor

from expertaug import systems
from expertaug.api import arguments
from expertaug.api.arguments import Array, Noise, Ranges, RefinementOptions, check_sets, seeds_of
from expertaug.api.trained import TrainedModel, warn_of_noise
from expertaug.errors import InputError
from expertaug.inference.adaptive_prior import (
    SAMPLES,
    AdaptivePrior,
    adapt_prior,
    typical_ranges,
    widen_prior,
    with_more_starts,
)
from expertaug.inference.alternating import alternate as alternate_fits
from expertaug.inference.diagnostics.validity import Validity, along
from expertaug.inference.least_squares import with_overdispersion
from expertaug.inference.settings import AlternateOptions, AlternatingSettings
from expertaug.inference.shared import fit_shared
from expertaug.learning.settings import SolverOnly, UntrainedOptions
from expertaug.learning.train import make_expert_alone
from expertaug.models import describe
from expertaug.models.card import RecipeRecord
from expertaug.models.fit_settings import Refinement, RefinementSettings
from expertaug.models.hybrid import HybridModel
from expertaug.models.observation_noise import GivenNoise
from expertaug.models.settings import INTERACTION
from expertaug.models.store import StoredModel
from expertaug.presets import resolve
from expertaug.settings import Settings
from expertaug.systems import System
from expertaug.trajectories import Trajectories
from expertaug.windows import Windows

logger = logging.getLogger(__name__)
BUDGET = 2.0  # by which p⁺ is widened at most: the configuration's default too
Options = TypeVar("Options", bound=Settings)


def least_squares(
    system: System,
    train: Trajectories,
    *,
    observed_s: float,
    prior: Ranges | None = None,
    noise: Noise = 0.0,
    start: Ranges | None = None,
    label: str = "Least squares",
    **options: Unpack[RefinementOptions],
) -> TrainedModel:
    """Nonlinear least squares on each observed window with the expert alone; nothing is trained.

    Arguments:
        system: gives F_e.
        train: whose times and largest values count (how far a forecast may go; the noise where data have none).
        observed_s: end of the observed window t1 in s, which is included.
        prior: ranges [low, high] by expert parameter, in its unit, in which the fits start; None: they are found, by
            fits of the training windows that start around the parameters' typical sizes.
        noise: standard deviation of the data's noise; the first point is estimated too where there is any.
        start: ranges [low, high] of first values of components that nobody measured, in their units.
        options: see :class:`expertaug.models.fit_settings.RefinementSettings`; with ``units={"omega0": "shared"}`` all
            windows have one ω0, fitted once to the training windows together; with ``sensors={"omega": {"scale":
            "shared"}}`` the scale of the speed's sensor is estimated with it, and forecasts are what it shows.

    Returns:
        a model that forecasts and is scored like a trained one.

    Raises:
        InputError: an argument that cannot be used.
    """
    arguments.check_set(system, train, "train", labelled=False)
    arguments.check_observed(observed_s, train.t)
    described = RecipeRecord.of(system=systems.describe(system), interaction=False)
    fitting = refinement_of(system, options, noise, prior)
    # Coarse steps of diffusion would shift the estimates by more than any noise does.
    exact = type(system).linear_flow is not System.linear_flow
    training = SolverOnly.from_mapping({"solver": {"method": "lawson4"}} if exact else {})
    named = (system, "least_squares", label, observed_s, start)
    settings = fit_options(UntrainedOptions, *named, fitting, training=training, seeds=[0])
    stored = make_expert_alone(system, train, settings, described)
    if prior is None:
        ranges = grow_ranges_of_expert(stored, train, fitting.noise, fitting.settings)
        fitting = fitting.model_copy(update={"prior": ranges})
        stored = replace(stored, card=stored.card.but(refinement=fitting))
    if fitting.settings.shares:
        with arguments.one_thread():
            fitting = fit_shared(stored, fitting, train)
    else:
        with arguments.one_thread():
            fitting = with_overdispersion(stored, fitting, train)
    stored = replace(stored, card=stored.card.but(refinement=fitting))
    model = TrainedModel(stored, single=True, refinement=stored.card.refinement)
    warn_of_noise(fitting)
    _ = model.predictor  # says what is wrong with the options
    return model


class AlternatingOptions(TypedDict, total=False):
    """How to train; see :class:`expertaug.inference.settings.AlternatingSettings` for meaning and defaults."""

    latent: int
    steps: int
    batch_size: int
    learning_rate: float
    warmup: float
    clip_norm: float | None
    penalty: float
    share: float
    threshold: float
    teacher_forcing: Mapping | None
    train_samples: int | None
    validate_every: int
    validation_samples: int | None
    horizon_s: float
    solver: Mapping


def alternate(
    system: System,
    interaction: Mapping | Callable,
    train: Trajectories,
    validation: Trajectories,
    *,
    observed_s: float,
    prior: Ranges | None = None,
    noise: Noise = 0.0,
    start: Ranges | None = None,
    seeds: Iterable[int] = (0,),
    refinement: RefinementOptions | None = None,
    label: str = "Alternating",
    **options: Unpack[AlternatingOptions],
) -> TrainedModel:
    """Learn an interaction model from least-squares fits of each training window, without an encoder.

    Arguments:
        system: gives F_e.
        interaction: F_a, as :class:`HybridModel` takes it.
        train, validation: sets of the same times; the second selects each seed's best state.
        observed_s: end of the observed window t1 in s, which is included.
        prior: ranges [low, high] by expert parameter, in its unit, in which the fits start; None: they are found, as by
            :func:`expertaug.least_squares`.
        noise: standard deviation of the data's noise; the first point is estimated too where there is any.
        start: ranges [low, high] of first values of components that nobody measured, in their units.
        seeds: of initialisation and data order; they are trained as one batched computation.
        refinement: how windows are fitted (:class:`expertaug.models.fit_settings.RefinementSettings`); with ``units``,
            and ``sensors``, as of :func:`expertaug.least_squares`: all windows share these constants, of which each
            seed has its own beside its F_a.
        options: see :class:`AlternatingOptions`; a ``latent`` of 0 makes F_a one for all windows.

    Returns:
        the best state of every seed; its estimates are fits of each window.

    Raises:
        InputError: an argument that cannot be used.
        SolveError: no seed can be trained.
    """
    recipe = HybridModel(system, {}, interaction)  # without an encoder
    check_sets(system, train, validation)
    arguments.check_observed(observed_s, train.t)
    part = describe.settings_of(INTERACTION, interaction)
    described = RecipeRecord.of(system=systems.describe(system), model={"interaction": part})
    fitting, training = refinement_of(system, refinement, noise, prior), AlternatingSettings.from_mapping(options)
    named = (system, "alternating", label, observed_s, start)
    chosen = seeds_of(seeds)
    if prior is None:
        of_expert = fit_options(UntrainedOptions, *named, fitting, seeds=chosen)
        alone = make_expert_alone(system, train, of_expert, described)
        ranges = grow_ranges_of_expert(alone, train, fitting.noise, fitting.settings)
        fitting = fitting.model_copy(update={"prior": ranges})
    settings = fit_options(AlternateOptions, *named, fitting, training=training, seeds=chosen)
    stored = alternate_fits(system, train, validation, settings, described, describe.own_classes(recipe))
    return TrainedModel(stored, single=len(chosen) == 1, refinement=stored.card.refinement)


def own_prior(
    model: TrainedModel,
    train: Trajectories,
    unlabelled: Array | None = None,
    *,
    u: Array | None = None,
    noise: Noise = 0.0,
    prior: Ranges | None = None,
    budget: float = BUDGET,
    **options: Unpack[RefinementOptions],
) -> AdaptivePrior:
    """Ranges for the augmentation prior p⁺, grown from the training windows' own until the model explains new windows.

    Nothing but the observed windows of where the model is to work is needed; without any the ranges are widened by a
    budget, as far as the model's own windows stay within bounds and can be fitted.  ``found.ranges`` goes into
    :func:`finetune` as its prior; ``found.says`` is one sentence, which tells too when the expert does not fit.

    Arguments:
        model: trained, or of :func:`least_squares`.
        train: the training set.
        unlabelled: observed windows of where the model is to work, (N, T1, *state); of more than 200 so many, evenly
            spread, are used, of the training set too.
        u: their known inputs, (N, T1, U), of a system that has some.
        noise: standard deviation of the data's noise.
        prior: ranges in which fits of the training windows start; None: at the model's own estimates.
        budget: without windows: by which factor the ranges are widened, at most.
        options: see :class:`expertaug.models.fit_settings.RefinementSettings`.

    Raises:
        InputError: windows of another shape, or least squares without a prior.
    """
    names = [p.name for p in model.system.expert_parameters]
    first = None if prior is None else arguments.ranges(prior, names, "prior")
    return grow_ranges(
        model.stored,
        train,
        unlabelled,
        arguments.noise(noise),
        first,
        budget,
        RefinementSettings.from_mapping(options),
        u,
    )


def validity(
    model: TrainedModel,
    train: Trajectories,
    unlabelled: Array,
    *,
    u: Array | None = None,
    noise: Noise = 0.0,
    prior: Ranges | None = None,
    **options: Unpack[RefinementOptions],
) -> dict[str, Validity]:
    """Does F_a hold where z_e is not that of the training?  The paper's assumption A1, by least squares on each window.

    Arguments:
        model: trained; of a group of seeds the windows of all count.
        train: its training set.
        unlabelled: observed windows, (N, T1, *state), of where the model is to work; no truth is needed.
        u: their known inputs, (N, T1, U), of a system that has some.
        noise, prior, options: as of :meth:`TrainedModel.refined`.

    Returns:
        by expert parameter: where windows are explained as well as the training's; ``says`` is one sentence.

    Raises:
        InputError: windows of another shape, or an option that cannot be used.
    """
    refined = model.refined(noise=noise, prior=prior, **options)
    seen, t = train.window(0, model.observed), model.t[: model.observed]
    training_forecast, unlabelled_forecast = (
        refined.forecast(y, t, u=inputs) for y, inputs in ((seen.seen, seen.u), (unlabelled, u))
    )

    def flat(value: object) -> np.ndarray:
        return np.asarray(value, dtype=float).ravel()

    return {
        name: along(
            name,
            flat(unlabelled_forecast.z_e[name]),
            flat(unlabelled_forecast.chi2),
            flat(training_forecast.z_e[name]),
            flat(training_forecast.chi2),
        )
        for name in unlabelled_forecast.z_e
    }


def fit_options(
    kind: type[Options],
    system: System,
    method: str,
    label: str,
    observed_s: float,
    start: Ranges | None,
    refinement: Refinement,
    **rest: object,
) -> Options:
    """Options of a method whose estimates are least-squares fits of each window; ``rest`` are its training and seeds.

    Raises:
        InputError: a range cannot be used.
    """
    return kind.of(
        experiment=systems.describe(system)["name"],
        method=method,
        label=label,
        preset="corrected",
        choices=resolve("corrected"),
        t1_s=float(observed_s),
        start={} if start is None else arguments.ranges(start, start, "start"),
        refinement=refinement,
        **rest,
    )


def refinement_of(system: System, options: RefinementOptions | None, noise: Noise, prior: Ranges | None) -> Refinement:
    """How windows are fitted; a ``prior`` of None is for the caller to find.

    Raises:
        InputError: an option or a range cannot be used.
    """
    names = [p.name for p in system.expert_parameters]
    ranges = None if prior is None else arguments.ranges(prior, names, "prior")
    positive = {parameter.name for parameter in system.expert_parameters if parameter.positive}
    for name, (low, high) in (ranges or {}).items():
        if name in positive and high <= 0:
            problem = f"found [{low:g}, {high:g}]"
            raise InputError(f"prior.{name}", problem, "the parameter is positive: give a range that is")
    return Refinement.of(settings=RefinementSettings.from_mapping(options), noise=arguments.noise(noise), prior=ranges)


def grow_ranges(
    stored: StoredModel,
    train: Trajectories,
    unlabelled: Array | None,
    noise: GivenNoise,
    first: Ranges | None,
    budget: float,
    options: RefinementSettings,
    u: Array | None = None,
) -> AdaptivePrior:
    """As :func:`expertaug.own_prior`, of at most 200 windows of each set, evenly spread."""
    observed = stored.card.observed
    index = np.linspace(0, len(train) - 1, min(SAMPLES, len(train))).astype(int)
    part, system, gaps = train.subset(index), stored.model.system, stored.card.start is not None
    training = _windows(arguments.tensor(part.seen, "train", gaps), part.u, system, part.t, "train.u")
    with arguments.one_thread():
        if unlabelled is None:
            return widen_prior(stored, training, noise, float(budget), first, options)
        y = arguments.tensor(unlabelled, "unlabelled", gaps)
        if y.shape[1:] != train.y[:, :observed].shape[1:]:
            wanted = f"(N, {observed}, {', '.join(map(str, train.y.shape[2:]))})"
            raise InputError("unlabelled", f"has shape {tuple(y.shape)}", f"give {wanted}")
        windows = _windows(y, u, system, train.t[:observed], "u")
        index = np.linspace(0, len(y) - 1, min(SAMPLES, len(y))).astype(int)
        windows = windows.samples(torch.from_numpy(index))
        return adapt_prior(stored, training.until(observed), windows, noise, first, options)


def _windows(y: Tensor, u: object, system: System, t: np.ndarray, name: str) -> Windows:
    """Windows y (T, 1, N, *state) of states (N, T, *state) and known inputs (N, T, U)."""
    inputs = arguments.inputs(u, system, len(y), t, name)
    inputs = None if inputs is None else inputs.movedim(1, 0)
    return Windows(torch.from_numpy(t).float(), y.movedim(1, 0), inputs).with_seeds()


def check_or_grow_ranges(model: TrainedModel, train: Trajectories, prior: Ranges | None, noise: GivenNoise) -> dict:
    """The ranges that a user gave, checked; without any those that widen the training's as far as the model goes."""
    if prior is not None:
        return arguments.ranges(prior, [p.name for p in model.system.expert_parameters], "prior")
    arguments.trajectories(train, "train")
    if not model.stored.kind.has_expert:
        raise InputError("model", "a mean of the training set", "give a model with an expert")
    first = typical_ranges(model.system)  # beside the model's own estimates, which may be wrong
    grown = grow_ranges(model.stored, train, None, noise, first, BUDGET, RefinementSettings())  # type: ignore[arg-type]
    logger.info("p⁺: %s", grown.says)
    return dict(grown.ranges)


def grow_ranges_of_expert(
    stored: StoredModel, train: Trajectories, noise: GivenNoise, options: RefinementSettings
) -> dict:
    """The same before anything is trained, by fits of the expert alone, each window with parameters of its own."""
    first, how = typical_ranges(stored.model.system), with_more_starts(options.alone)
    grown = grow_ranges(stored, train, None, noise, first, BUDGET, how)  # type: ignore[arg-type]
    logger.info("p⁺: %s", grown.says)
    return dict(grown.ranges)

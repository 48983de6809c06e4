"""Inference in memory: least squares with the expert alone, a prior that finds its own width, validity of F_a."""

from __future__ import annotations

from dataclasses import replace
from typing import Unpack

import numpy as np

from expertaug import systems
from expertaug.api import arrays
from expertaug.api.arrays import Array, Noise, Ranges, RefinementOptions
from expertaug.api.checks import fit_options, refinement_of
from expertaug.api.own_ranges import BUDGET, found_by, of_expert_alone
from expertaug.api.trained import TrainedModel
from expertaug.inference.own_prior import OwnPrior
from expertaug.inference.validity import Validity, along
from expertaug.learning.settings import SolverOnly, UntrainedOptions
from expertaug.learning.train import expert_alone
from expertaug.models.card import RecipeRecord
from expertaug.models.settings import RefinementSettings
from expertaug.systems import System
from expertaug.trajectories import Trajectories


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
        options: see :class:`expertaug.inference.settings.RefinementSettings`.

    Returns:
        a model that forecasts and is scored like a trained one.

    Raises:
        InputError: an argument that cannot be used.
    """
    described = RecipeRecord.of(system=systems.describe(system), interaction=False)
    fitting = refinement_of(system, options, noise, prior)
    # Coarse steps of diffusion would shift the estimates by more than any noise does.
    exact = type(system).linear_flow is not System.linear_flow
    training = SolverOnly.from_mapping({"solver": {"method": "lawson4"}} if exact else {})
    named = (system, "least_squares", label, observed_s, start)
    settings = fit_options(UntrainedOptions, *named, fitting, training=training, seeds=[0])
    stored = expert_alone(system, train, settings, described)
    if prior is None:
        found = of_expert_alone(stored, train, fitting.noise, fitting.settings)
        fitting = fitting.model_copy(update={"prior": found})
        stored = replace(stored, card=stored.card.but(refinement=fitting))
    model = TrainedModel(stored, single=True, refinement=stored.card.refinement)
    _ = model.predictor  # says what is wrong with the options
    return model


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
) -> OwnPrior:
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
        options: see :class:`expertaug.inference.settings.RefinementSettings`.

    Raises:
        InputError: windows of another shape, or least squares without a prior.
    """
    names = [p.name for p in model.system.expert_parameters]
    first = None if prior is None else arrays.ranges(prior, names, "prior")
    return found_by(
        model.stored, train, unlabelled, arrays.noise(noise), first, budget, RefinementSettings.from_mapping(options), u
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
    known, found = (refined.forecast(y, t, u=given) for y, given in ((seen.seen, seen.u), (unlabelled, u)))

    def flat(value: object) -> np.ndarray:
        return np.asarray(value, dtype=float).ravel()

    return {
        name: along(name, flat(found.z_e[name]), flat(found.chi2), flat(known.z_e[name]), flat(known.chi2))
        for name in found.z_e
    }

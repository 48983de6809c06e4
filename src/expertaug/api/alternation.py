"""Learning an interaction model without an encoder, in memory."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import TypedDict, Unpack

from expertaug import systems
from expertaug.api.arrays import Noise, Ranges
from expertaug.api.checks import check_sets, fit_options, refinement_of, seeds_of
from expertaug.api.own_ranges import of_expert_alone
from expertaug.api.trained import TrainedModel
from expertaug.inference.alternate import prepare
from expertaug.inference.settings import AlternateOptions, AlternatingSettings
from expertaug.learning.settings import UntrainedOptions
from expertaug.learning.train import expert_alone
from expertaug.models import describe
from expertaug.models.card import RecipeRecord
from expertaug.models.hybrid import HybridModel
from expertaug.models.settings import INTERACTION
from expertaug.systems import System
from expertaug.trajectories import Trajectories


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
    refinement: Mapping | None = None,
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
        refinement: how windows are fitted (:class:`expertaug.inference.settings.RefinementSettings`).
        options: see :class:`AlternatingOptions`.

    Returns:
        the best state of every seed; its estimates are fits of each window.

    Raises:
        InputError: an argument that cannot be used.
        SolveError: no seed can be trained.
    """
    recipe = HybridModel(system, {}, interaction)  # without an encoder
    check_sets(recipe, train, validation)
    part = describe.settings_of(INTERACTION, interaction)
    described = RecipeRecord.of(system=systems.describe(system), model={"interaction": part})
    fitting, training = refinement_of(system, refinement, noise, prior), AlternatingSettings.from_mapping(options)
    named = (system, "alternating", label, observed_s, start)
    chosen = seeds_of(seeds)
    if prior is None:
        of_expert = fit_options(UntrainedOptions, *named, fitting, seeds=chosen)
        alone = expert_alone(system, train, of_expert, described)
        found = of_expert_alone(alone, train, fitting.noise, fitting.settings)
        fitting = fitting.model_copy(update={"prior": found})
    settings = fit_options(AlternateOptions, *named, fitting, training=training, seeds=chosen)
    stored = prepare(system, train, validation, settings, described, describe.own_classes(recipe)).run()
    return TrainedModel(stored, single=len(chosen) == 1, refinement=stored.card.refinement)

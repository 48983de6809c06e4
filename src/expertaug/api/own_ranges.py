"""The default p⁺ of a user who gives none: ranges that it finds by itself."""

from __future__ import annotations

import logging
from collections.abc import Mapping

import numpy as np

from expertaug.api import arrays
from expertaug.api.arrays import Array, Ranges
from expertaug.api.trained import TrainedModel
from expertaug.errors import InputError
from expertaug.inference import own_prior as growing
from expertaug.inference.own_prior import OwnPrior
from expertaug.inference.prior_stage import SAMPLES
from expertaug.models.store import StoredModel
from expertaug.trajectories import Trajectories

logger = logging.getLogger(__name__)
BUDGET = 2.0  # the configuration's default too


def found_by(
    stored: StoredModel,
    train: Trajectories,
    unlabelled: Array | None,
    noise: float,
    first: Ranges | None,
    budget: float,
    options: Mapping | None,
) -> OwnPrior:
    """As :func:`expertaug.own_prior`, of at most 200 windows of each set, evenly spread."""
    observed = int(stored.description["observed"])
    index = np.linspace(0, len(train) - 1, min(SAMPLES, len(train))).astype(int)
    known = arrays.tensor(train.y[index], "train").movedim(1, 0)
    with arrays.one_thread():
        if unlabelled is None:
            return growing.own_prior_without_windows(stored, known, noise, float(budget), first, options)
        y = arrays.tensor(unlabelled, "unlabelled")
        if y.shape[1:] != train.y[:, :observed].shape[1:]:
            wanted = f"(N, {observed}, {', '.join(map(str, train.y.shape[2:]))})"
            raise InputError("unlabelled", f"has shape {tuple(y.shape)}", f"give {wanted}")
        y = y[np.linspace(0, len(y) - 1, min(SAMPLES, len(y))).astype(int)]
        return growing.own_prior(stored, known[:observed], y.movedim(1, 0), noise, first, options)


def given_or_found(model: TrainedModel, train: Trajectories, prior: Ranges | None, noise: float) -> dict:
    """The ranges that a user gave, checked; without any those that widen the training's as far as the model goes."""
    if prior is not None:
        return arrays.ranges(prior, [p.name for p in model.system.expert_parameters], "prior")
    arrays.trajectories(train, "train")
    if model.stored.description["kind"] == "mean":
        raise InputError("model", "a mean of the training set", "give a model with an expert")
    first = growing.box(model.system)  # beside the model's own estimates, which may be wrong
    found = found_by(model.stored, train, None, float(noise), first, BUDGET, None)  # type: ignore[arg-type]
    logger.info("p⁺: %s", found.says)
    return {name: list(ends) for name, ends in found.ranges.items()}


def of_expert_alone(stored: StoredModel, train: Trajectories, noise: float, options: Mapping) -> dict:
    """The same before anything is trained, by fits of the expert alone."""
    first, how = growing.box(stored.model.system), growing.searching(options)
    found = found_by(stored, train, None, float(noise), first, BUDGET, how)  # type: ignore[arg-type]
    logger.info("p⁺: %s", found.says)
    return {name: list(ends) for name, ends in found.ranges.items()}

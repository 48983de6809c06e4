"""The default p⁺ of a user who gives none: ranges that it finds by itself."""

from __future__ import annotations

import logging

import numpy as np
from torch import Tensor

from expertaug.api import arrays
from expertaug.api.arrays import Array, Ranges
from expertaug.api.trained import TrainedModel
from expertaug.errors import InputError
from expertaug.inference import own_prior as growing
from expertaug.inference.own_prior import OwnPrior
from expertaug.inference.prior_stage import SAMPLES
from expertaug.models.observation_noise import GivenNoise
from expertaug.models.settings import RefinementSettings
from expertaug.models.store import StoredModel
from expertaug.systems import System
from expertaug.systems.inputs import joined
from expertaug.trajectories import Trajectories

logger = logging.getLogger(__name__)
BUDGET = 2.0  # the configuration's default too


def found_by(
    stored: StoredModel,
    train: Trajectories,
    unlabelled: Array | None,
    noise: GivenNoise,
    first: Ranges | None,
    budget: float,
    options: RefinementSettings,
    u: Array | None = None,
) -> OwnPrior:
    """As :func:`expertaug.own_prior`, of at most 200 windows of each set, evenly spread."""
    observed = stored.card.observed
    index = np.linspace(0, len(train) - 1, min(SAMPLES, len(train))).astype(int)
    part, system, gaps = train.subset(index), stored.model.system, stored.card.start is not None
    known = _windows(arrays.tensor(part.seen, "train", gaps), part.u, system, part.t, "train.u")
    with arrays.one_thread():
        if unlabelled is None:
            return growing.own_prior_without_windows(stored, known, noise, float(budget), first, options)
        y = arrays.tensor(unlabelled, "unlabelled", gaps)
        if y.shape[1:] != train.y[:, :observed].shape[1:]:
            wanted = f"(N, {observed}, {', '.join(map(str, train.y.shape[2:]))})"
            raise InputError("unlabelled", f"has shape {tuple(y.shape)}", f"give {wanted}")
        windows = _windows(y, u, system, train.t[:observed], "u")
        windows = windows[:, np.linspace(0, len(y) - 1, min(SAMPLES, len(y))).astype(int)]
        return growing.own_prior(stored, known[:observed], windows, noise, first, options)


def _windows(y: Tensor, u: object, system: System, t: np.ndarray, name: str) -> Tensor:
    """States (N, T, *state) with the known inputs (N, T, U) as further components, (T, N, *observed)."""
    known = arrays.inputs(u, system, len(y), t, name)
    return joined(y.movedim(1, 0), None if known is None else known.movedim(1, 0))


def given_or_found(model: TrainedModel, train: Trajectories, prior: Ranges | None, noise: GivenNoise) -> dict:
    """The ranges that a user gave, checked; without any those that widen the training's as far as the model goes."""
    if prior is not None:
        return arrays.ranges(prior, [p.name for p in model.system.expert_parameters], "prior")
    arrays.trajectories(train, "train")
    if model.stored.card.kind == "mean":
        raise InputError("model", "a mean of the training set", "give a model with an expert")
    first = growing.box(model.system)  # beside the model's own estimates, which may be wrong
    found = found_by(model.stored, train, None, noise, first, BUDGET, RefinementSettings())  # type: ignore[arg-type]
    logger.info("p⁺: %s", found.says)
    return dict(found.ranges)


def of_expert_alone(stored: StoredModel, train: Trajectories, noise: GivenNoise, options: RefinementSettings) -> dict:
    """The same before anything is trained, by fits of the expert alone."""
    first, how = growing.box(stored.model.system), growing.searching(options)
    found = found_by(stored, train, None, noise, first, BUDGET, how)  # type: ignore[arg-type]
    logger.info("p⁺: %s", found.says)
    return dict(found.ranges)

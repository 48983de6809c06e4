"""Is a version's distribution calibrated on windows of its own making?  There a deviation is an error of inference."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import torch

from expertaug.evaluation.forecast_scores import DRAWN, Drawing
from expertaug.evaluation.samples import OWN, drawn_arrays, ranks_of
from expertaug.inference.own_draws import own_draws
from expertaug.inference.posterior_draws import z_e_draws
from expertaug.learning.bound import stored_bound
from expertaug.learning.noise import Noise
from expertaug.learning.sets import StackedSet
from expertaug.models.store import StoredModel
from expertaug.trajectories import Trajectories


@torch.no_grad()
def of_own_windows(
    stored: StoredModel, train: Trajectories, settings: Mapping, count: int, drawing: Drawing
) -> dict[str, np.ndarray]:
    """Ranks and scores on ``count`` windows that each seed's model has made, as of a set called own.

    Arguments:
        settings: as of :func:`own_draws`.
        drawing: how forecasts are drawn and scored.
    """
    device = drawing.t.device
    y, z_e = own_draws(stored, StackedSet.of(train, device).windows(len(train.t))[:, 0], settings, count)
    if not y.shape[2]:
        return {}
    found = stored.model.estimate(y[: drawing.observed])
    draws = z_e_draws(found)
    bound, random = stored_bound(stored.description, device), Noise(stored.seeds, DRAWN, device=device)
    scores = drawing.scores(stored.model, found, y, bound, random)
    each = None if draws is None else draws.cpu()
    return ranks_of(OWN, z_e.cpu().numpy(), each) | drawn_arrays(OWN, scores)

"""Which of a user's windows the model explains as well as validation windows, and a line of warning of the others."""

from __future__ import annotations

import logging
from collections.abc import Sequence

import numpy as np
from torch import Tensor

from expertaug.inference.alarm import threshold

FEWEST = 19  # validation windows of which one in twenty can be told
DOUBT = (
    "%d of %d windows are explained worse than 95 %% of the validation windows (trusted is False): the model may not "
    "hold there"
)
logger = logging.getLogger(__name__)


def judged(misfit: Tensor, kept: Sequence[Sequence[float]] | None) -> Tensor | None:
    """Whether misfits (S, N) are no larger than 95 % of the kept ones, a list a seed; None where these are not known.

    A window that at least half of the seeds do not explain is told in a warning.
    """
    if kept is None or min(map(len, kept)) < FEWEST:
        return None
    limits = misfit.new_tensor([threshold(np.array(one)) for one in kept])
    trusted = misfit <= limits.unsqueeze(1)
    doubtful = int((trusted.double().mean(0) <= 0.5).sum())
    if doubtful:
        logger.warning(DOUBT, doubtful, trusted.shape[1])
    return trusted

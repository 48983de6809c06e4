"""All ranks of one posterior on one kind of windows: what calibration figures and tables are made of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from expertaug.errors import InputError
from expertaug.inference.ranks import density_ranks, ranks, tarp_ranks
from expertaug.inference.sample_arrays import Array


@dataclass(frozen=True)
class Calibration:
    """Ranks of the truth among draws.

    Attributes:
        draws: K, the number of draws a window.
        marginal: of each parameter, (N, P).
        tarp: by distance from random points, (N,).
        density: by the posterior's density, (N,), or None where it has none.
    """

    draws: int
    marginal: np.ndarray
    tarp: np.ndarray
    density: np.ndarray | None = None


def calibration(
    samples: Array,
    truth: Array,
    log_prob_samples: Array | None = None,
    log_prob_truth: Array | None = None,
    seed: int = 0,
) -> Calibration:
    """Rank the truth among draws of a posterior, in each of the ways that :mod:`expertaug.inference.ranks` knows.

    Arguments:
        samples: parameters (K, N, P).
        truth: (N, P).
        log_prob_samples, log_prob_truth: the posterior's log density, (K, N) and (N,); both or neither.
        seed: of ties and reference points.

    Raises:
        InputError: the shapes disagree, a value is not finite, or one log density without the other.
    """
    if (log_prob_samples is None) != (log_prob_truth is None):
        raise InputError("calibration", "log density of one of samples and truth", "give both or neither")
    tarp = tarp_ranks(samples, truth, seed=seed)
    marginal = ranks(samples, truth, seed)
    density = None
    if log_prob_samples is not None and log_prob_truth is not None:
        density = density_ranks(log_prob_samples, log_prob_truth, seed)
        if density.shape != tarp.shape:
            raise InputError("log_prob_truth", f"of {len(density)} windows", f"give {len(tarp)}, as the truth")
    return Calibration(len(samples), marginal, tarp, density)

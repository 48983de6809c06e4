"""Scores of probabilistic forecasts from their draws: CRPS, energy score, error of the mean; lower is better.

Give the quantities that are compared, angles as their sine and cosine: a mean of angles is none.
"""

from __future__ import annotations

import numpy as np

from expertaug.errors import InputError
from expertaug.inference.diagnostics.arrays import Array, draws_and_truth


def crps(samples: Array, truth: Array) -> np.ndarray:
    """Continuous ranked probability score of each component (Gneiting & Raftery 2007, section 4.2), in its unit.

    The fair estimator, whose expectation does not depend on the number of draws: E|X − y| − ½ E|X − X'| over different
    draws (Ferro 2014).  Of a single value said for sure it would be the absolute error.

    Arguments:
        samples: (K, N, …), at least two draws.
        truth: (N, …).

    Returns:
        (N, …).

    Raises:
        InputError: the shapes disagree, a value is not finite, or there is a single draw.
    """
    draws, true = draws_and_truth(samples, truth, least=2)
    k = len(draws)
    weight = (2 * np.arange(k) - k + 1).reshape(-1, *[1] * true.ndim)  # how often each draw is the upper of a pair
    apart = (weight * np.sort(draws, axis=0)).sum(0) / (k * (k - 1))
    return np.abs(draws - true).mean(0) - apart


def energy_score(samples: Array, truth: Array) -> np.ndarray:
    """The CRPS of vectors, by Euclidean distance (Gneiting & Raftery 2007, section 4.3), with the fair estimator.

    Arguments:
        samples: (K, N, …, D), at least two draws; the last axis is the vector.
        truth: (N, …, D).

    Returns:
        (N, …): of forecasts (K, N, T, D) a score of each window and time.

    Raises:
        InputError: as :func:`crps`, or no vectors.
    """
    draws, true = draws_and_truth(samples, truth, least=2)
    if true.ndim < 2:
        raise InputError("energy_score", f"truth of shape {true.shape}", "give (N, …, D), or numbers to crps")
    k = len(draws)
    apart = sum(np.linalg.norm(draws[i + 1 :] - draws[i], axis=-1).sum(0) for i in range(k - 1))
    return np.linalg.norm(draws - true, axis=-1).mean(0) - apart / (k * (k - 1))


def log_mse_of_mean(samples: Array, truth: Array) -> float:
    """Natural log of the mean, over windows and times, of the squared error of the predictive mean.

    Squared errors are summed over the observed dimensions, as in the paper's tables (``log_mse_sum``).

    Arguments:
        samples: observed quantities (K, N, T, …).
        truth: (N, T, …).

    Raises:
        InputError: the shapes disagree, a value is not finite, or there is no axis of times.
    """
    draws, true = draws_and_truth(samples, truth)
    if true.ndim < 2:
        raise InputError("log_mse_of_mean", f"truth of shape {true.shape}", "give (N, T, …)")
    squared = np.square(draws.mean(0) - true)
    return float(np.log(squared.reshape(*true.shape[:2], -1).sum(-1).mean()))

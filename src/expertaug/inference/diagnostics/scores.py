"""Scores of probabilistic forecasts from their draws: CRPS, energy score, error of the mean; lower is better.

Give the quantities that are compared, angles as their sine and cosine: a mean of angles is none.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from expertaug.errors import InputError
from expertaug.inference.diagnostics.arrays import Array, draws_and_truth

IN_CACHE = 2**16  # numbers that a core keeps at hand: all windows at once take three times as long
FEW = 8  # components: NumPy sums fewer one after the other, and each sum takes as long as one of many


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
    k, scores = len(draws), np.empty(true.size)
    weight = (2 * np.arange(k) - k + 1)[:, None]  # how often each draw is the upper of a pair
    columns, flat = draws.reshape(k, -1), true.reshape(-1)
    for part in _parts(true.size, k):
        here = columns[:, part]
        apart = (weight * np.sort(here, axis=0)).sum(0) / (k * (k - 1))
        scores[part] = np.abs(here - flat[part]).mean(0) - apart
    return _laid_out(scores, true)


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
    k, size = len(draws), true.shape[-1]
    vectors, flat, scores = draws.reshape(k, -1, size), true.reshape(-1, size), np.empty(true[..., 0].size)
    if size < FEW:
        vectors, flat = _by_component(vectors), _by_component(flat)
    for part in _parts(len(flat), k * size):
        here = vectors[:, part]
        apart = sum(_lengths(here[i + 1 :] - here[i]).sum(0) for i in range(k - 1))
        scores[part] = _lengths(here - flat[part]).mean(0) - apart / (k * (k - 1))
    return _laid_out(scores, true[..., 0])


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


def _parts(count: int, each: int) -> Iterator[slice]:
    """Slices of ``count`` places with ``each`` numbers that a core's cache holds, none of a single place: NumPy adds up
    its draws in another order."""
    number = max(1, count // max(2, IN_CACHE // each))
    return (slice(*ends) for ends in pairwise(count * k // number for k in range(number + 1)))


def _by_component(vectors: np.ndarray) -> np.ndarray:
    """Vectors (…, D) with each component by itself in memory."""
    return np.moveaxis(np.ascontiguousarray(np.moveaxis(vectors, -1, 0)), 0, -1)


def _lengths(vectors: np.ndarray) -> np.ndarray:
    """Of vectors (…, D), which it overwrites: (…)."""
    return np.sqrt(np.square(vectors, out=vectors).sum(-1))


def _laid_out(values: np.ndarray, like: np.ndarray) -> np.ndarray:
    """Values in the shape of an array, and in its order in memory, in which NumPy adds up."""
    result = np.empty_like(like)
    result[...] = values.reshape(like.shape)
    return result

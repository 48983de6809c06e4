"""Where the truth lies among draws of a posterior: ranks, which are uniform exactly when the posterior is calibrated.

A rank counts the draws on one side of the truth.  With K draws of the right posterior it is uniform on 0 … K, whatever
the side is measured by: the parameter itself (simulation-based calibration: Talts et al. 2018), the posterior's density
(Hermans et al. 2022) or the distance from a random point (TARP: Lemos et al. 2023).  Ties, as of a quantity that is
known exactly, are broken by chance, so that they stay uniform too.
"""

from __future__ import annotations

import numpy as np

from expertaug.errors import InputError
from expertaug.inference.sample_arrays import Array, draws_and_truth, plain


def ranks(samples: Array, truth: Array, seed: int = 0) -> np.ndarray:
    """The number of draws below the truth, of each component by itself.

    Arguments:
        samples: K draws for each of N windows, (K, N, …): parameters (K, N, P), or forecasts (K, N, T, D).
        truth: (N, …).
        seed: breaks ties.

    Returns:
        (N, …), whole numbers from 0 to K.

    Raises:
        InputError: the shapes disagree, or a value is not finite.
    """
    return _ranks(*draws_and_truth(samples, truth), seed)


def density_ranks(log_prob_samples: Array, log_prob_truth: Array, seed: int = 0) -> np.ndarray:
    """The number of draws that the posterior holds likelier than the truth (Hermans et al. 2022).

    Arguments:
        log_prob_samples: the posterior's log density of its own draws, (K, N); a constant of the window cancels.
        log_prob_truth: of the truth, (N,).

    Returns:
        (N,), from 0 (the truth is likelier than any draw) to K.

    Raises:
        InputError: as :func:`ranks`.
    """
    draws, true = draws_and_truth(log_prob_samples, log_prob_truth)
    return _ranks(-draws, -true, seed)


def tarp_ranks(samples: Array, truth: Array, references: Array | None = None, seed: int = 0) -> np.ndarray:
    """The number of draws nearer than the truth to a random reference point (TARP: Lemos et al. 2023, algorithm 2).

    Components are divided by the range of the true values first, since their units differ.

    Arguments:
        samples: (K, N, P).
        truth: (N, P).
        references: (N, P); default: uniform over the box of the true values, from the seed.
        seed: of the reference points and of ties.

    Returns:
        (N,), from 0 to K.

    Raises:
        InputError: as :func:`ranks`, or not (N, P).
    """
    draws, true = draws_and_truth(samples, truth)
    if true.ndim != 2:
        raise InputError("truth", f"has shape {true.shape}", "give (N, P)")
    low, high = true.min(0), true.max(0)
    if references is None:
        points = np.random.default_rng([seed, 1]).uniform(low, high, true.shape)
    else:
        points = plain(references, "references")
        if points.shape != true.shape:
            raise InputError("references", f"have shape {points.shape}", f"give {true.shape}, as the truth")
    scale = np.where(high > low, high - low, 1.0)
    far, true_far = (np.linalg.norm((value - points) / scale, axis=-1) for value in (draws, true))
    return _ranks(far, true_far, seed)


def check(found: Array, draws: int) -> np.ndarray:
    """Ranks (N, …) as whole numbers.

    Raises:
        InputError: one is none from 0 to ``draws``.
    """
    given = plain(found, "ranks")
    if given.ndim < 1 or (given != np.round(given)).any() or given.min() < 0 or given.max() > draws:
        raise InputError("ranks", f"from {given.min():g} to {given.max():g}", f"give whole numbers from 0 to {draws}")
    return given.astype(np.int64)


def _ranks(draws: np.ndarray, true: np.ndarray, seed: int) -> np.ndarray:
    ties = (draws == true).sum(0)
    return (draws < true).sum(0) + np.random.default_rng([seed, 0]).integers(0, ties + 1)

"""Calibration of a posterior: ranks of the truth among its draws, and the coverage that follows from them.

A rank counts the draws on one side of the truth.  With K draws of the right posterior it is uniform on 0 … K, whatever
the side is measured by: the parameter itself (simulation-based calibration: Talts et al. 2018), the posterior's density
(Hermans et al. 2022) or the distance from a random point (TARP: Lemos et al. 2023); and only then does what is said to
hold 90 % hold 90 %.  Ties, as of a quantity that is known exactly, are broken by chance, so that they stay uniform too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from expertaug.errors import InputError
from expertaug.inference.diagnostics.arrays import Array, draws_and_truth, plain

LEVELS = tuple(np.arange(1, 20) / 20)
TABLE_LEVELS = (0.5, 0.9)  # of the intervals that tables show
EXACT = 1e-9  # what rounding may add to level · (K + 1)


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


def check_ranks(ranks: Array, draws: int) -> np.ndarray:
    """Ranks (N, …) as whole numbers.

    Raises:
        InputError: one is none from 0 to ``draws``.
    """
    numbers = plain(ranks, "ranks")
    low, high = numbers.min(), numbers.max()
    if numbers.ndim < 1 or (numbers != np.round(numbers)).any() or low < 0 or high > draws:
        raise InputError("ranks", f"from {low:g} to {high:g}", f"give whole numbers from 0 to {draws}")
    return numbers.astype(np.int64)


def _ranks(draws: np.ndarray, true: np.ndarray, seed: int) -> np.ndarray:
    below, ties = _count(draws < true), _count(draws == true)
    return below + np.random.default_rng([seed, 0]).integers(0, ties + 1) if ties.any() else below


def _count(marks: np.ndarray) -> np.ndarray:
    """How many of K marks (K, N, …) are set, (N, …); summed as small numbers, which takes half the time."""
    small = np.uint8 if len(marks) <= np.iinfo(np.uint8).max else np.int64
    return marks.sum(0, dtype=small).astype(np.int64)


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
    """Rank the truth among draws of a posterior, marginally, by TARP and by density.

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


@dataclass(frozen=True)
class Coverage:
    """Shares of windows whose truth lies within what is to hold it with a probability.

    Attributes:
        level: that probability, (L,).
        share: of the windows, (L, …).
        lower, upper: Clopper and Pearson's interval of each share, (L, …); windows are taken as independent.
    """

    level: np.ndarray
    share: np.ndarray
    lower: np.ndarray
    upper: np.ndarray


def expected_coverage(ranks: Array, draws: int, levels: Sequence[float] = LEVELS) -> Coverage:
    """Coverage of the regions by which ranks count outwards: of highest density, or around TARP's reference points.

    A posterior that is too narrow (too sure) covers less than the level, one that is too wide more.

    Arguments:
        ranks: (N, …) of ``density_ranks`` or ``tarp_ranks``.
        draws: K.
        levels: between 0 and 1; exact where level · (K + 1) is whole.

    Raises:
        InputError: ranks beyond 0 … K, or levels beyond 0 and 1.
    """
    return _coverage(check_ranks(ranks, draws), draws, levels)


def interval_coverage(ranks: Array, draws: int, levels: Sequence[float] = LEVELS) -> Coverage:
    """Coverage of central intervals: as much probability below as above.

    Of parameters it says whether their intervals hold, of forecasts, with ranks (N, T, D), whether their bands do at
    each time.  K draws cannot make an interval of more than (K − 1) / (K + 1).

    Arguments:
        ranks: (N, …) of ``ranks``.
        draws, levels: as for :func:`expected_coverage`.

    Raises:
        InputError: as :func:`expected_coverage`.
    """
    return _coverage(np.abs(2 * check_ranks(ranks, draws) - draws), draws, levels)


def inside(ranks: Array, draws: int, levels: Sequence[float]) -> np.ndarray:
    """Whether truths lie in the central intervals: (L, …) of ranks (N, …) of ``ranks``; errors as above."""
    return _within(np.abs(2 * check_ranks(ranks, draws) - draws), draws, np.asarray(levels, dtype=np.float64))


def area_to_curve(ranks: Array, draws: int) -> np.ndarray:
    """The area between the expected coverage and the diagonal, above a level of one half (ATC of TARP).

    Above 0 (at most 1/8) the posterior is too wide, below 0 (at least −3/8) too narrow.

    Arguments:
        ranks, draws: as for :func:`expected_coverage`.

    Returns:
        (…), a number for ranks (N,).
    """
    place = (check_ranks(ranks, draws) + 0.5) / (draws + 1)  # the middle of the rank's step
    return (1 - np.maximum(place, 0.5)).mean(0) - 0.375


def binomial_interval(count: np.ndarray, n: int | np.ndarray, level: float = 0.95) -> tuple[np.ndarray, np.ndarray]:
    """Clopper and Pearson's interval of a share: ``count`` of ``n`` independent trials."""
    from scipy.stats import beta  # half a second that an evaluation, which takes `inside` alone, does not need

    tail, count = (1 - level) / 2, np.asarray(count)
    with np.errstate(invalid="ignore"):
        lower = np.where(count > 0, beta.ppf(tail, count, n - count + 1), 0.0)
        upper = np.where(count < n, beta.ppf(1 - tail, count + 1, n - count), 1.0)
    return lower, upper


def _coverage(outward: np.ndarray, draws: int, levels: Sequence[float]) -> Coverage:
    level = np.asarray(levels, dtype=np.float64)
    if level.ndim != 1 or not level.size or not ((level > 0) & (level < 1)).all():
        raise InputError("levels", f"found {levels!r}", "give numbers between 0 and 1, as [0.5, 0.9]")
    count = _within(outward, draws, level).sum(1)
    n = len(outward)
    return Coverage(level, count / n, *binomial_interval(count, n))


def _within(outward: np.ndarray, draws: int, level: np.ndarray) -> np.ndarray:
    return np.stack([outward < share * (draws + 1) - EXACT for share in level])

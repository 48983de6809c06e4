"""Does what is said to hold 90 % hold 90 %?  Expected coverage of regions and intervals, from ranks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from expertaug.errors import InputError
from expertaug.inference import ranks as rank_arrays
from expertaug.inference.sample_arrays import Array

LEVELS = tuple(np.arange(1, 20) / 20)
TABLE_LEVELS = (0.5, 0.9)  # of the intervals that tables show
EXACT = 1e-9  # what rounding may add to level · (K + 1)


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
    return _coverage(rank_arrays.check(ranks, draws), draws, levels)


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
    return _coverage(np.abs(2 * rank_arrays.check(ranks, draws) - draws), draws, levels)


def inside(ranks: Array, draws: int, levels: Sequence[float]) -> np.ndarray:
    """Whether truths lie in the central intervals: (L, …) of ranks (N, …) of ``ranks``; errors as above."""
    return _within(np.abs(2 * rank_arrays.check(ranks, draws) - draws), draws, np.asarray(levels, dtype=np.float64))


def area_to_curve(ranks: Array, draws: int) -> np.ndarray:
    """The area between the expected coverage and the diagonal, above a level of one half (ATC of TARP).

    Above 0 (at most 1/8) the posterior is too wide, below 0 (at least −3/8) too narrow.

    Arguments:
        ranks, draws: as for :func:`expected_coverage`.

    Returns:
        (…), a number for ranks (N,).
    """
    place = (rank_arrays.check(ranks, draws) + 0.5) / (draws + 1)  # the middle of the rank's step
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
    return np.stack([outward < one * (draws + 1) - EXACT for one in level])

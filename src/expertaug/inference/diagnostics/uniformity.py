"""Are ranks uniform?  Simultaneous confidence bands of their empirical distribution, and an exact p-value.

Säilynoja, Bürkner & Vehtari, "Graphical test for discrete uniformity and its applications in goodness-of-fit evaluation
and multiple sample comparison", Statistics and Computing 32, 2022: at each point the count of ranks is binomial; the
pointwise intervals are widened until all of them together hold with the wanted probability.  That probability comes
from a recursion over the points, as in their second method, not from simulation: it is exact, and has no seed.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.special import gammaln
from scipy.stats import binom

from expertaug.errors import InputError
from expertaug.inference.diagnostics.arrays import Array
from expertaug.inference.diagnostics.calibration import check_ranks

POINTS = 200  # at most, at which the distribution is compared
STEPS = 40  # of the bisection for the pointwise level
SMALLEST = 1e-20  # error of a pointwise interval; below it nothing changes


@dataclass(frozen=True)
class Uniformity:
    """The empirical distribution of ranks beside the uniform one.

    Attributes:
        level: the share of ranks expected up to each of G points, (G,).
        share: the share found, (G, …).
        lower, upper: the band that holds all of a uniform ``share`` with probability ``confidence``, (G,).
        p_value: probability of a deviation as large, were the ranks uniform: of each component, (…).
        confidence: of the band.
    """

    level: np.ndarray
    share: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    p_value: np.ndarray
    confidence: float

    @property
    def uniform(self) -> np.ndarray:
        """Whether the share lies within the band everywhere, (…)."""
        return self.p_value > 1 - self.confidence


def uniformity(ranks: Array, draws: int, confidence: float = 0.95) -> Uniformity:
    """Compare ranks with the uniform distribution on 0 … ``draws``.

    Windows are taken as independent: give those of one seed at a time.

    Arguments:
        ranks: (N, …), as the functions of :mod:`expertaug.inference.diagnostics.calibration` return them.
        draws: K, the number of draws a window.
        confidence: of the band, simultaneously at all points (but for each component by itself).

    Raises:
        InputError: ranks beyond 0 … K, or a confidence that is none.
    """
    if not 0 < confidence < 1:
        raise InputError("confidence", f"found {confidence!r}", "give a number between 0 and 1, as 0.95")
    checked = check_ranks(ranks, draws)
    n = len(checked)
    last = _last_ranks(draws)
    level = (last + 1) / (draws + 1)
    flat = checked.reshape(n, -1)
    counts = np.stack([np.searchsorted(np.sort(column), last, side="right") for column in flat.T], axis=1)
    p_value = np.array([_p_value(column, n, level) for column in counts.T])
    lower, upper = _bounds(_pointwise(n, draws, confidence), n, level)
    shape = checked.shape[1:]
    return Uniformity(level, counts.reshape(-1, *shape) / n, lower / n, upper / n, p_value.reshape(shape), confidence)


def _last_ranks(draws: int) -> np.ndarray:
    """The ranks at which the distributions are compared; at the last of all, K, both are 1."""
    return np.unique(np.linspace(0, draws - 1, min(draws, POINTS)).round().astype(int))


def _p_value(counts: np.ndarray, n: int, level: np.ndarray) -> float:
    tails = np.minimum(binom.cdf(counts, n, level), binom.sf(counts - 1, n, level))
    return max(0.0, 1 - _inside(2 * tails.min() * (1 + 1e-9), n, level))


@lru_cache(maxsize=64)
def _pointwise(n: int, draws: int, confidence: float) -> float:
    """The largest error of the pointwise intervals at which all of them hold with the wanted probability."""
    level = (_last_ranks(draws) + 1) / (draws + 1)
    low, high = np.log((1 - confidence) / (2 * len(level))), 0.0  # Bonferroni's lies below
    for _ in range(STEPS):
        middle = (low + high) / 2
        if _inside(np.exp(middle), n, level) >= confidence:
            low = middle
        else:
            high = middle
    return float(np.exp(low))


def _bounds(error: float, n: int, level: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Counts whose tails, on both sides, are at least error / 2."""
    return binom.ppf(error / 2, n, level).astype(int), n - binom.ppf(error / 2, n, 1 - level).astype(int)


def _inside(error: float, n: int, level: np.ndarray) -> float:
    """The probability that n uniform values stay within the pointwise intervals at every point.

    Their counts grow from point to point as those of a Poisson process do, given that it ends at n.
    """
    lower, upper = _bounds(min(max(error, SMALLEST), 1.0), n, level)
    if (lower > upper).any():
        return 0.0
    reached, start = np.ones(1), 0
    for low, high, step in zip(lower, upper, np.diff(level, prepend=0.0), strict=True):
        grown = np.convolve(reached, _poisson(np.arange(high - start + 1), n * step))
        # grown[k] belongs to the count start + k; neither bound ever falls.
        reached, start = grown[low - start : high - start + 1], low
    ended = reached @ _poisson(n - (start + np.arange(len(reached))), n * (1 - level[-1]))
    return float(ended / _poisson(np.array([n]), float(n))[0])


def _poisson(counts: np.ndarray, mean: float) -> np.ndarray:
    return np.exp(counts * np.log(mean) - mean - gammaln(counts + 1))

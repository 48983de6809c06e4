"""Intervals and tests that weigh two sources of spread: the seeds of a training and the samples of a set.

Every statistic here is a mean over seeds of a function of a seed's samples.  All seeds see the same samples, so that
the two are resampled independently of each other, crossed (the pigeonhole bootstrap: Owen, Annals of Applied Statistics
1, 2007).  A bootstrap of few units is too narrow, and three seeds have ten resamples; each source's deviations are
therefore multiplied by sqrt(n / (n − 1)) and by an own draw of sqrt((n − 1) / χ²), n its number of units, which gives
normal ones Student's t distribution (Hesterberg, The American Statistician 69, 2015, has both corrections).

The same numbers give the same bits: the random numbers depend on nothing but the numbers of units.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

SEED = 20
RESAMPLES = 2000
LEVEL = 0.95  # of every interval; a difference is told apart where p < 1 − LEVEL
ONE_DEVIATION = 0.6827  # of a normal distribution, within one standard deviation
FEWEST_RECORDINGS = 5  # of fewer, stretches are resampled
STRETCHES = 10  # of all recordings together, where they are fewer
VALUES = 2**22  # held at a time by :func:`log_median`


@dataclass(frozen=True)
class Resampled:
    """A statistic of every seed.

    Attributes:
        value: of the samples as they are, (S,).
        drawn: of each resample of them, (RESAMPLES, S); two that come from the same number of units have the same
            resamples, which makes their difference one of pairs.
        units: number of units that were resampled.
    """

    value: np.ndarray
    drawn: np.ndarray
    units: int

    def __sub__(self, other: Resampled) -> Resampled:
        """The difference, seed by seed and sample by sample."""
        return Resampled(self.value - other.value, self.drawn - other.drawn, min(self.units, other.units))

    def of(self, places: list[int]) -> Resampled:
        """The same of some of the seeds."""
        return Resampled(self.value[places], self.drawn[:, places], self.units)


@dataclass(frozen=True)
class Interval:
    """A mean over seeds with its interval.

    Attributes:
        mean: of the seeds.
        low, high: ends of the 95 % interval, NaN where nothing says how samples differ.
        p: of a mean of 0, two-sided; NaN of one seed, since another may differ by more.
    """

    mean: float
    low: float
    high: float
    p: float

    @property
    def told_apart(self) -> bool:
        """Whether the mean differs from 0."""
        return self.p < 1 - LEVEL


def units_of(identity: np.ndarray | None, count: int) -> np.ndarray:
    """What is resampled as a whole: the number of its unit for every sample, (N,).

    Simulated samples are independent: each is a unit.  Chunks of a recording overlap: a unit is a recording; where
    there are fewer than five, a stretch of consecutive chunks of one recording, ten or more in all.

    Arguments:
        identity: ``recording/first frame`` of each sample, (N,); None for simulated ones.
        count: N.
    """
    if identity is None:
        return np.arange(count)
    recordings, first = zip(*(str(sample_id).rsplit("/", 1) for sample_id in identity), strict=True)
    names, recording = np.unique(recordings, return_inverse=True)
    if len(names) >= FEWEST_RECORDINGS:
        return recording
    each = -(-STRETCHES // len(names))
    stretch = np.empty(count, dtype=int)
    for place in range(len(names)):
        chunks = np.flatnonzero(recording == place)
        ranks = np.argsort(np.argsort(np.array(first, dtype=int)[chunks], kind="stable"), kind="stable")
        stretch[chunks] = place * each + ranks * each // len(chunks)
    return np.unique(stretch, return_inverse=True)[1]


def log_mean(errors: np.ndarray, unit: np.ndarray) -> Resampled:
    """Log of the mean over samples: the log-MSE of squared errors.

    Arguments:
        errors: (S, N).
        unit: of each sample, as of :func:`units_of`.
    """
    return _of_means(errors, unit, np.log)


def mean(errors: np.ndarray, unit: np.ndarray) -> Resampled:
    """Mean over samples; arguments as of :func:`log_mean`."""
    return _of_means(errors, unit, np.asarray)


def log_median(errors: np.ndarray, unit: np.ndarray) -> Resampled:
    """Log of the median over samples; arguments as of :func:`log_mean`."""
    counts, order = resamples(int(unit.max()) + 1), np.argsort(errors, axis=1)
    drawn = np.empty((RESAMPLES, len(errors)))
    size = max(1, VALUES // errors.shape[1])
    for seed, places in enumerate(order):
        ranked, units = errors[seed, places], unit[places]
        for first in range(0, RESAMPLES, size):
            passed = np.cumsum(counts[units, first : first + size], axis=0, dtype=np.int32)
            half = passed[-1] / 2
            lower, upper = (passed < half).sum(0), (passed <= half).sum(0)
            drawn[first : first + size, seed] = (ranked[lower] + ranked[upper]) / 2
    return Resampled(np.log(np.median(errors, axis=1)), np.log(drawn), int(unit.max()) + 1)


def interval(statistic: Resampled, not_negative: bool = False) -> Interval:
    """The mean over seeds with its interval; of one seed it contains the spread over samples alone, and p is NaN.

    Arguments:
        not_negative: whether the statistic cannot be negative: its interval is then one of the logarithm of the mean,
            whose ends are taken back, so that none lies below 0. Where a resample's mean is 0, which has no logarithm,
            the plain interval is cut off at 0. A mean of 0 is no hypothesis then: p is NaN.
    """
    mean, seeds = float(statistic.value.mean()), len(statistic.value)
    plain = _interval(mean, deviations(statistic), seeds)
    if not not_negative:
        return plain
    far = _log_deviations(statistic)
    if far is None:
        return replace(plain, low=float(np.maximum(plain.low, 0.0)), p=np.nan)
    ends = _interval(float(np.log(mean)), far, seeds)
    return Interval(mean, float(np.exp(ends.low)), float(np.exp(ends.high)), np.nan)


def of_seeds(values: np.ndarray, not_negative: bool = False) -> Interval:
    """The mean of a value of each seed (S,) with the interval that the spread over seeds alone gives; of one seed there
    is none."""
    if len(values) < 2:
        return Interval(float(values.mean()) if len(values) else np.nan, np.nan, np.nan, np.nan)
    return interval(Resampled(values, np.tile(values, (RESAMPLES, 1)), 2), not_negative)  # samples do not differ


def standard_error(statistic: Resampled) -> float:
    """Of the mean over seeds: what two thirds of the deviations stay below, since with few seeds their square has no
    mean; NaN of a single unit."""
    far = np.abs(deviations(statistic))
    return float(np.quantile(far, ONE_DEVIATION)) if np.isfinite(far).all() else np.nan


def against(statistic: Resampled, mean: float, std: float, runs: int, rounded: float = 0.0) -> Interval:
    """The difference of a mean over seeds from a published one.

    Theirs is as far from what it estimates as ``runs`` values of a normal distribution let it be; how their samples
    spread is not known.

    Arguments:
        mean, std, runs: as published; one run has no known spread: it is taken for exact.
        rounded: the last digit that is printed.
    """
    rng = np.random.default_rng([SEED, runs])
    theirs = rounded * rng.uniform(-0.5, 0.5, RESAMPLES)
    if runs > 1:
        theirs += std / np.sqrt(runs) * rng.standard_t(runs - 1, RESAMPLES)
    return _interval(float(statistic.value.mean()) - mean, deviations(statistic) - theirs, len(statistic.value))


def deviations(statistic: Resampled) -> np.ndarray:
    """How far the mean over seeds may be from what it estimates, (RESAMPLES,); NaN of a single unit."""
    seeds, centre = len(statistic.value), statistic.value.mean()
    of_samples = statistic.drawn.mean(1)
    far = (of_samples - centre) * _widen(statistic.units, "samples")
    if seeds > 1:
        weights = resamples(seeds, "seeds").T / seeds
        far = far + ((statistic.drawn - of_samples[:, None]) * weights).sum(1) * _widen(seeds, "seeds")
    return far


def _log_deviations(statistic: Resampled) -> np.ndarray | None:
    """How far the logarithm of the mean over seeds may be from what it estimates, (RESAMPLES,); None where a mean is 0:
    as :func:`deviations`, with quotients in the place of differences."""
    seeds, centre = len(statistic.value), statistic.value.mean()
    of_samples = statistic.drawn.mean(1)
    of_both = (statistic.drawn * resamples(seeds, "seeds").T).sum(1) / seeds
    if not (centre > 0 and (of_samples > 0).all() and (of_both > 0).all()):
        return None
    far = np.log(of_samples / centre) * _widen(statistic.units, "samples")
    return far + np.log(of_both / of_samples) * _widen(seeds, "seeds") if seeds > 1 else far


@lru_cache(maxsize=8)
def resamples(units: int, source: str = "samples") -> np.ndarray:
    """How often each unit is in each resample, (units, RESAMPLES)."""
    rng = np.random.default_rng([SEED, len(source), units])
    drawn = rng.multinomial(units, np.full(units, 1 / units), RESAMPLES)
    return np.ascontiguousarray(drawn.T.astype(np.int16))


@lru_cache(maxsize=32)
def _widen(units: int, source: str) -> np.ndarray:
    """Factors that make the deviations of resampled means those of Student's t; a single unit says nothing."""
    if units < 2:
        return np.full(RESAMPLES, np.nan)
    rng = np.random.default_rng([SEED, len(source), units, 1])
    return np.sqrt(units / rng.chisquare(units - 1, RESAMPLES))


def _of_means(errors: np.ndarray, unit: np.ndarray, transform: Callable[[np.ndarray], np.ndarray]) -> Resampled:
    units = int(unit.max()) + 1
    sums = np.stack([np.bincount(unit, minlength=units), *(np.bincount(unit, of_seed, units) for of_seed in errors)])
    sizes, *sums = sums @ resamples(units).astype(float)
    return Resampled(transform(errors.mean(1)), transform(np.stack(sums, axis=1) / sizes[:, None]), units)


def _interval(mean: float, far: np.ndarray, seeds: int) -> Interval:
    if not (np.isfinite(mean) and np.isfinite(far).all()):
        return Interval(mean, np.nan, np.nan, np.nan)
    outside = (1 - LEVEL) / 2
    low, high = np.quantile(mean + far, [outside, 1 - outside])
    tails = min((mean + far <= 0).sum(), (mean + far >= 0).sum())
    p = min(1.0, 2 * (tails + 1) / (RESAMPLES + 1)) if seeds > 1 else np.nan
    return Interval(mean, float(low), float(high), float(p))

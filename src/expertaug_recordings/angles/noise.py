"""The markers' noise, from what does not move: the lengths of the arms.

An arm's length is constant, so that whatever it varies by is error of its two markers.  Their errors across the arm,
which are those of its angle, are as large and as correlated from frame to frame (seen on rendered recordings of 30 to
400 Hz, within a tenth): the noise of an angle follows without any model of the motion, at any frame rate.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

LEAST_SHARE = 0.25  # of a length's variance that either of its markers has
PASSES = 4
TRIMMED = 5.0  # robust standard deviations: lengths further off are faults, not noise
LEAST_PX = 0.005  # of an arm's length: below, it was not measured but made


@dataclass(frozen=True)
class Noise:
    """Noise of the two angles.

    Attributes:
        std: standard deviation in rad, (2,).
        correlation: of errors so many frames apart, (lags, 2), from 1 at lag 0.
    """

    std: np.ndarray
    correlation: np.ndarray

    def variance(self, weights: np.ndarray, k: int) -> float:
        """Variance in rad² of a weighted sum of neighbouring frames' angles k; ``weights`` (m,)."""
        correlation = self.correlation[: len(weights), k]
        lags = np.abs(np.subtract.outer(np.arange(len(weights)), np.arange(len(weights))))
        matrix = np.where(lags < len(correlation), correlation[np.minimum(lags, len(correlation) - 1)], 0.0)
        return float(self.std[k] ** 2 * max(weights @ matrix @ weights, 0.0))


def spread(values: np.ndarray) -> np.ndarray:
    """Robust standard deviation along the first axis, NaN left out."""
    return 1.4826 * np.nanmedian(np.abs(values - np.nanmedian(values, axis=0)), axis=0)


def fit_trimmed(
    design: np.ndarray, target: np.ndarray, used: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float, np.ndarray]:
    """Least squares without what is far off.

    Arguments:
        design, target: (n, k) and (n,).
        used: (n,), rows to begin with.

    Returns:
        the coefficients (k,), what they leave (n,), the rows that were kept at the end (n,), the noise of these, and
        (XᵀX)⁻¹ (k, k): times the square of the noise the coefficients' covariance.
    """
    for _ in range(PASSES):
        x, *_ = np.linalg.lstsq(design[used], target[used], rcond=None)
        off = target - design @ x
        noise = max(float(spread(off[used])), 1e-9)
        used = np.abs(off) < TRIMMED * noise
    return x, off, used, noise, np.linalg.pinv(design[used].T @ design[used], hermitian=True)


def measure_noise(lengths: np.ndarray, usable: np.ndarray, lags: int) -> tuple[Noise, np.ndarray]:
    """Noise of the angles of two arms, and of their lengths in px, (2,).

    Arguments:
        lengths: of the arms in px, (n, 2).
        usable: (n,), frames that count.
        lags: frames over which errors may be correlated.
    """
    typical = np.median(lengths[usable], axis=0)
    off = np.where(usable[:, None], lengths - typical, np.nan)
    limit = TRIMMED * np.maximum(spread(off), LEAST_PX)
    off = np.where(np.abs(off) < limit, off, np.nan)
    off = np.nan_to_num(off - np.nanmean(off, axis=0))
    count = np.maximum((off != 0).sum(0), 1)
    power = (off**2).sum(0)
    # Divided by the number of frames, not of pairs: no combination of frames then has a negative variance.
    correlation = np.stack([(off[lag:] * off[: len(off) - lag]).sum(0) for lag in range(min(lags, len(off)))])
    correlation = np.where(power > 0, correlation / np.maximum(power, 1e-12), 0.0)
    correlation[0] = 1.0
    std = np.maximum(np.sqrt(power / count), LEAST_PX)
    return Noise(std / typical, correlation), std


def marker_noise(length_std: np.ndarray, pivot: np.ndarray, averaged: np.ndarray) -> np.ndarray:
    """Standard deviations in px of the coordinates of pivot, joint and tip, (3,).

    A length's variance is the sum of its two ends' along the arm.

    Arguments:
        length_std: of the two arms' lengths in px, (2,).
        pivot: its marker's places (n, 2) in px; NaN where it was not seen.
        averaged: places (n, 2) in px that stood for the pivot.
    """
    first, second = length_std**2
    scatter = float(np.mean(spread(pivot - averaged) ** 2))
    # A pivot that is averaged brings next to nothing into the first arm; each frame's own brings half.
    own = 0.5 * first if scatter == 0 and np.ptp(averaged, axis=0).any() else scatter
    joint = first - (own if scatter == 0 else 0.0)
    tip = np.clip(second - joint, LEAST_SHARE * second, second)
    return np.sqrt([own, joint, tip])

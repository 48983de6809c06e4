"""At most as much smoothing as helps: for every frame the polynomial whose expected error is the least.

Candidates are the measured angle itself and local polynomials (Savitzky-Golay) over ever more frames.  A longer window
has less of the markers' noise, whose size is known (:mod:`.noise`), and more of the motion that a polynomial cannot
follow.  That bias is read from the differences between one window's result and the next shorter one's, averaged over
neighbouring frames: what exceeds the noise of these differences is bias (as in Stein's unbiased estimate of risk).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.signal import savgol_coeffs

from expertaug_recordings.angles.noise import Noise

GROWTH = 1.35  # from one window to the next
LONGEST_S = 0.08  # of a window; it reaches half of that into the future of a frame
FEWEST = 9  # frames over which the bias is averaged, and of the longest window where frames are far apart
SPAN_S = 0.08  # seconds over which it is averaged
# Where frames are far apart, a slope errs by what happens between them: by a multiple of what the step from 5 frames to
# 7 changes, which grows with that step's share of the one from 3 to 5 (benchmarks/speed_uncertainty.py); higher degrees
# hardly err less.
UNSEEN, FEW, MANY = 8.5, 0.5, 3.5  # times that share; and the multiple's limits


@dataclass(frozen=True)
class Window:
    """A local polynomial: frames on either side of its middle, its degree, and the number of the shorter window with
    which its result is compared (-1 for none)."""

    half: int
    degree: int
    before: int

    def weights(self, derivative: int, rate: float) -> np.ndarray:
        """Of the frames, for the angle (0) or the speed (1) in the middle, (2 half + 1,)."""
        if self.half == 0:
            return np.ones(1)
        return savgol_coeffs(2 * self.half + 1, self.degree, derivative, 1 / rate, use="dot")


def angle_windows(order: int, rate: float) -> list[Window]:
    """The measured angle, then polynomials of an order, each over more frames than the one before."""
    return [Window(0, 0, -1), *(Window(half, order, k) for k, half in enumerate(_halves(order, rate)))]


def speed_windows(order: int, rate: float) -> list[Window]:
    """Finite differences, the slopes of polynomials through 3, 5, ... frames, then polynomials of an order."""
    first, *others = _halves(order, rate)
    differences = [Window(half, 2 * half, half - 2) for half in range(1, first + 1)]
    return differences + [Window(half, order, first - 1 + k) for k, half in enumerate(others)]


def longest_window(order: int, rate: float) -> int:
    """Frames of the longest window."""
    return 2 * _halves(order, rate)[-1] + 1


def _halves(order: int, rate: float) -> list[int]:
    """Frames on either side of ever longer windows."""
    half = order // 2 + 1
    longest = max(round(LONGEST_S * rate / 2), FEWEST // 2, half + 1)
    found = []
    while half <= longest:
        found.append(half)
        half = max(half + 1, round(GROWTH * half))
    return found


def estimate(
    theta: np.ndarray, k: int, derivative: int, windows: list[Window], noise: Noise, rate: float, last: bool = False
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The best estimate of each frame's angle or speed.

    Arguments:
        theta: unwrapped angles k of a gap-free stretch in rad, (n,).
        k: 0 or 1, which of the two.
        derivative: 0 for angles, 1 for speeds.
        windows: to choose from, of :func:`angle_windows` or :func:`speed_windows`.
        noise: of the angles.
        rate: frames per second.
        last: take the last window, whatever its error.

    Returns:
        value, its standard uncertainty (noise and bias), and the number of the window chosen, (n,) each; NaN and -1
        where no window fits into the stretch.
    """
    weights = [window.weights(derivative, rate) for window in windows]
    values = np.full((len(windows), len(theta)), np.nan)
    for value, window, weight in zip(values, windows, weights, strict=True):
        if len(theta) > 2 * window.half:
            value[window.half : len(theta) - window.half] = np.correlate(theta, weight, "valid")
    variance = np.array([noise.variance(weight, k) for weight in weights])
    risk = variance[:, None] + _bias(values, weights, windows, noise, k, rate)
    risk = np.where(np.isfinite(values), risk, np.inf)
    if last:
        risk[:-1] = np.inf
    chosen = risk.argmin(0)
    frames = np.arange(len(theta))
    value, least = values[chosen, frames], risk[chosen, frames]
    known = np.isfinite(least)
    return np.where(known, value, np.nan), np.sqrt(np.where(known, least, np.nan)), np.where(known, chosen, -1)


def _bias(
    values: np.ndarray, weights: list[np.ndarray], windows: list[Window], noise: Noise, k: int, rate: float
) -> np.ndarray:
    """Squared bias (windows, n) of each window's result; infinite where nothing tells it."""
    size = max(2 * round(SPAN_S * rate / 2) + 1, FEWEST)
    excess, bias = np.zeros_like(values), np.full_like(values, np.inf)
    for j, window in enumerate(windows):
        if window.before < 0:
            bias[j] = 0 if window.half == 0 else np.inf  # the measured angle has none
            continue
        before = windows[window.before]
        difference = weights[j].copy()
        inner = window.half - before.half
        difference[inner : len(difference) - inner] -= weights[window.before]
        mean = _local_mean((values[j] - values[window.before]) ** 2, size)
        excess[j] = np.maximum(mean - noise.variance(difference, k), 0)
        if window.degree < 2 * window.half:  # the bias grows with the power of the first derivative left out
            share = (before.half / window.half) ** (window.degree + 1)
            bias[j] = excess[j] / (1 - share) ** 2
        elif before.before >= 0:
            share = np.sqrt(excess[j] / np.maximum(excess[window.before], 1e-30))
            bias[j] = np.clip(UNSEEN * share, FEW, MANY) ** 2 * excess[j]
    return bias


def _local_mean(values: np.ndarray, size: int) -> np.ndarray:
    """Mean over ``size`` neighbours, of those that are known."""
    known = np.isfinite(values)
    total = uniform_filter1d(np.where(known, values, 0.0), size, mode="constant")
    count = uniform_filter1d(known.astype(float), size, mode="constant")
    return np.where(known, total / np.maximum(count, 1e-9), 0.0)

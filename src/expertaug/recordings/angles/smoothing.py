"""Angles and speeds of gap-free stretches by a local polynomial (Savitzky-Golay)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d
from scipy.signal import savgol_coeffs, savgol_filter

from expertaug.measurements.splitting import stretches

OUTLIER_PASSES = 6
FILL_PASSES = 60


@dataclass(frozen=True)
class Motion:
    """Smoothed motion of n frames; NaN outside of the stretches.

    Attributes:
        y: (θ1, θ2, θ1', θ2'), (n, 4), in rad and rad/s.
        margin: (n,), frames within half a window of a stretch's end, whose polynomial is one-sided.
        outlier: (n,), frames rejected because they lie off the polynomial.
        noise: spread of the two angles' labels in rad.
    """

    y: np.ndarray
    margin: np.ndarray
    outlier: np.ndarray
    noise: np.ndarray


def window_frames(seconds: float, order: int, rate: float) -> int:
    """Odd number of frames that spans ``seconds``, and at least three more than ``order``."""
    return max(2 * round(seconds * rate / 2) + 1, order + 3 - order % 2)


def smooth_motion(
    theta: np.ndarray, rate: float, window: int, order: int, longest_gap: int, sigmas: float, floor: float
) -> Motion:
    """Smooth two angles.

    Arguments:
        theta: wrapped angles in rad, (n, 2); NaN where a frame is unusable.
        rate: frames per second.
        window: frames of the local polynomial, odd; shorter stretches are dropped.
        order: the polynomial's order.
        longest_gap: gaps of at most so many frames are filled, longer ones end a stretch.
        sigmas, floor: an angle is an outlier if it is off by more than ``sigmas`` times the noise and ``floor`` rad.
    """
    theta = theta.copy()
    outlier = np.zeros(len(theta), dtype=bool)
    for _ in range(OUTLIER_PASSES):
        motion = _smooth(theta, rate, window, order, longest_gap, outlier)
        residual = np.abs(np.angle(np.exp(1j * (theta - motion.y[:, :2]))))
        ratio = np.nan_to_num(residual / np.maximum(sigmas * motion.noise, floor)).max(1)
        # Only the worst of a window at a time: an outlier pulls its neighbours' polynomial off as well.
        worst = (ratio > 1) & (ratio >= maximum_filter1d(ratio, window))
        if not worst.any():
            break
        outlier |= worst
        theta[worst] = np.nan
    return motion


def _smooth(theta: np.ndarray, rate: float, window: int, order: int, longest_gap: int, outlier: np.ndarray) -> Motion:
    n = len(theta)
    y = np.full((n, 4), np.nan)
    margin = np.zeros(n, dtype=bool)
    present = np.isfinite(theta).all(1)
    residuals = []
    for start, stop in stretches(present, longest_gap):
        if stop - start < window:
            continue
        span = slice(start, stop)
        angles = _fill(theta[span], present[span], window, order)
        y[span, :2] = savgol_filter(angles, window, order, axis=0)
        y[span, 2:] = savgol_filter(angles, window, order, deriv=1, delta=1 / rate, axis=0)
        margin[start : start + window // 2] = margin[stop - window // 2 : stop] = True
        residuals.append((angles - y[span, :2])[present[span]])
    noise = np.zeros(2)
    if residuals:
        # A residual keeps 1 − h0 of a label's variance, h0 being the polynomial's weight of the label itself.
        kept = 1 - savgol_coeffs(window, order)[window // 2]
        noise = 1.4826 * np.median(np.abs(np.concatenate(residuals)), axis=0) / np.sqrt(kept)
    return Motion(y, margin, outlier.copy(), noise)


def _fill(theta: np.ndarray, present: np.ndarray, window: int, order: int) -> np.ndarray:
    """Unwrapped angles, the missing ones filled by the local polynomial of the others (fixed point of smoothing)."""
    frames = np.arange(len(theta))
    unwrapped = np.unwrap(theta[present], axis=0)
    if present.all():
        return unwrapped
    angles = np.stack([np.interp(frames, frames[present], unwrapped[:, k]) for k in range(2)], axis=1)
    for _ in range(FILL_PASSES):
        smooth = savgol_filter(angles, window, order, axis=0)
        change = np.abs(smooth[~present] - angles[~present]).max()
        angles[~present] = smooth[~present]
        if change < 1e-5:
            break
    return angles

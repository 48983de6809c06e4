"""Angles and speeds of gap-free stretches by local polynomials (Savitzky-Golay)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy.ndimage import maximum_filter1d
from scipy.signal import savgol_coeffs, savgol_filter

from expertaug.measurements.splitting import stretches
from expertaug_recordings.angles.noise import Noise, spread
from expertaug_recordings.angles.windows import Window, angle_windows, estimate, speed_windows

OUTLIER_PASSES = 6
OF_A_TURN = 0.05  # of what an angle turns from frame to frame: nearer to its neighbours' polynomial, none is an outlier
AROUND = 4  # windows, over which frames' distances from their neighbours' polynomial are compared
FILL_PASSES = 60


@dataclass(frozen=True)
class Smoothing:
    """How angles are smoothed.

    Attributes:
        order: of the local polynomials.
        window: their frames, odd; None = for each frame as many as help (:mod:`.windows`).
        longest_gap: gaps of at most so many frames are filled, longer ones end a stretch.
        sigmas, floor: an angle is an outlier if it is off its neighbours' polynomial by more than ``sigmas`` times the
            usual and ``floor`` rad.
    """

    order: int
    window: int | None
    longest_gap: int
    sigmas: float
    floor: float


@dataclass(frozen=True)
class Motion:
    """Smoothed motion of n frames; NaN outside of the stretches.

    Attributes:
        y: (θ1, θ2, θ1', θ2'), (n, 4), in rad and rad/s.
        raw: the angles as they were measured, (n, 2), unwrapped like ``y``; NaN where they were not used.
        std: standard uncertainty of ``y``, (n, 4); NaN where a frame is filled or at a stretch's end.
        unsmoothed: (n, 2), angles that are as measured since no polynomial follows the motion well enough.
        reach: (n, 2), frames on either side whose differences are the speed; 0 where a smoothing polynomial tells it.
        margin: (n,), frames at a stretch's end, whose polynomial is one-sided.
        outlier: (n,), frames rejected because they lie off the polynomial.
    """

    y: np.ndarray
    raw: np.ndarray
    std: np.ndarray
    unsmoothed: np.ndarray
    reach: np.ndarray
    margin: np.ndarray
    outlier: np.ndarray

    def with_error(self, error: np.ndarray) -> Motion:
        """The same with errors (n, 2) in rad that the measured angles have besides their noise; NaN where nothing is
        known of it: there the largest that is."""
        known = np.isfinite(error)
        error = np.where(known, error, error[known].max(initial=0.0))
        std = self.std.copy()
        std[:, :2] = np.hypot(std[:, :2], error)
        return replace(self, std=std)


def window_frames(seconds: float, order: int, rate: float) -> int:
    """Odd number of frames that spans ``seconds``, and at least three more than ``order``."""
    return max(2 * round(seconds * rate / 2) + 1, order + 3 - order % 2)


def smooth_motion(theta: np.ndarray, rate: float, noise: Noise, how: Smoothing) -> Motion:
    """Smooth two angles.

    Arguments:
        theta: wrapped angles in rad, (n, 2); NaN where a frame is unusable.
        rate: frames per second.
        noise: of the angles.
        how: to smooth them.
    """
    theta = theta.copy()
    outlier = np.zeros(len(theta), dtype=bool)
    window = how.window or _best_window(theta, rate, how)
    for _ in range(OUTLIER_PASSES):
        off = _off_neighbours(theta, window, how)
        least = np.maximum(how.floor, OF_A_TURN * _turn(theta, window))
        ratio = np.nan_to_num(np.abs(off) / np.maximum(how.sigmas * _usual(off, window), least)).max(1)
        # Only the worst of a window at a time: an outlier pulls its neighbours' polynomial off as well.
        worst = (ratio > 1) & (ratio >= maximum_filter1d(ratio, window))
        if not worst.any():
            break
        outlier |= worst
        theta[worst] = np.nan
    return _smooth(theta, rate, noise, how, window, outlier)


def _filled(theta: np.ndarray, window: int, how: Smoothing, least: int) -> list[tuple[slice, np.ndarray, np.ndarray]]:
    """Stretches of at least so many frames: where they are, their unwrapped angles without gaps, and which frames are
    measured."""
    present = np.isfinite(theta).all(1)
    return [
        (slice(start, stop), _fill(theta[start:stop], present[start:stop], window, how.order), present[start:stop])
        for start, stop in stretches(present, how.longest_gap)
        if stop - start >= least
    ]


def _off_neighbours(theta: np.ndarray, window: int, how: Smoothing) -> np.ndarray:
    """By how much each angle (n, 2) is off the polynomial through its neighbours alone; NaN where there is none."""
    off = np.full(theta.shape, np.nan)
    own = savgol_coeffs(window, how.order)[window // 2]  # the polynomial's weight of the angle itself
    for span, angles, present in _filled(theta, window, how, window):
        difference = (angles - savgol_filter(angles, window, how.order, axis=0)) / (1 - own)
        off[span] = np.where(present[:, None], difference, np.nan)
    return off


def _usual(off: np.ndarray, window: int) -> np.ndarray:
    """Standard deviation (n, 2) of what was seen there and in all: fast motion is further off its neighbours'
    polynomial than slow motion."""
    if not np.isfinite(off).any():
        return np.zeros_like(off)
    around = pd.DataFrame(np.abs(off)).rolling(AROUND * window, center=True, min_periods=1).median()
    return np.maximum(1.4826 * around.fillna(0).to_numpy(), spread(off))


def _turn(theta: np.ndarray, window: int) -> np.ndarray:
    """By how much the angles (n, 2) turn from frame to frame, at most, in a window round each frame."""
    step = np.abs(np.angle(np.exp(1j * np.diff(theta, axis=0, prepend=theta[:1]))))
    return maximum_filter1d(np.nan_to_num(step), window, axis=0)


def _best_window(theta: np.ndarray, rate: float, how: Smoothing) -> int:
    """The window whose polynomial best tells an angle by its neighbours."""
    scores = {}
    for window in (2 * one.half + 1 for one in angle_windows(how.order, rate)[1:]):
        off = _off_neighbours(theta, window, how)
        scores[window] = float(spread(off).sum()) if np.isfinite(off).any() else np.inf
    return min(scores, key=scores.__getitem__)


def _smooth(
    theta: np.ndarray,
    rate: float,
    noise: Noise,
    how: Smoothing,
    window: int,
    outlier: np.ndarray,
) -> Motion:
    n = len(theta)
    y, std, raw = np.full((n, 4), np.nan), np.full((n, 4), np.nan), np.full((n, 2), np.nan)
    margin, unsmoothed, reach = np.zeros(n, dtype=bool), np.zeros((n, 2), dtype=bool), np.zeros((n, 2), dtype=int)
    given = how.window is not None
    shortest = how.window or 2 * (how.order // 2 + 1) + 1
    families = [angle_windows(how.order, rate), speed_windows(how.order, rate)]
    if given:
        families = [_one_window(family, window // 2, how.order) for family in families]
    for span, angles, present in _filled(theta, window, how, shortest):
        raw[span] = np.where(present[:, None], angles, np.nan)
        ends = np.ones(len(angles), bool)
        ends[shortest // 2 : len(angles) - shortest // 2] = False
        margin[span] = ends
        for k in (0, 1):
            for derivative, family in enumerate(families):
                column = 2 * derivative + k
                value, error, chosen = estimate(angles[:, k], k, derivative, family, noise, rate, last=given)
                one_sided = savgol_filter(
                    angles[:, k], shortest, how.order, deriv=derivative, delta=1 / rate if derivative else 1.0
                )
                if not (given or derivative):
                    one_sided = angles[:, k]
                y[span, column] = np.where(ends, one_sided, value)
                std[span, column] = np.where(present & ~ends, error, np.nan)
                if derivative == 0:
                    unsmoothed[span, k] = (chosen == 0) & present & ~ends
                else:
                    differences = np.array([one.half * (one.degree == 2 * one.half) for one in family])
                    reach[span, k] = np.where(chosen >= 0, differences[chosen], 0)
    return Motion(y, raw, std, unsmoothed, reach, margin, outlier)


def _one_window(family: list[Window], half: int, order: int) -> list[Window]:
    """What tells of one window: the shortest ones of its family, and last itself."""
    shortest = next(k for k, one in enumerate(family) if one.half in (0, order // 2 + 1))
    same = family[shortest].half == half  # a difference of seven frames is the slope of a polynomial through them
    return family[: shortest + 1] + ([] if same else [Window(half, order, shortest)])


def _fill(theta: np.ndarray, present: np.ndarray, window: int, order: int) -> np.ndarray:
    """Unwrapped angles, the missing ones filled by the local polynomial of the others (fixed point of smoothing)."""
    frames = np.arange(len(theta))
    unwrapped = np.unwrap(theta[present], axis=0)
    if present.all():
        return unwrapped
    angles = np.stack([np.interp(frames, frames[present], unwrapped[:, k]) for k in range(2)], axis=1)
    window = min(window, len(theta) - 1 + len(theta) % 2)
    for _ in range(FILL_PASSES):
        smooth = savgol_filter(angles, window, order, axis=0)
        change = np.abs(smooth[~present] - angles[~present]).max()
        angles[~present] = smooth[~present]
        if change < 1e-5:
            break
    return angles

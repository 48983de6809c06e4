"""Angles and speeds of gap-free stretches by local polynomials (Savitzky-Golay), with their uncertainties.

There is at most as much smoothing as helps: for every frame the polynomial whose expected error is the least.

Candidates are the measured angle itself and local polynomials (Savitzky-Golay) over ever more frames.  A longer window
has less of the markers' noise, whose size is known (:mod:`expertaug_recordings.angles.noise`), and more of the motion
that a polynomial cannot follow.  That bias is read from the differences between one window's result and the next
shorter one's, averaged over neighbouring frames: what exceeds the noise of these differences is bias (as in Stein's
unbiased estimate of risk).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.ndimage import maximum_filter1d, uniform_filter1d
from scipy.signal import savgol_coeffs, savgol_filter

from expertaug.measurements.splitting import stretches
from expertaug_recordings.angles.noise import Noise, spread

GROWTH = 1.35  # from one window to the next
LONGEST_S = 0.08  # of a window; it reaches half of that into the future of a frame
FEWEST = 9  # frames over which the bias is averaged, and of the longest window where frames are far apart
SPAN_S = 0.08  # seconds over which it is averaged
# Where frames are far apart, a slope errs by what happens between them: by a multiple of what the step from 5 frames to
# 7 changes, which grows with that step's share of the one from 3 to 5 (benchmarks/speed_uncertainty.py); higher degrees
# hardly err less.
UNSEEN, FEW, MANY = 8.5, 0.5, 3.5  # times that share; and the multiple's limits
OUTLIER_PASSES = 6
OF_A_TURN = 0.05  # of what an angle turns from frame to frame: nearer to its neighbours' polynomial, none is an outlier
AROUND = 4  # windows, over which frames' distances from their neighbours' polynomial are compared
FILL_PASSES = 60


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
    halves = []
    while half <= longest:
        halves.append(half)
        half = max(half + 1, round(GROWTH * half))
    return halves


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
    finite = np.isfinite(least)
    return np.where(finite, value, np.nan), np.sqrt(np.where(finite, least, np.nan)), np.where(finite, chosen, -1)


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
    finite = np.isfinite(values)
    total = uniform_filter1d(np.where(finite, values, 0.0), size, mode="constant")
    count = uniform_filter1d(finite.astype(float), size, mode="constant")
    return np.where(finite, total / np.maximum(count, 1e-9), 0.0)


@dataclass(frozen=True)
class Smoothing:
    """How angles are smoothed.

    Attributes:
        order: of the local polynomials.
        window: their frames, odd; None = for each frame as many as help.
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


def fill_errors(error: np.ndarray) -> np.ndarray:
    """Errors (n, 2) with the largest of them where nothing is known."""
    finite = np.isfinite(error)
    return np.where(finite, error, error[finite].max(initial=0.0))


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


def _fill_gaps(
    theta: np.ndarray, window: int, how: Smoothing, least: int
) -> list[tuple[slice, np.ndarray, np.ndarray]]:
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
    for span, angles, present in _fill_gaps(theta, window, how, window):
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
    for window in (2 * candidate.half + 1 for candidate in angle_windows(how.order, rate)[1:]):
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
    fixed = how.window is not None
    shortest = how.window or 2 * (how.order // 2 + 1) + 1
    families = [angle_windows(how.order, rate), speed_windows(how.order, rate)]
    if fixed:
        families = [_one_window(family, window // 2, how.order) for family in families]
    for span, angles, present in _fill_gaps(theta, window, how, shortest):
        raw[span] = np.where(present[:, None], angles, np.nan)
        ends = np.ones(len(angles), bool)
        ends[shortest // 2 : len(angles) - shortest // 2] = False
        margin[span] = ends
        for k in (0, 1):
            for derivative, family in enumerate(families):
                column = 2 * derivative + k
                value, error, chosen = estimate(angles[:, k], k, derivative, family, noise, rate, last=fixed)
                one_sided = savgol_filter(
                    angles[:, k], shortest, how.order, deriv=derivative, delta=1 / rate if derivative else 1.0
                )
                if not (fixed or derivative):
                    one_sided = angles[:, k]
                y[span, column] = np.where(ends, one_sided, value)
                std[span, column] = np.where(present & ~ends, error, np.nan)
                if derivative == 0:
                    unsmoothed[span, k] = (chosen == 0) & present & ~ends
                else:
                    differences = np.array(
                        [candidate.half * (candidate.degree == 2 * candidate.half) for candidate in family]
                    )
                    reach[span, k] = np.where(chosen >= 0, differences[chosen], 0)
    return Motion(y, raw, std, unsmoothed, reach, margin, outlier)


def _one_window(family: list[Window], half: int, order: int) -> list[Window]:
    """What tells of one window: the shortest ones of its family, and last itself."""
    shortest = next(k for k, window in enumerate(family) if window.half in (0, order // 2 + 1))
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

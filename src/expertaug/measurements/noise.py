"""How noisy measured columns are, from how rough they are."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from expertaug.measurements.splitting import stretches

WIDTH, ORDER = 7, 3  # points and order of the local polynomial
FARTHEST = 3.0  # usual times from row to row that may lie between two of its points


def noise_of(series: Sequence[np.ndarray]) -> np.ndarray:
    """Standard deviation of the noise of each column (K,), from even series (n, K), NaN where nothing was measured.

    A point's residual is what a cubic through the three points on either side of it leaves.  White noise has the same
    residuals there as pure noise would; motion that a cubic cannot follow over seven points is taken for noise, so that
    the estimate is an upper one where the sampling is coarse.  NaN where no seven points follow each other.
    """
    columns = series[0].shape[1] if series else 0
    weights = _residual_weights(np.arange(WIDTH) - WIDTH // 2)
    deviations = []
    for k in range(columns):
        parts = []
        for values in series:
            for start, stop in stretches(np.isfinite(values[:, k])):
                if stop - start >= WIDTH:
                    parts.append(np.convolve(values[start:stop, k], weights[::-1], "valid"))
        # The median does not mind single jumps; 1.4826 of it is a Gaussian's standard deviation.
        residuals = np.concatenate(parts) if parts else np.array([np.nan])
        deviations.append(1.4826 * float(np.median(np.abs(residuals))) / float(np.sqrt((weights**2).sum())))
    return np.array(deviations)


def noise_of_rows(series: Sequence[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    """The same of rows at uneven times: t (n,) and values (n, K) of each trajectory."""
    columns = series[0][1].shape[1] if series else 0
    deviations = []
    for k in range(columns):
        parts = [np.array([np.nan])[:0]]
        for t, values in series:
            present = np.isfinite(values[:, k])
            if present.sum() >= WIDTH:
                at, own = sliding_window_view(t[present], WIDTH), sliding_window_view(values[present, k], WIDTH)
                near = np.diff(at).max(1) <= FARTHEST * np.median(np.diff(t))
                weights = _residual_weights((at - at[:, WIDTH // 2, None])[near])
                parts.append((weights * own[near]).sum(1) / np.sqrt((weights**2).sum(1)))
        residuals = np.concatenate(parts)
        deviations.append(1.4826 * float(np.median(np.abs(residuals))) if len(residuals) else np.nan)
    return np.array(deviations)


def _residual_weights(x: np.ndarray) -> np.ndarray:
    """What the middle point's residual is made of, (…, WIDTH), of points at times x (…, WIDTH) around it."""
    powers = (x / np.abs(x).max(-1, keepdims=True))[..., None] ** np.arange(ORDER, -1, -1)
    middle = -(powers @ np.linalg.pinv(powers))[..., WIDTH // 2, :]
    middle[..., WIDTH // 2] += 1
    return middle

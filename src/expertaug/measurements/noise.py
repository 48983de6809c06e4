"""How noisy measured columns are, from how rough they are."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from expertaug.measurements.splitting import stretches

WIDTH, ORDER = 7, 3  # points and order of the local polynomial


def noise_of(series: Sequence[np.ndarray]) -> np.ndarray:
    """Standard deviation of the noise of each column (K,), from even series (n, K), NaN where nothing was measured.

    A point's residual is what a cubic through the three points on either side of it leaves.  White noise has the same
    residuals there as pure noise would; motion that a cubic cannot follow over seven points is taken for noise, so that
    the estimate is an upper one where the sampling is coarse.  NaN where no seven points follow each other.
    """
    columns = series[0].shape[1] if series else 0
    weights = _residual_weights()
    found = []
    for k in range(columns):
        parts = []
        for one in series:
            for start, stop in stretches(np.isfinite(one[:, k])):
                if stop - start >= WIDTH:
                    parts.append(np.convolve(one[start:stop, k], weights[::-1], "valid"))
        # The median does not mind single jumps; 1.4826 of it is a Gaussian's standard deviation.
        residuals = np.concatenate(parts) if parts else np.array([np.nan])
        found.append(1.4826 * float(np.median(np.abs(residuals))) / float(np.sqrt((weights**2).sum())))
    return np.array(found)


def _residual_weights() -> np.ndarray:
    """What the middle point's residual is made of, (WIDTH,)."""
    x = np.arange(WIDTH) - WIDTH // 2
    powers = np.vander(x, ORDER + 1)
    middle = -(powers @ np.linalg.pinv(powers))[WIDTH // 2]
    middle[WIDTH // 2] += 1
    return middle

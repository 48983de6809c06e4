"""A posterior in closed form: θ is standard normal in each component, x = θ + noise of standard deviation 0.5."""

from __future__ import annotations

import numpy as np

VARIANCE = 0.25


def posterior(n: int, draws: int, width: float = 1.0, shift: float = 0.0, parameters: int = 2, seed: int = 0):
    """Truths (n, P), draws (draws, n, P) of N(mean + shift, (width · sd)²), and their log density up to a constant."""
    rng = np.random.default_rng(seed)
    truth = rng.normal(size=(n, parameters))
    x = truth + np.sqrt(VARIANCE) * rng.normal(size=truth.shape)
    mean, sd = x / (1 + VARIANCE) + shift, width * np.sqrt(VARIANCE / (1 + VARIANCE))
    samples = mean + sd * rng.normal(size=(draws, n, parameters))

    def log_prob(value: np.ndarray) -> np.ndarray:
        return -0.5 * np.square((value - mean) / sd).sum(-1)

    return samples, truth, log_prob

"""The mean of values with errors of their own, and how far what they are of is spread."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

ALONE = 1e-9  # share of all weight that is left to the others beside a value that has next to no error


@dataclass(frozen=True)
class Pooled:
    """A mean of independent values.

    Attributes:
        value, error: and its standard error.
        spread: standard deviation of what the values are of, beyond their own errors; 0 beside one with next to no
            error, which alone has a weight.
        groups: number of values.
    """

    value: float
    error: float
    spread: float
    groups: int


def pool(values: np.ndarray, errors: np.ndarray | None, blocks: np.ndarray | None = None) -> Pooled:
    """Mean of values with the scatter beyond their errors; its own error is never less than what the errors say.

    Arguments:
        values: (N,), finite.
        errors: their standard errors (N,); None: nothing is known of them.
        blocks: numbers (N,) of what counts as independent; None: each value does.  Of a single block no error follows
            from scatter: it is then that of a single value, as if all said the same.
    """
    count = len(values)
    has_errors = errors is not None and np.isfinite(errors).all()
    variance = np.square(errors).clip(1e-24) if has_errors else np.ones(count)
    weights, spread = 1 / variance, np.nan
    if count > 1:
        scatter = weights @ np.square(values - weights @ values / weights.sum())
        freedom = weights.sum() - np.square(weights).sum() / weights.sum()
        if not has_errors:
            beyond = scatter / (count - 1)
        elif freedom > ALONE * weights.sum():
            beyond = max(0.0, scatter - (count - 1)) / freedom
        else:
            beyond = 0.0
        spread = float(np.sqrt(beyond))
        weights = 1 / (variance + beyond) if has_errors else weights
    mean = float(weights @ values / weights.sum())
    numbers = np.arange(count) if blocks is None else np.unique(blocks, return_inverse=True)[1]
    groups = int(numbers.max()) + 1
    least = float(np.sqrt(1 / (1 / variance).sum())) if has_errors else np.nan
    if groups == 1:
        return Pooled(mean, least * np.sqrt(count), spread, 1)
    pulls = np.bincount(numbers, weights * (values - mean))
    error = float(np.sqrt(groups / (groups - 1) * np.square(pulls).sum()) / weights.sum())
    return Pooled(mean, float(np.fmax(error, least)), spread, groups)

"""What it buys to refuse the most suspicious windows: risk against the share kept (El-Yaniv & Wiener 2010)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from expertaug.inference.sample_arrays import Array, per_window, plain


@dataclass(frozen=True)
class RiskCoverage:
    """Mean error of the windows kept.

    Attributes:
        kept: shares of the windows, 1/N … 1, (N,).
        risk: mean error of those with the lowest scores, (N,); the last is the mean of all.
        best: the same for a score that orders windows by their error, (N,).
    """

    kept: np.ndarray
    risk: np.ndarray
    best: np.ndarray

    @property
    def area(self) -> float:
        """Mean risk over all shares kept: AURC."""
        return float(self.risk.mean())

    @property
    def best_area(self) -> float:
        """The area that no score can fall below."""
        return float(self.best.mean())


def risk_coverage(scores: Array, errors: Array) -> RiskCoverage:
    """Mean error of the windows kept as the most suspicious are refused.

    Windows of equal score are refused in no order: each counts with the mean error of all of them.

    Arguments:
        scores: (N,), higher means more suspicious; they may be infinite.
        errors: (N,), as the squared error of the forecast, which may be infinite.

    Raises:
        InputError: the shapes disagree, or a value is NaN.
    """
    score, error = (plain(v, name, infinite=True) for v, name in ((scores, "scores"), (errors, "errors")))
    per_window(score, error, "scores and errors")
    _, group, size = np.unique(score, return_inverse=True, return_counts=True)
    alike = np.zeros(len(size))
    np.add.at(alike, group, error)
    count = np.arange(1, len(error) + 1)
    kept_error = (alike / size)[np.sort(group)]
    return RiskCoverage(count / len(error), np.cumsum(kept_error) / count, np.cumsum(np.sort(error)) / count)

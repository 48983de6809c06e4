"""Which windows' forecasts are not to be trusted: a score a window, a threshold, what both are worth (see
docs/diagnostics.md).

Arrays are NumPy or torch: scores and errors (N,), one number a window; a higher score is more suspicious.
"""

from expertaug.inference.diagnostics.alarm import (
    Area,
    Assessment,
    RiskCoverage,
    assess,
    auroc,
    caught,
    ensemble_spread,
    failing,
    forecast_distance,
    risk_coverage,
    roc,
    threshold,
)

__all__ = [
    "Area",
    "Assessment",
    "RiskCoverage",
    "assess",
    "auroc",
    "caught",
    "ensemble_spread",
    "failing",
    "forecast_distance",
    "risk_coverage",
    "roc",
    "threshold",
]

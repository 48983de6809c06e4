"""Is a posterior right?  Ranks, coverage and scores from its draws and the truth (see docs/diagnostics.md).

Arrays are NumPy or torch.  Draws come first, then windows, as seeds do in a group's forecasts: samples (K, N, …),
truth (N, …).
"""

from expertaug.inference.diagnostics.calibration import (
    Calibration,
    Coverage,
    area_to_curve,
    calibration,
    density_ranks,
    expected_coverage,
    interval_coverage,
    ranks,
    tarp_ranks,
)
from expertaug.inference.diagnostics.scores import crps, energy_score, log_mse_of_mean
from expertaug.inference.diagnostics.uniformity import Uniformity, uniformity

__all__ = [
    "Calibration",
    "Coverage",
    "Uniformity",
    "area_to_curve",
    "calibration",
    "crps",
    "density_ranks",
    "energy_score",
    "expected_coverage",
    "interval_coverage",
    "log_mse_of_mean",
    "ranks",
    "tarp_ranks",
    "uniformity",
]

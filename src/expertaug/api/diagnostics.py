"""Is a posterior right?  Ranks, coverage and scores from its draws and the truth (see docs/diagnostics.md).

Arrays are NumPy or torch.  Draws come first, then windows, as seeds do in a group's forecasts: samples (K, N, …),
truth (N, …).
"""

from expertaug.inference.calibration import Calibration, calibration
from expertaug.inference.coverage import Coverage, area_to_curve, expected_coverage, interval_coverage
from expertaug.inference.predictive_scores import crps, energy_score, log_mse_of_mean
from expertaug.inference.ranks import density_ranks, ranks, tarp_ranks
from expertaug.inference.uniformity import Uniformity, uniformity

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

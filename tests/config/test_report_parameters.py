"""What tables and figures are told of the configuration."""

from __future__ import annotations

from pathlib import Path

from expertaug.config import load as config
from expertaug.config import report_parameters

ROOT = Path(__file__).parents[2]


def test_figures_of_lines_show_the_classical_estimator_and_the_experiments_own_expert_first(base, tmp_path):
    shown = ["least_squares", "aphynity", "aphynity+", "hvae", "hvae+", "alternating"]
    over = config.load([ROOT / "config" / "ibm.yaml"])
    recorded = config.merge(over, {"recordings": {"markers": {"path": str(tmp_path)}}})
    for given, experiment in ((base, "pendulum"), (config.merge(base, recorded), "double_pendulum_time")):
        assert report_parameters.plot(config.validate(given), experiment)["traced"] == shown

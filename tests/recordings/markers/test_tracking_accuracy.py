"""A small share of benchmarks/tracking_accuracy.py: the tracker on simulated motion, and with faults."""

import subprocess
from pathlib import Path

import pandas as pd
import pytest

import warm_python

ROOT = Path(__file__).parents[3]


@pytest.mark.slow
def test_targets_are_met_and_faults_are_flagged(tmp_path):
    script = ROOT / "benchmarks" / "tracking_accuracy.py"
    options = ["--recordings", tmp_path / "none", "--frames", 16, "--clips", 1, "--levels", 2]
    command = [warm_python.interpreter(), script, tmp_path / "out", *options]
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "every target is met" in done.stdout
    faults = pd.read_csv(tmp_path / "out" / "faults.csv").set_index("fault")
    assert faults["largest_px"].max() < 1
    light, heavy = (faults.groupby(level=0)["flagged"].nth(k) for k in (0, -1))
    assert light.max() == 0
    assert heavy[["compression", "illumination drift", "partial occlusion"]].min() == 1
    assert heavy["frame drops"] == 0
    assert (tmp_path / "out" / "faults.png").stat().st_size > 10_000

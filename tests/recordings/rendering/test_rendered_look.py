"""The rendered video beside the one published real frame (benchmarks/look.py), where that is here."""

import subprocess
from pathlib import Path

import pandas as pd
import pytest
from pendulum_motion import real_recordings

import warm_python

ROOT = Path(__file__).parents[3]


@pytest.mark.slow
def test_rendered_frame_measures_like_the_real_one(tmp_path):
    folder = real_recordings()
    if not (folder / "frame.png").is_file():
        pytest.skip("no frame.png with the real recordings")
    command = [warm_python.interpreter(), ROOT / "benchmarks" / "look.py", tmp_path, "--recordings", folder]
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, timeout=200)
    assert done.returncode == 0, done.stderr
    table = pd.read_csv(tmp_path / "look.csv", index_col=0)
    means = table[table.index.str.startswith("mean")]
    tints = table[table.index.str.contains("white|coloured")]
    rims = table[table.index.str.contains("rim")]
    noise = table[table.index.str.contains("noise")]
    assert (means["rendered"] / means["real"] - 1).abs().max() < 0.05
    assert (tints["rendered"] - tints["real"]).abs().max() < 10
    assert (rims["rendered"] / rims["real"]).between(0.65, 1.35).all()
    assert (noise["rendered"] - noise["real"]).abs().max() < 2
    assert (tmp_path / "look.png").stat().st_size > 50_000

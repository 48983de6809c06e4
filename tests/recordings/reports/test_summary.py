"""The table of recordings: every value of each, in natural order, and what was left out."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from angle_files import summary
from pendulum_motion import markers, truth

from expertaug.errors import InputError
from expertaug_recordings.angles.measure import run_stage as measure_angles
from expertaug_recordings.reports.summary import run_stage as summarise
from expertaug_recordings.reports.summary import summarise as summarise_in_memory
from expertaug_recordings.settings import MeasureAnglesJob


def test_the_table_of_a_recording_without_arm_lengths(tmp_path):
    folder = tmp_path / "r0"
    folder.mkdir()
    markers(truth()[0, :2000]).to_csv(folder / "markers.csv", index=False)
    measure_angles(folder / "markers.csv", folder / "angles.csv", folder / "angles.json", MeasureAnglesJob(arm1_m=None))
    summarise([folder / "angles.json"], tmp_path / "summary.csv", tmp_path / "summary.md")
    row = (tmp_path / "summary.md").read_text().splitlines()[2]
    assert "| 400 | – |" in row and "Warnings" not in (tmp_path / "summary.md").read_text()
    table = pd.read_csv(tmp_path / "summary.csv", keep_default_na=False)
    assert table["implied_rate_hz"][0] == "" and table["reasons"][0].startswith("margin ")


def test_recordings_are_in_natural_order_with_those_that_were_left_out():
    known = 400, 100.0, (118.0, 90.0), (240.0, 238.0)
    recordings = [summary("10", *known, warnings=["the shutter rolls"]), summary("2", *known, pendulum="single")]
    table, text = summarise_in_memory(recordings, {"3": "is empty"})
    assert table["recording"].tolist() == ["2", "3", "10"] and table["refused"].tolist()[1] == "is empty"
    assert table["arm2_px"].tolist() == pytest.approx([90, np.nan, 90], nan_ok=True)
    single, double = text.splitlines()[2:4]
    assert (
        single.startswith("| 2 | 400 | 4.0 |") and single.split(" | ").count("–") == 4 and "| 90.00 ± 0.10 |" in double
    )
    assert "- 3: is empty" in text and "- 10: the shutter rolls" in text
    with pytest.raises(InputError, match="no recordings to summarise; run measure_angles"):
        summarise_in_memory([])

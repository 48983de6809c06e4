"""Markers placed by hand: applied, flagged as such, and part of the job's settings."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from pendulum_motion import markers, truth

from expertaug.config import load as config
from expertaug.config import recording_settings
from expertaug.errors import InputError
from expertaug_recordings.angles.measure import run_stage as measure_angles
from expertaug_recordings.corrections import Correction, read_corrections
from expertaug_recordings.settings import MeasureAnglesJob

FILES = [Path(__file__).parents[2] / "config" / "config.yaml"]
TIP = ["tip_x", "tip_y"]


def test_a_corrected_frame_is_measured_and_says_so(tmp_path):
    true = markers(truth()[0, :2000])
    table = true.copy()
    table.loc[300:330, TIP] = np.nan
    table.loc[300:330, ["quality", "reason"]] = 0.0, "lost:blue"
    table.to_csv(tmp_path / "markers.csv", index=False)
    rows = [{"frame": k, "marker": "tip", "x": true.tip_x[k], "y": true.tip_y[k]} for k in range(300, 331)]
    rows += [{"frame": 1000, "marker": "all"}, {"frame": 1200, "marker": "tip"}]
    files = [tmp_path / name for name in ("markers.csv", "angles.csv", "angles.json")]
    before = files[0].read_bytes()
    measure_angles(*files, MeasureAnglesJob(corrections=rows))
    angles = pd.read_csv(files[1], keep_default_na=False)
    assert (angles["reason"][300:331] == "corrected").all() and (angles["quality"][300:331].astype(float) == 1).all()
    off = np.angle(np.exp(1j * (angles["theta2"].astype(float)[300:331] - truth()[0, 300:331, 1])))
    assert np.abs(off).max() < 0.005
    assert (angles["quality"][[1000, 1200]].astype(float) < 1).all()
    assert files[0].read_bytes() == before  # what the tracker found stays
    with pytest.raises(InputError, match="a correction of frame 2000; its frames are 0 to 1999"):
        measure_angles(*files, MeasureAnglesJob(corrections=[{"frame": 2000, "marker": "all"}]))


def write(path, *rows):
    path.write_text("\n".join(["recording,frame,marker,x,y", *rows]) + "\n")
    return path


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("a,1,tip,3", "row 2: found 3, nan; give x and y"),
        ("a,1,elbow,3,4", "row 2: found frame 1, marker 'elbow'"),
        ("a,1.5,tip,3,4", "row 2: found frame 1.5"),
        ("a,1,all,3,4", "row 2: .* neither with all"),
        ("a,x,tip,3,4", "row 2"),
    ],
)
def test_a_row_that_says_nothing_is_named(tmp_path, row, message):
    with pytest.raises(InputError, match=message):
        read_corrections(write(tmp_path / "c.csv", row))


def test_only_the_recordings_that_are_corrected_are_measured_anew(tmp_path):
    path = write(tmp_path / "c.csv", "rendered_01,7,tip,3.5,4", "rendered_01,8,all,,")
    block = {"run": ["double_pendulum"], "recordings": {"corrections": str(path)}}
    found = config.validate(config.merge(config.load(FILES), block))
    one = recording_settings.measure_angles(found, "rendered_01").corrections
    assert one == [
        Correction(frame=7, marker="tip", x=3.5, y=4.0),
        Correction(frame=8, marker="all", x=None, y=None),
    ]
    assert recording_settings.measure_angles(found, "rendered_00").corrections == []
    write(path, "rendered_1,7,tip,3.5,4")
    with pytest.raises(InputError, match=r"recordings.corrections: 'rendered_1' is no recording"):
        config.validate(config.merge(config.load(FILES), block))

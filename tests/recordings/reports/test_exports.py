"""Tables for other programs: the same numbers in their units, axes and headings."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from expertaug.errors import InputError
from expertaug_recordings.reports.exports import FILES, export_recording, run_stage
from expertaug_recordings.tables import PLACES

POINTS = pd.DataFrame(
    {
        "frame": [4, 5, 6],
        "t": [0.0, 0.1, 0.2],
        **dict(
            zip(PLACES, ([10.0] * 3, [20.0] * 3, [10.0, 12, 14], [30.0] * 3, [15, np.nan, 15], [35.0] * 3), strict=True)
        ),
        "quality": [1.0, 0.5, 1.0],
        "reason": ["", "lost:blue", ""],
    }
)
ANGLES = pd.DataFrame(
    {
        "t": [0.0, 0.2],
        **{name: [np.pi / 6, np.pi] for name in ("theta1", "theta2", "omega1", "omega2")},
        "quality": 1.0,
        "reason": "",
        "source": [0, 2],
    }
)


def test_the_same_numbers_in_other_units_axes_and_headings():
    found = export_recording(POINTS, ANGLES)
    assert found.units["omega2 [deg/s]"].tolist() == pytest.approx([30, 180])
    assert found.units["frame"].tolist() == [4, 6] and found.units["joint_x [px]"].tolist() == [10, 14]
    lines = found.tracker.splitlines()  # from the pivot, upwards
    assert lines[:3] == ["#multi:", ",pivot,,joint,,tip,", "t,x,y,x,y,x,y"]
    assert [float(cell or "nan") for cell in lines[4].split(",")] == pytest.approx(
        [0.1, 0, 0, 2, -10, np.nan, -15], nan_ok=True
    )
    assert "-0.0" not in found.tracker
    assert found.deeplabcut["expertaug", "tip", "likelihood"].tolist() == [1, 0, 1]
    assert found.deeplabcut["expertaug", "joint", "likelihood"].tolist() == [1, 0.5, 1]


def test_the_stage_writes_each_and_refuses_tables_of_two_recordings(tmp_path):
    markers, angles = tmp_path / "markers.csv", tmp_path / "angles.csv"
    POINTS.to_csv(markers, index=False)
    ANGLES.to_csv(angles, index=False)
    run_stage(markers, angles, tmp_path / "export")
    assert sorted(path.name for path in (tmp_path / "export").iterdir()) == sorted(FILES)
    ANGLES.assign(source=[0, 3]).to_csv(angles, index=False)
    with pytest.raises(InputError, match=r"markers\.csv: 3 frames, .*angles\.csv has 2; run measure_angles again"):
        run_stage(markers, angles, tmp_path / "other")
    assert not (tmp_path / "other").exists()

"""Another laboratory's series, from inspect to tables without an edit by hand."""

import pytest
from laboratory import Series, scores, to_tables

from expertaug.measurements.splitting import SPLITS
from expertaug.trajectories import Trajectories


@pytest.mark.slow
def test_from_inspect_to_tables_without_an_edit_by_hand(tmp_path):
    series = Series(frames=480, side=400, diameter=28.0, off=6.0)
    markers, angles, sets = to_tables(tmp_path / "series", series.write(tmp_path / "series"), tmp_path)
    found = scores(series, markers, angles)
    assert found["used_of_right"] > 0.95 and found["largest_px"] < 1
    assert found["angles_used"] > 0.9 and found["deg"] < 0.1 and found["largest_deg"] < 0.5
    assert abs(found["gravity_deg"]) < 0.5
    assert found["stated"] == pytest.approx(1, rel=0.5)
    assert all(len(Trajectories.load(sets / f"{name}.npz")) >= 30 for name in SPLITS)

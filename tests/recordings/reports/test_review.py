"""Frames to look at, and what leaves for other programs."""

import cv2
import numpy as np
import pandas as pd
import pytest
from drawn import PAINT, RATE, draw, markers_of, swinging, write_video

from expertaug_recordings.angles.measure import run_stage as measure_angles
from expertaug_recordings.corrections import read_corrections
from expertaug_recordings.reports.exports import run_stage as export_recording
from expertaug_recordings.reports.review import WORST, review, review_recording, worst_frames
from expertaug_recordings.settings import MeasureAnglesJob, ReviewRecordingJob
from expertaug_recordings.tables import PLACES

COUNT, SIZE, PIVOT, ARMS = 240, (320, 180), (195.3, 82.6), (45.0, 30.0)


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """Folder of a clip whose tip was lost in a run of frames and is 3 px off in another frame."""
    folder = tmp_path_factory.mktemp("review") / "clip"
    folder.mkdir()
    place = markers_of(swinging(COUNT)[:, :2], PIVOT, ARMS)
    frames = draw(place, SIZE, [PAINT[n] for n in ("red", "green", "blue")], 12)
    write_video(frames, folder / "clip.mp4", RATE)
    rng = np.random.default_rng(0)
    table = pd.DataFrame({"frame": np.arange(COUNT), "t": np.arange(COUNT) / RATE})
    table[list(PLACES)] = (place + 0.025 * rng.normal(size=place.shape)).reshape(-1, 6)
    table["quality"], table["reason"] = 0.9, ""
    table.loc[100:119, ["tip_x", "tip_y"]] = np.nan
    table.loc[100:119, ["quality", "reason"]] = 0.0, "lost:blue"
    table.loc[200, ["tip_x", "tip_y"]] = place[200, 2] + 0.02 * (place[200, 2] - place[200, 1])
    table.to_csv(folder / "markers.csv", index=False)
    measure_angles(*(folder / n for n in ("markers.csv", "angles.csv", "angles.json")), MeasureAnglesJob(arm1_m=None))
    return folder


def test_the_worst_frames_are_those_that_are_flagged_and_those_whose_arms_are_off():
    quality, reason, off = np.ones(1000), np.array([""] * 1000, dtype=object), np.full(1000, 0.001)
    quality[300:340], reason[300:340] = 0.0, "lost:blue"
    quality[:9], reason[:9] = 0.5, "margin"
    off[700] = 0.02
    rows = worst_frames(quality, reason, off)
    assert {319, 700} <= set(rows) and not set(rows) & set(range(9)) and len(rows) == WORST


def test_the_sheet_the_rows_and_the_page(recording):
    files = [recording / n for n in ("clip.mp4", "markers.csv", "angles.csv", "angles.json")]
    review_recording(*files, recording / "review.jpg", recording / "review.csv", ReviewRecordingJob())
    rows = pd.read_csv(recording / "review.csv")
    assert {109, 200} <= set(rows["frame"]) and set(rows["marker"]) == {"pivot", "joint", "tip"}
    assert (rows[rows["frame"] == 109]["reason"] == "lost:blue").all()
    sheet = cv2.imread(str(recording / "review.jpg"))
    assert sheet.shape[1] == 4 * 324 and sheet.shape[0] >= 3 * 180
    rows[rows["frame"] == 200].to_csv(recording / "mine.csv", index=False)
    corrected = read_corrections(recording / "mine.csv")["clip"]
    assert [c.marker for c in corrected] == ["pivot", "joint", "tip"]
    review([recording / "angles.json"], recording / "review.html", {"b<1": "no & markers"})
    page = (recording / "review.html").read_text()
    assert page.count("data:image/jpeg;base64,") == 1 and "lost:blue 20" in page
    assert "b&lt;1" in page and "no &amp; markers" in page and "clip,109,tip" in page


def test_exports_hold_the_same_numbers(recording):
    folder = recording / "export"
    export_recording(recording / "markers.csv", recording / "angles.csv", folder)
    points, angles = pd.read_csv(recording / "markers.csv"), pd.read_csv(recording / "angles.csv")
    units = pd.read_csv(folder / "units.csv")
    np.testing.assert_allclose(units["theta2 [deg]"], np.rad2deg(angles["theta2"]), rtol=1e-6)
    np.testing.assert_allclose(units["tip_y [px]"], points["tip_y"], rtol=1e-6)
    lab = pd.read_csv(folder / "deeplabcut.csv", header=[0, 1, 2], index_col=0)
    assert lab.columns.names == ["scorer", "bodyparts", "coords"] and list(lab.index) == list(range(COUNT))
    np.testing.assert_allclose(lab["expertaug", "joint", "x"], points["joint_x"], rtol=1e-5)
    assert (lab["expertaug", "tip", "likelihood"][100:120] == 0).all()
    lines = (folder / "tracker.csv").read_text().splitlines()
    assert lines[:3] == ["#multi:", ",pivot,,joint,,tip,", "t,x,y,x,y,x,y"] and len(lines) == COUNT + 3
    row = [float(v) for v in lines[3 + 50].split(",")]
    assert row[0] == pytest.approx(50 / RATE)
    assert row[6] == pytest.approx(points["pivot_y"][0] - points["tip_y"][50], abs=1e-3)  # upwards
    assert lines[3 + 105].endswith(",,")

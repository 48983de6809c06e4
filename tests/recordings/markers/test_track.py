"""The tracking stage on frame stores, and on the one real video frame where it is at hand."""

import csv
import os
from pathlib import Path

import cv2
import numpy as np
import pytest

from expertaug.errors import InputError
from expertaug_recordings.markers.geometry import estimate_geometry
from expertaug_recordings.markers.track import run_stage as track_markers
from expertaug_recordings.markers.tracker import track_frames
from expertaug_recordings.rendering.render import markers, poses
from expertaug_recordings.rendering.scene import Scene
from expertaug_recordings.settings import TrackMarkersJob
from expertaug_recordings.tables import MARKERS
from expertaug_recordings.video.frame_store import writing
from expertaug_recordings.video.pixel_layout import Layout

ARMS, PIVOT, RATE = (120.4, 92.2), (240.1, 238.2), 100.0
REAL = Path(
    os.environ.get("EXPERTAUG_RECORDINGS", Path(__file__).resolve().parents[3].parent / "shared" / "recordings")
)


@pytest.fixture(scope="module")
def clip():
    """Uncompressed frames (n, 480, 480, 3) of a second at 100 Hz and the true positions (n, 3, 2)."""
    t = np.arange(100) / RATE
    speed = np.full_like(t, 6.0), np.full_like(t, -40.0)
    states = np.stack([0.4 + speed[0] * t, 1 + speed[1] * t, *speed], axis=1)
    scene = Scene(480, PIVOT, ARMS, 4.0, np.random.default_rng(0))
    frames = np.stack([scene.frame(poses(state, PIVOT, ARMS, 90e-6)) for state in states])
    return frames, np.stack([np.broadcast_to(PIVOT, (len(t), 2)), *markers(states, PIVOT, ARMS)], axis=1)


def save(frames, path):
    with writing(path, Layout("bgr24", frames.shape[2], frames.shape[1]), RATE, {"file": "clip"}) as writer:
        for frame in frames:
            writer.append(frame)
    return path


def test_table_has_one_row_a_frame_and_empty_positions_where_lost(clip, tmp_path):
    frames, truth = clip[0].copy(), clip[1]
    frames[40:50, :, :, :] = 0
    track = track_markers(save(frames, tmp_path / "frames.b2nd"), tmp_path / "markers.csv", TrackMarkersJob())
    with (tmp_path / "markers.csv").open(newline="") as stream:
        header, *rows = csv.reader(stream)
    assert tuple(header) == MARKERS
    assert ",".join(header) == "frame,t,pivot_x,pivot_y,joint_x,joint_y,tip_x,tip_y,quality,reason"
    assert [int(row[0]) for row in rows] == list(range(100))
    assert [float(row[1]) for row in rows] == pytest.approx(np.arange(100) / RATE)
    for i, row in enumerate(rows):
        if 40 <= i < 50:
            assert row[2:] == [""] * 6 + ["0.0000", "lost:red+green+blue"]
        else:
            assert np.array(row[2:8], float) == pytest.approx(truth[i].ravel(), abs=0.3)
            assert float(row[8]) == pytest.approx(track.quality[i], abs=1e-4)
            assert row[9] == ""
    assert np.isfinite(track.position[:40]).all()
    assert np.isnan(track.position[40:50]).all()


def test_given_arm_lengths_are_used(clip, tmp_path):
    store = save(clip[0][:20], tmp_path / "frames.b2nd")
    with pytest.raises(InputError, match=r"20 of 20 frames are unusable \(arm_length in 20\); at most a share of 0.25"):
        track_markers(store, tmp_path / "markers.csv", TrackMarkersJob(arm2_px=86.0))
    assert not (tmp_path / "markers.csv").exists()


def test_video_without_markers_is_refused(tmp_path):
    frames = np.zeros((12, 120, 160, 3), np.uint8)
    for i, frame in enumerate(frames):
        cv2.circle(frame, (40 + i, 60), 13, (255, 255, 255), -1)
    store = save(frames, tmp_path / "frames.b2nd")
    with pytest.raises(
        InputError, match=r"frames\.b2nd: no markers: of 12 frames looked at, 0 show all three"
    ) as error:
        track_markers(store, tmp_path / "markers.csv", TrackMarkersJob())
    assert "red in 0, green in 0, blue in 0" in str(error.value)
    assert "\n" not in str(error.value)
    assert not (tmp_path / "markers.csv").exists()


def test_video_that_loses_a_marker_for_long_is_refused(clip, tmp_path):
    frames, truth = clip[0].copy(), clip[1]
    for i in range(30, 70):
        x, y = truth[i, 1].round().astype(int)
        cv2.rectangle(frames[i], (x - 15, y - 15), (x + 15, y + 15), (0, 0, 0), -1)
    store = save(frames, tmp_path / "frames.b2nd")
    with pytest.raises(InputError, match=r"40 of 100 frames are unusable \(lost:green in 40\)"):
        track_markers(store, tmp_path / "markers.csv", TrackMarkersJob())
    assert len(track_markers(store, tmp_path / "markers.csv", TrackMarkersJob(max_lost_share=0.5)).reason) == 100


def test_missing_store_is_named(tmp_path):
    with pytest.raises(InputError, match=r"nothing\.b2nd: no such file"):
        track_markers(tmp_path / "nothing.b2nd", tmp_path / "markers.csv", TrackMarkersJob())


def test_real_frame_within_half_a_pixel_of_its_labels():
    labels = REAL / "original" / "dpc_dataset_csv" / "0.csv"
    if not (REAL / "frame.png").is_file() or not labels.is_file():
        pytest.skip(f"no real recordings at {REAL}; set EXPERTAUG_RECORDINGS")
    frame = cv2.imread(str(REAL / "frame.png"))
    row = np.genfromtxt(labels, delimiter=",", skip_header=101, max_rows=1)
    truth = (row.reshape(3, 2)[:, ::-1] - 2) / 5  # vertical first in the file
    geometry, _ = estimate_geometry([frame], TrackMarkersJob())
    track = track_frames([frame], geometry, TrackMarkersJob())
    assert track.reason == [""]
    assert np.abs(track.position[0] - truth).max() < 0.5
    assert geometry.arm1 == pytest.approx(120.4, abs=0.9)
    assert geometry.arm2 == pytest.approx(92.2, abs=0.9)

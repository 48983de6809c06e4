"""From inspect to the calibration, by the proposed configuration as it stands, at every usual frame rate."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from drawn import PAINT, draw, markers_of, write_video
from pendulum_motion import CONSTANTS, FRICTION

from expertaug.config import load as config
from expertaug.config import recording_settings
from expertaug.trajectories import Trajectories
from expertaug_recordings.angles.calibration import run_stage as calibrate
from expertaug_recordings.angles.measure import run_stage as measure_angles
from expertaug_recordings.chunks import split_chunks
from expertaug_recordings.inspection.inspect import inspect
from expertaug_recordings.markers.track import run_stage as track_markers
from expertaug_recordings.rendering.motion import simulate
from expertaug_recordings.video.frame_store import run_stage as extract_frames

ROOT = Path(__file__).parents[3]
FILES = [ROOT / "config" / "config.yaml"]
# A pendulum of .30 and .22 m, as one that 24 frames/s can follow: like the small one, .55 times as fast.
SLOWER, ARMS, PIVOT, SIZE = 0.55, (52.0, 38.0), (110.2, 100.7), (224, 208)
FRAMES = {24: 700, 25: 700, 30: 800, 38: 1000, 50: 1200, 60: 1500, 120: 1500, 240: 2100}


def filmed(folder, rate):
    """A clip at a rate, and its true angles (n, 2)."""
    times = np.arange(FRAMES[rate]) / rate * SLOWER
    y = simulate(np.array([[1.9, 1.2, 0.0, 0.0]]), times, CONSTANTS, FRICTION)[0]
    frames = draw(markers_of(y[:, :2], PIVOT, ARMS), SIZE, [PAINT[n] for n in ("red", "green", "blue")], 16)
    return write_video(frames, folder / "clip.mp4", rate), y[:, :2]


@pytest.mark.slow
@pytest.mark.parametrize("rate", FRAMES, ids=str)
def test_what_inspect_proposes_leads_to_chunks_and_a_calibration(tmp_path, rate):
    video, theta = filmed(tmp_path, rate)
    proposed = yaml.safe_load(inspect(video, tmp_path / "contact.png"))
    found = config.validate(config.merge(config.load(FILES), proposed | {"run": ["double_pendulum"]}))
    folder = tmp_path / "clip"
    folder.mkdir()
    store, markers, angles, summary = (folder / n for n in ("s.b2frame", "markers.csv", "angles.csv", "angles.json"))
    extract_frames(video, store, recording_settings.extract_frames(found, "clip"))
    track_markers(store, markers, recording_settings.track_markers(found, "clip"))
    measure_angles(markers, angles, summary, recording_settings.measure_angles(found, "clip"))
    seen = json.loads(summary.read_text())
    assert seen["rate_hz"] == pytest.approx(rate) and seen["tracked_share"] > 0.95
    assert seen["timing"]["repeated"] == seen["timing"]["dropped"] == 0
    places = pd.read_csv(markers)[["pivot_x", "pivot_y", "joint_x", "joint_y", "tip_x", "tip_y"]].to_numpy()
    off = np.linalg.norm(places.reshape(-1, 3, 2) - markers_of(theta, PIVOT, ARMS), axis=2)
    assert np.nanmedian(off) < 0.15
    split = recording_settings.split_chunks(found, "double_pendulum")
    assert split.rate_hz <= 100 and (rate / split.rate_hz).is_integer()
    split_chunks([angles], tmp_path / "data", split)
    train = Trajectories.load(tmp_path / "data" / "train.npz")
    assert train.t[1] == pytest.approx(1 / split.rate_hz) and train.t[-1] == pytest.approx(0.19, abs=0.07)
    calibrate(
        tmp_path / "data" / "train.npz", tmp_path / "c.json", recording_settings.calibrate(found, "double_pendulum")
    )

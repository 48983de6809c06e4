"""A single pendulum by the same chain: from a clip to chunks that the pendulum's experiment takes."""

import json
import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from drawn import PAINT, draw, write_video

from docs_pages import blocks
from expertaug.config import load as config
from expertaug.config import recording_settings
from expertaug.errors import InputError
from expertaug.trajectories import Trajectories
from expertaug_recordings.angles.measure import run_stage as measure_angles
from expertaug_recordings.angles.pendulum_fit import fit_single
from expertaug_recordings.chunks import split_chunks
from expertaug_recordings.inspection.inspect import inspect
from expertaug_recordings.markers.track import run_stage as track_markers
from expertaug_recordings.reports.page import run_stage as plot_recording
from expertaug_recordings.reports.splits import run_stage as plot_splits
from expertaug_recordings.reports.summary import run_stage as summarise
from expertaug_recordings.video.frame_store import run_stage as extract_frames

FILES = [Path(__file__).parents[3] / "config" / "config.yaml"]
OMEGA0, ALPHA, RATE, COUNT = 5.5, 0.08, 60, 1500
ARM, PIVOT, SIZE = 92.0, (110.3, 60.4), (220, 190)
SHOWN = {block.file: block.text for block in blocks(FILES[0].parents[1] / "docs" / "recordings.md")}
SWING = {key: part for key, part in yaml.safe_load(SHOWN["swing.yaml"]).items() if key != "recordings"}


def swung(start, count, omega0=OMEGA0):
    """Angle and speed (count, 2) from a start on, at RATE."""
    y, (angle, speed) = [], start
    h = 1 / (20 * RATE)
    for _ in range(count):
        y.append((angle, speed))
        for _ in range(20):  # leapfrog with the damping in between
            speed += h / 2 * (-(omega0**2) * math.sin(angle) - ALPHA * speed)
            angle += h * speed
            speed = (speed - h / 2 * omega0**2 * math.sin(angle)) / (1 + h / 2 * ALPHA)
    return np.array(y)


def motion():
    return swung((1.1, 0.0), COUNT)


def clip(path, names, tilt_deg=0.0):
    """A clip of a bob and a pivot, of the colours of these names or none."""
    at = motion()[:, 0] + np.deg2rad(tilt_deg)
    joint = np.array(PIVOT) + ARM * np.stack((np.sin(at), np.cos(at)), axis=1)
    centre = np.stack((np.broadcast_to(PIVOT, joint.shape), joint, joint), axis=1)
    colours = [None if name is None else PAINT[name] for name in names]
    return write_video(draw(centre, SIZE, [*colours, None], 16), path, RATE)


@pytest.mark.slow
@pytest.mark.parametrize("names", [("red", "green"), (None, "orange")])
def test_a_single_pendulum_from_inspect_to_chunks(tmp_path, names):
    video = clip(tmp_path / "clip.mp4", names, 3.0)
    text = inspect(video, tmp_path / "contact.png")
    proposed = yaml.safe_load(text)
    markers = proposed["recordings"]["tracking"]["markers"]
    assert markers["tip"] is None and (markers["pivot"] is None) == (names[0] is None) and markers["joint"] == names[1]
    assert "single pendulum, disks of" in text
    assert proposed["recordings"]["angles"]["rotation_deg"] == pytest.approx(3.0, abs=0.5)
    found = config.validate(config.merge(config.merge(config.load(FILES), proposed), SWING))
    folder = tmp_path / "clip"
    folder.mkdir()
    store, table, angles, summary = (folder / n for n in ("s.b2frame", "markers.csv", "angles.csv", "angles.json"))
    extract_frames(video, store, recording_settings.extract_frames(found, "clip"))
    track_markers(store, table, recording_settings.track_markers(found, "clip"))
    measure_angles(table, angles, summary, recording_settings.measure_angles(found, "clip"))
    seen, told = pd.read_csv(angles), json.loads(summary.read_text())
    good = (seen["quality"] == 1).to_numpy()
    off = np.rad2deg(np.abs(seen["theta1"].to_numpy() - motion()[:, 0]))[good]
    assert good.mean() > 0.9 and seen["theta2"].isna().all() and seen["omega2"].isna().all()
    assert np.median(np.abs(off - np.median(off))) < 0.1 and np.median(off) < 0.5  # the first within gravity's error
    assert told["pendulum"] == "single" and math.sqrt(told["constants"]["G1"]) == pytest.approx(OMEGA0, rel=0.005)
    assert told["friction"][0] == pytest.approx(ALPHA, abs=0.01)
    split_chunks([angles], tmp_path / "data", recording_settings.split_chunks(found, "swing"))
    test = Trajectories.load(tmp_path / "data" / "test.npz")
    assert test.y.shape[2] == 2 and test.z_e.shape[1] == 1 and test.z_e == pytest.approx(OMEGA0, rel=0.005)
    for y, z_e in zip(test.y[::5], test.z_e[::5], strict=True):
        assert np.abs(swung(y[0], len(y), float(z_e[0]))[:, 0] - y[:, 0]).max() < 0.05
    plot_recording(table, angles, summary, folder / "page.png")
    plot_splits(tmp_path / "data", tmp_path / "splits.png")
    summarise([summary], tmp_path / "s.csv", tmp_path / "s.md")
    assert "| – |" in (tmp_path / "s.md").read_text()


def test_the_fit_finds_gravity_and_refuses_what_is_no_pendulum():
    y = motion()
    turned = y + np.array([np.deg2rad(10.0), 0.0])
    fit, gravity = fit_single(turned, RATE)
    assert gravity.degrees == pytest.approx(10.0, abs=0.05) and pytest.approx(OMEGA0**2, rel=1e-3) == fit.constants.G1
    noise = np.random.default_rng(0).normal(size=y.shape)
    with pytest.raises(InputError, match=r"explains .* of the motion"):
        fit_single(noise, RATE)


def test_the_system_must_be_the_recordings(tmp_path):
    (tmp_path / "clip.mp4").write_text("")
    recordings = {"source": "videos", "videos": {"path": str(tmp_path)}, "tracking": {"markers": {"tip": None}}}
    for run, message in ((["double_pendulum"], "found double_pendulum; the recordings are of a single pendulum"),):
        with pytest.raises(InputError, match=message):
            config.validate(config.merge(config.load(FILES), {"recordings": recordings, "run": run}))
    with pytest.raises(InputError, match="found pendulum; they are not"):
        config.validate(config.merge(config.load(FILES), SWING))

"""Torn frames, whose upper part is of another time than their lower one: found, named and left out, or refused."""

import json

import numpy as np
import pandas as pd
import pytest
from pendulum_motion import markers, real_recordings, truth

from expertaug.errors import InputError
from expertaug_recordings.angles.marker_table import read_markers
from expertaug_recordings.angles.measure import run_stage as measure_angles
from expertaug_recordings.angles.tearing import find_torn
from expertaug_recordings.ibm import import_markers, list_marker_files
from expertaug_recordings.reports.page import _heading
from expertaug_recordings.reports.summary import RecordingSummary
from expertaug_recordings.settings import ImportMarkersJob, MeasureAnglesJob
from expertaug_recordings.tables import PLACES

RADIUS = 12.7  # px


def places(table):
    return table[list(PLACES)].to_numpy().reshape(-1, 3, 2)


def sound(every, launch=0, count=600, noise=0.06):
    """Markers of every so many frames of 400 Hz."""
    return markers(truth()[launch, : count * every : every], 400 / every, noise)


def torn_table(every, chosen, rows, launch=0, count=600):
    """The same where the chosen frames show what the frame before shows from a row of px on, and how much later joint
    and tip are, (n, 2) in frames."""
    table, before = sound(every, launch, count), sound(every, launch, count, 0.0).shift(1)
    late = np.zeros((count, 2))
    for k, role in enumerate(("joint", "tip")):
        middle = (table[f"{role}_y"] + before[f"{role}_y"]) / 2
        late[chosen, k] = np.clip((middle[chosen] + RADIUS - rows) / (2 * RADIUS), 0, 1)
        for axis in "xy":
            name = f"{role}_{axis}"
            table[name] += np.where(late[:, k] > 0, late[:, k] * (before[name] - table[name]), 0.0)
    return table, late


def between(every, launch, share=0.04, count=600):
    """Some frames, and rows between their joint and tip."""
    chosen = np.flatnonzero(np.random.default_rng(3).random(count - 6) < share) + 3
    return chosen, sound(every, launch, count)[["joint_y", "tip_y"]].to_numpy().mean(1)[chosen]


def find(table):
    every = np.ones(len(table), bool)
    return find_torn(table["t"].to_numpy(), places(table), every, every)


@pytest.mark.parametrize("every", [4, 7, 13])
@pytest.mark.parametrize("launch", [0, 1])
def test_frames_whose_markers_are_of_different_times_are_found(every, launch):
    """Those that put a marker off by more than a twelfth of its diameter."""
    table, late = torn_table(every, *between(every, launch), launch)
    off = np.linalg.norm(places(table) - places(sound(every, launch)), axis=2).max(1)
    apart = np.abs(late[:, 0] - late[:, 1]) > 0.2
    torn = find(table)
    assert (apart & (off > 2)).sum() >= 10
    assert torn[apart & (off > 2)].mean() > 0.75 and not torn[off < 0.5].any()


@pytest.mark.parametrize("every", [1, 4, 10, 16])
def test_sound_frames_are_not_torn(every):
    for launch in range(3):
        assert not find(sound(every, launch)).any()


def test_other_faults_of_time_are_not_tearing():
    """Frames that are repeated, missing, or whose rows are read one after the other."""
    whole = sound(4)
    repeated = whole.iloc[np.floor(np.arange(600) * 0.8).astype(int)].assign(t=whole["t"].to_numpy())
    missing = whole.drop(index=np.random.default_rng(0).choice(600, 60, replace=False)).assign(t=np.arange(540) / 100)
    rolling = whole.copy()
    for role in ("joint", "tip"):
        shift = whole[f"{role}_y"] / 480 * 0.6
        for axis in "xy":
            rolling[f"{role}_{axis}"] += shift * np.gradient(whole[f"{role}_{axis}"])
    for table in (repeated, missing, rolling):
        assert not find(table).any()


@pytest.mark.slow
def test_nothing_is_torn_in_the_real_recordings(tmp_path):
    files = list_marker_files(real_recordings())
    name = list(files)[2]
    import_markers(files[name], tmp_path / "markers.csv", ImportMarkersJob())
    assert read_markers(tmp_path / "markers.csv").timing.torn == 0


def test_torn_frames_are_left_out_and_the_summary_and_the_page_say_so(tmp_path):
    files = [tmp_path / name for name in ("markers.csv", "angles.csv", "angles.json")]
    table, _ = torn_table(4, *between(4, 0))
    table.to_csv(files[0], index=False)
    measure_angles(*files, MeasureAnglesJob(rate_hz=100.0, max_gap_frames=0))
    angles, summary = pd.read_csv(files[1]), json.loads(files[2].read_text())
    assert summary["timing"]["torn"] >= 10 and summary["reasons"]["torn"] == summary["timing"]["torn"]
    assert sum("frames are torn" in text for text in summary["warnings"]) == 1
    assert "frames torn" in _heading(RecordingSummary.load(files[2]))
    good = (angles["quality"] == 1).to_numpy()
    off = np.angle(np.exp(1j * (angles[["theta1", "theta2"]].to_numpy() - truth()[0, :2400:4, :2])))[good]
    ratio = np.sqrt(np.mean(angles[["theta1_std", "theta2_std"]].to_numpy()[good] ** 2, 0) / np.mean(off**2, 0))
    assert ((ratio > 1 / 1.5) & (ratio < 1.5)).all(), ratio


@pytest.mark.parametrize("every", [4, 13])
def test_a_recording_that_is_torn_throughout_is_refused(tmp_path, every):
    """The tear moves down by a few rows from frame to frame, as with clocks of slightly different rates."""
    table, _ = torn_table(every, np.arange(2, 598), (3.0 * np.arange(596)) % 480)
    table.to_csv(tmp_path / "markers.csv", index=False)
    with pytest.raises(InputError, match=r"of 600 frames are torn: .* capture with vertical sync"):
        read_markers(tmp_path / "markers.csv")

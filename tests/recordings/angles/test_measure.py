import json

import numpy as np
import pandas as pd
import pytest
from pendulum_motion import CONSTANTS, markers, real_recordings, truth

from expertaug.errors import InputError
from expertaug.systems.double_pendulum import GRAVITY
from expertaug_recordings.angles.measure import run_stage as measure_angles
from expertaug_recordings.ibm import import_markers, list_marker_files
from expertaug_recordings.rendering.motion import simulate
from expertaug_recordings.reports.summary import run_stage as summarise
from expertaug_recordings.settings import ImportMarkersJob, MeasureAnglesJob
from nightly import others_slow

STATE = ["theta1", "theta2", "omega1", "omega2"]


def measure(folder, table, **settings):
    folder.mkdir(parents=True, exist_ok=True)
    table.to_csv(folder / "markers.csv", index=False)
    files = (folder / name for name in ("markers.csv", "angles.csv", "angles.json"))
    measure_angles(*files, MeasureAnglesJob(**settings))
    return pd.read_csv(folder / "angles.csv"), json.loads((folder / "angles.json").read_text())


def errors(angles, y, quality=1.0):
    """Angle errors (wrapped) and speed errors of the frames of one quality."""
    at = angles["quality"].to_numpy() == quality
    difference = angles[STATE].to_numpy()[at] - y[at]
    difference[:, :2] = np.angle(np.exp(1j * difference[:, :2]))
    return difference


def test_angles_and_speeds_are_those_of_the_truth(tmp_path):
    y = truth()[0, :4000]
    angles, summary = measure(tmp_path / "a", markers(y))
    rms = np.sqrt((errors(angles, y) ** 2).mean(0))
    raw = 0.07 * np.sqrt(2) / np.array([118, 90])
    assert (rms[:2] < 0.5 * raw).all()  # better than the markers themselves
    assert (rms[2:] < [0.04, 0.08]).all()
    assert np.abs(np.diff(angles["theta2"].dropna())).max() < 0.3  # unwrapped
    assert summary["tracked_share"] == 1 and summary["gaps"] == 0
    assert summary["arm1_px"] == pytest.approx(118, abs=0.02) and summary["arm2_px"] == pytest.approx(90, abs=0.02)
    assert summary["noise1_deg"] == pytest.approx(np.rad2deg(0.07 / 118), rel=0.2)
    for name, value in CONSTANTS.to_dict().items():
        assert summary["constants"][name] == pytest.approx(value, rel=0.02)
    assert summary["energy_start"] > summary["energy_end"] > 0


def test_energy_is_kept_without_friction(tmp_path):
    y = simulate(truth()[0, :1], np.arange(1600) / 400, CONSTANTS, (0.0, 0.0))[0]
    angles, summary = measure(tmp_path / "a", markers(y))
    level = angles.loc[angles["quality"] == 1, "energy"]
    assert level.std() < 0.005 * level.mean()
    assert summary["friction"] == pytest.approx([0, 0], abs=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("rate", [400, 200, 100])
def test_the_default_window_is_near_the_best_at_every_rate(tmp_path, rate):
    """Speeds against the truth, over windows of .04 to .16 s: the default's error is at most 1.3 times the least."""
    step = 400 // rate
    y = truth()[:, :4000]
    scores = {}
    for window in (0.04, 0.06, 0.08, 0.1, 0.12, 0.16):
        squares = []
        for k, motion in enumerate(y):
            table = markers(motion[::step], rate, seed=k)
            angles, _ = measure(tmp_path / str(k), table, smoothing_window_s=window)
            squares.append((errors(angles, motion[::step])[:, 2:] / [1, 2]) ** 2)
        scores[window] = np.sqrt(np.concatenate(squares).mean())
    assert scores[0.08] <= 1.3 * min(scores.values()), scores


@pytest.mark.slow
def test_a_swaying_pivot_is_followed(tmp_path):
    y = truth()[0, :4000]
    table = markers(y)
    sway = 1.0 * np.sin(2 * np.pi * 3 * table["t"])
    for name in ("pivot_y", "joint_y", "tip_y"):
        table[name] += sway
    followed = np.sqrt((errors(measure(tmp_path / "a", table)[0], y)[:, 0] ** 2).mean())
    constant, _ = measure(tmp_path / "b", table, pivot_window_s=10.0)
    fixed = np.sqrt((errors(constant, y)[:, 0] ** 2).mean())
    assert followed < 0.0005 < 5 * followed < fixed


def test_a_lost_pivot_alone_costs_no_frame(tmp_path):
    y = truth()[0, :1600]
    table = markers(y)
    table.loc[500:600, ["pivot_x", "pivot_y"]] = np.nan
    table.loc[500:600, ["quality", "reason"]] = 0.0, "lost:red"
    table.loc[1000:1005, ["pivot_x", "pivot_y"]] += 40.0  # taken for another marker
    angles, summary = measure(tmp_path / "a", table)
    assert summary["gaps"] == 0
    assert np.abs(errors(angles, y)[:, 0]).max() < 0.004


@pytest.mark.parametrize("seed", others_slow([7, 6, 0, 1, 2, 3, 4, 5], 2))
def test_gaps_are_filled_only_where_short(tmp_path, seed):
    """Speeds err more at a stretch's ends, where only the shortest window fits, and are stated to."""
    y = truth()[0, :1600]
    table = markers(y, seed=seed)
    for start, length in ((500, 6), (1000, 30)):
        table.loc[start : start + length - 1, ["tip_x", "tip_y"]] = np.nan
        table.loc[start : start + length - 1, ["quality", "reason"]] = 0.0, "lost:blue"
    angles, summary = measure(tmp_path / "a", table)
    assert (angles["quality"][500:506] == 0.5).all() and (angles["reason"][500:506] == "interpolated").all()
    assert (angles["quality"][1000:1030] == 0).all() and (angles["reason"][1000:1030] == "lost:blue").all()
    assert angles[STATE][1000:1030].isna().all(axis=None)
    assert (summary["gaps"], summary["longest_gap_frames"], summary["interpolated"]) == (1, 30, 6)
    assert summary["tracked_share"] == pytest.approx(1 - 36 / 1600)
    filled = (angles[STATE].to_numpy() - y)[500:506]
    assert np.abs(np.angle(np.exp(1j * filled[:, :2]))).max() < 0.004 and np.abs(filled[:, 2:]).max() < 0.2
    off, frame = np.abs(errors(angles, y)), np.flatnonzero(angles["quality"] == 1)
    inside = (np.abs(frame[:, None] - [0, 1000, 1029, 1599]) >= 8).all(axis=1)
    assert off[:, :2].max() < 0.005 and off[inside, 2:].max() < 0.5 and off[:, 2:].max() < 1.0
    assert (off[~inside] < 4 * angles[[f"{name}_std" for name in STATE]].to_numpy()[frame[~inside]]).all()


def test_a_gap_in_which_an_arm_may_turn_is_never_filled(tmp_path):
    table = markers(truth()[0, :1600])
    table.loc[1000:1019, ["tip_x", "tip_y"]] = np.nan
    angles, summary = measure(tmp_path / "a", table, max_gap_frames=100)
    assert summary["interpolated"] == 0 and (angles["quality"][1000:1020] == 0).all()


def test_faults_of_the_tracker_are_rejected(tmp_path):
    y = truth()[0, :1600]
    table = markers(y)
    table.loc[700, ["tip_x", "tip_y"]] += 12.0  # off the arm's circle
    turn = np.deg2rad(5)  # on the circle, but off the motion
    arm = table.loc[900, ["tip_x", "tip_y"]].to_numpy(float) - table.loc[900, ["joint_x", "joint_y"]].to_numpy(float)
    turned = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ arm
    table.loc[900, ["tip_x", "tip_y"]] = table.loc[900, ["joint_x", "joint_y"]].to_numpy(float) + turned
    angles, summary = measure(tmp_path / "a", table)
    assert summary["rejected_arm_length"] == 1
    assert angles["quality"][700] == 0.5 and angles["quality"][900] == 0.5
    assert np.abs(errors(angles, y)[:, :2]).max() < 0.005
    assert (angles["quality"] == 1).mean() > 0.98


@pytest.mark.slow
def test_implied_rate(tmp_path):
    """Times that are stretched by 500/400 make the motion imply 500 Hz at nominal 400."""
    length = GRAVITY * CONSTANTS.B2 / CONSTANTS.G2
    table = markers(truth()[0, :8000])
    _, summary = measure(tmp_path / "a", table, arm1_m=length / 1.25**2, rate_provenance="x")
    assert summary["implied_rate_hz"] == pytest.approx(500, rel=0.01)
    assert (summary["rate_hz"], summary["rate_provenance"]) == (400, "x")


def bad_table(kind):
    table = markers(truth()[0, :2000])
    if kind == "column":
        return table.drop(columns="joint_y")
    if kind == "header":
        return table[:0]
    if kind == "no pivot":
        table[["pivot_x", "pivot_y"]] = np.nan
    if kind == "text":
        table["joint_y"] = table["joint_y"].astype(object)
        table.loc[4, "joint_y"] = "here"
    elif kind == "uneven":
        table.loc[50, "t"] -= 0.1
    elif kind == "lost":
        table[["tip_x", "tip_y"]] = np.nan
    elif kind == "upside down":
        for name in ("pivot_y", "joint_y", "tip_y"):
            table[name] = 480 - table[name]
    elif kind == "still":
        table[["joint_x", "joint_y", "tip_x", "tip_y"]] = [240.0, 356.0, 240.0, 446.0]
        table[["pivot_x", "pivot_y"]] = [240.0, 238.0]
    return table


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("column", "column joint_y is missing"),
        ("header", "0 frames; a recording needs at least 10"),
        ("no pivot", "no frame has a pivot"),
        ("text", "row 6, column joint_y: 'here' is no number"),
        ("uneven", "times do not grow"),
        ("lost", "0 of 2000 frames are usable"),
        ("upside down", "is no pendulum"),
        ("still", "do not determine"),
    ],
)
def test_bad_markers(tmp_path, kind, message):
    with pytest.raises(InputError, match=message) as error:
        measure(tmp_path / "a", bad_table(kind))
    assert "\n" not in str(error.value)
    assert not (tmp_path / "a" / "angles.csv").exists()


@pytest.mark.slow
def test_summary_table(tmp_path):
    for name in ("10", "2"):
        measure(tmp_path / name, markers(truth()[0, :2000]))
    paths = [tmp_path / name / "angles.json" for name in ("10", "2")]
    summarise(paths, tmp_path / "summary.csv", tmp_path / "summary.md")
    assert pd.read_csv(tmp_path / "summary.csv")["recording"].tolist() == [2, 10]
    lines = (tmp_path / "summary.md").read_text().splitlines()
    assert lines[2].startswith("| 2 | 2000 |") and lines[4] == ""
    assert "- 10: the motion implies 501.7 Hz, 25% above the stated 400 Hz" in "\n".join(lines)
    (tmp_path / "2" / "angles.json").write_text("{}")
    with pytest.raises(InputError, match="recording: Field required"):
        summarise(paths, tmp_path / "summary.csv", tmp_path / "summary.md")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["0", "10"])
def test_real_recordings(tmp_path, name):
    files = list_marker_files(real_recordings())
    import_markers(files[name], tmp_path / "markers.csv", ImportMarkersJob())
    measure_angles(tmp_path / "markers.csv", tmp_path / "angles.csv", tmp_path / "angles.json", MeasureAnglesJob())
    summary = json.loads((tmp_path / "angles.json").read_text())
    assert summary["usable_share"] > 0.99
    assert summary["arm1_px"] == pytest.approx(120.1 if name == "0" else 117.4, abs=0.1)
    assert summary["offsets_px"]["joint_arm1"] == pytest.approx(0.36, abs=0.03)  # the same pendulum in all of them
    assert summary["arm1_std_px"] < 0.12 and summary["arm2_std_px"] < 0.17  # .28 and .28 as if it were on its hinge
    assert 499 < summary["implied_rate_hz"] < 501
    assert min(summary["r2_1"], summary["r2_2"]) > 0.99
    assert summary["constants"]["B1"] == pytest.approx(0.103, rel=0.03)

"""Times as they were: uneven frames are resampled, repeated and missing ones found, and what that costs is said."""

import json

import numpy as np
import pandas as pd
import pytest
from pendulum_motion import markers, real_recordings, truth
from scipy.interpolate import CubicSpline

from expertaug.errors import InputError
from expertaug_recordings.angles.marker_table import read_markers
from expertaug_recordings.angles.measure import run_stage as measure_angles
from expertaug_recordings.ibm import import_markers, list_marker_files
from expertaug_recordings.reports.page import _heading
from expertaug_recordings.reports.page import run_stage as plot_recording
from expertaug_recordings.reports.summary import RecordingSummary
from expertaug_recordings.reports.summary import run_stage as summarise
from expertaug_recordings.settings import ImportMarkersJob, MeasureAnglesJob
from nightly import others_slow


def true_angles(t):
    return CubicSpline(np.arange(16000) / 400, truth()[0])(t)[:, :2]


def table_at(t, noise=0.0, seed=0):
    """markers.csv of frames at times t (n,) in s."""
    y = np.concatenate((true_angles(t), np.zeros((len(t), 2))), axis=1)
    return markers(y, noise=noise, seed=seed).assign(t=t)


def errors_deg(seen, to=true_angles):
    """Of the worse angle of each usable row against the truth at its time."""
    vector = np.diff(seen.places, axis=1)
    off = np.abs(np.angle(np.exp(1j * (np.arctan2(vector[..., 0], vector[..., 1]) - to(seen.t))))).max(1)
    return np.rad2deg(off[np.isfinite(off)])


def read(folder, table, rate=None):
    table.to_csv(folder / "markers.csv", index=False)
    return read_markers(folder / "markers.csv", rate)


@pytest.mark.parametrize("rate", [30, 60, 240])
def test_uneven_frames_are_resampled_and_the_cost_is_estimated(tmp_path, rate):
    """Every time is off by up to a fifth of an interval, and some frames are missing: as even ones they would be off by
    degrees.  The error that is said is within a factor of three of the true one."""
    rng = np.random.default_rng(0)
    t = (np.arange(20 * rate) + rng.uniform(-0.2, 0.2, 20 * rate)) / rate
    gone = rng.choice(np.arange(9, 20 * rate - 9), 12, replace=False)
    seen = read(tmp_path, table_at(np.delete(t, gone)), float(rate))
    off = errors_deg(seen)
    assert seen.rate_hz == rate and np.diff(seen.t) == pytest.approx(1 / rate)
    assert len(off) > 0.85 * len(t) and (seen.reason == "dropped").sum() >= 12
    median, most = seen.timing.error_deg
    assert np.median(off) / 3 < median < 3 * np.median(off)
    assert np.quantile(off, 0.99) / 3 < most < 3 * np.quantile(off, 0.99)
    assert np.median(off) < {30: 0.02, 60: 0.002, 240: 1e-4}[rate]
    assert seen.timing.uneven_ms == pytest.approx(1000 * 0.2 / rate, rel=0.2) or seen.timing.uneven_ms > 200 / rate


@pytest.mark.parametrize("rate", others_slow([30, 60]))
def test_uncertainties_of_uneven_frames_hold_what_interpolating_costs(tmp_path, rate):
    """Right within a factor of 1.5 also where most of the error is not the markers'."""
    rng = np.random.default_rng(0)
    t = (np.arange(20 * rate) + rng.uniform(-0.2, 0.2, 20 * rate)) / rate
    files = [tmp_path / name for name in ("markers.csv", "angles.csv", "angles.json")]
    table_at(t, noise=0.07).to_csv(files[0], index=False)
    measure_angles(*files, MeasureAnglesJob(rate_hz=float(rate)))
    table = pd.read_csv(files[1])
    table = table[table["quality"] == 1]
    off = np.angle(np.exp(1j * (table[["theta1", "theta2"]].to_numpy() - true_angles(table["t"]))))
    ratio = np.sqrt(np.mean(table[["theta1_std", "theta2_std"]].to_numpy() ** 2, axis=0) / np.mean(off**2, axis=0))
    assert ((ratio > 1 / 1.5) & (ratio < 1.5)).all(), ratio


def test_another_even_rate_is_resampled(tmp_path):
    seen = read(tmp_path, table_at(np.arange(2400) / 120), 100.0)
    assert (len(seen), seen.rate_hz, seen.timing.frames_hz) == (2000, 100, 120)
    assert np.quantile(errors_deg(seen), 0.99) < 0.01
    assert (np.abs(seen.t[:-1] - seen.source[:-1] / 120) <= 0.5 / 120 + 1e-9).all()


def test_even_frames_stay_as_they_are(tmp_path):
    table = table_at(np.arange(2000) / 100, noise=0.07)
    seen = read(tmp_path, table, 100.0)
    np.testing.assert_array_equal(
        seen.places.reshape(-1, 6), table[["pivot_x", "pivot_y", "joint_x", "joint_y", "tip_x", "tip_y"]]
    )
    assert seen.timing.frames_hz is None and seen.timing.repeated == seen.timing.dropped == 0
    assert (seen.reason == "").all()


@pytest.mark.parametrize("rate", others_slow([50, 240, 100], 2))
def test_repeated_and_missing_frames_are_found_from_the_motion(tmp_path, rate):
    t = np.arange(15 * rate) / rate
    rng = np.random.default_rng(1)
    chosen = np.sort(rng.choice(np.arange(20, len(t) - 20, 12), 15, replace=False))
    whole = table_at(t, noise=0.07)
    places = ["joint_x", "joint_y", "tip_x", "tip_y"]
    frozen = whole.copy()
    frozen.loc[chosen, places] = whole.loc[chosen - 1, places].to_numpy()
    seen = read(tmp_path, frozen)
    found = np.flatnonzero(seen.reason == "repeated")
    assert set(found) <= set(chosen) and len(found) >= 14
    assert (seen.quality[found] == 0).all() and seen.timing.dropped == 0
    lacking = whole.drop(index=chosen).assign(t=t[: len(t) - len(chosen)], frame=np.arange(len(t) - len(chosen)))
    seen = read(tmp_path, lacking)
    assert 12 <= seen.timing.dropped <= 15
    at = np.flatnonzero(seen.reason == "dropped")
    assert np.abs(at[:, None] - chosen).min(axis=1).max() <= 15  # those not found shift the later ones
    assert np.median(errors_deg(seen, lambda s: true_angles(np.clip(s, 0, 39)))) < 3


@pytest.mark.parametrize("rate", [50, 100])
def test_of_two_frames_that_show_the_same_the_one_of_another_time_is_not_used(tmp_path, rate):
    """Also where it is the first of them, which shows what the next will."""
    t = np.arange(8 * rate) / rate
    chosen = np.arange(20, len(t) - 20, 24)
    whole, places = table_at(t, noise=0.07), ["joint_x", "joint_y", "tip_x", "tip_y"]
    whole.loc[chosen, places] = whole.loc[chosen + 1, places].to_numpy()
    repeated = np.flatnonzero(read(tmp_path, whole).reason == "repeated")
    assert len(repeated) > 5 and np.isin(repeated, chosen).mean() > 0.9


def mixed_table(source_hz, rate, seconds=12, noise=0.05, seed=0, start=0.0):
    """markers.csv of a video brought to another rate by mixing neighbours, as disks of 25 px are found in rendered
    ones: the nearer the two images, the nearer to the middle of both, and less surely while they touch; those of nearly
    equal parts are seen as such where they lie apart."""
    at = start + np.arange(seconds * round(rate)) * source_hz / rate
    first, part = np.floor(at + 1e-9), (at + 1e-9) % 1
    rng, strong = np.random.default_rng(seed), first + (part > 0.5)
    table, middle = (table_at(strong / source_hz, of, seed) for of in (noise, 0.0))
    before, after = table_at(first / source_hz), table_at((first + 1) / source_hz)
    far = np.zeros(len(at), bool)
    for role in ("joint", "tip"):
        names = [f"{role}_x", f"{role}_y"]
        step = (after[names] - before[names]).to_numpy()
        length = np.linalg.norm(step, axis=1)[:, None]
        shift = before[names].to_numpy() + part[:, None] * step - middle[names].to_numpy()
        unsure = 0.5 * np.abs(at - strong)[:, None] * np.minimum(1, length / 2.5) * (length < 25)
        table[names] += shift / (1 + (length / 4.8) ** 4) + unsure * rng.normal(size=shift.shape)
        far |= length[:, 0] > 9
    table.loc[far & (np.abs(part - 0.5) < 0.12), "reason"] = "blended"
    return table.assign(t=np.arange(len(at)) / rate, frame=np.arange(len(at)))


MIXED = [
    *((50, 60, seed) for seed in range(4)),
    (24, 25, 1),
    (30, 60, 0),
    (60 / 1.001, 60, 2),
    (25, 30, 0),
    (48, 50, 3),
]


@pytest.mark.parametrize(("source_hz", "rate", "seed"), others_slow(MIXED, 6))
def test_mixed_frames_are_left_out_and_the_others_put_to_their_times(tmp_path, source_hz, rate, seed):
    files = [tmp_path / name for name in ("markers.csv", "angles.csv", "angles.json")]
    mixed_table(source_hz, rate, seed=seed).to_csv(files[0], index=False)
    measure_angles(*files, MeasureAnglesJob(rate_hz=float(source_hz)))
    seen, summary = pd.read_csv(files[1]), json.loads(files[2].read_text())
    assert summary["timing"]["converted_from_hz"] == pytest.approx(source_hz, rel=1e-4)
    assert sum("mixtures of two" in text and "left out" in text for text in summary["warnings"]) == 1
    assert "frames mixed from two" in _heading(RecordingSummary.load(files[2]))
    seen = seen[seen["quality"] == 1]
    off = np.angle(np.exp(1j * (seen[["theta1", "theta2"]].to_numpy() - true_angles(seen["t"]))))
    shared = np.deg2rad(summary["rotation_error_deg"])  # of the direction of gravity, which is right here
    own = np.mean(seen[["theta1_std", "theta2_std"]].to_numpy() ** 2, axis=0) - shared**2
    ratio = np.sqrt(own / np.mean(off**2, axis=0))
    assert ((ratio > 1 / 1.5) & (ratio < 1.5)).all(), ratio


def test_frames_of_which_most_are_mixed_are_used_with_a_warning(tmp_path):
    table = table_at(np.arange(1200) / 100, noise=0.07)
    table.loc[np.arange(1200) % 5 < 3, "reason"] = "blended"
    seen = read(tmp_path, table)
    assert seen.timing.blended_used and (seen.reason == "").all() and np.median(seen.interpolation) > np.deg2rad(0.3)
    assert "they were used" in seen.timing.doubts(1200)[0]


@pytest.mark.slow
def test_nothing_is_found_where_nothing_is_wrong(tmp_path):
    for rate in (400, 240, 100, 50):
        timing = read(tmp_path, markers(truth()[1, :: 400 // rate] if 400 % rate == 0 else truth()[1], rate)).timing
        assert (timing.repeated, timing.dropped) == (0, 0), rate


@pytest.mark.slow
def test_nothing_is_found_in_the_real_recordings(tmp_path):
    files = list_marker_files(real_recordings())
    for name in list(files)[::6]:
        import_markers(files[name], tmp_path / "markers.csv", ImportMarkersJob())
        timing = read_markers(tmp_path / "markers.csv").timing
        assert (timing.repeated, timing.dropped) == (0, 0), name


def test_times_that_do_not_grow_are_refused(tmp_path):
    table = table_at(np.arange(40) / 100)
    table.loc[20, "t"] = table.loc[19, "t"]
    with pytest.raises(InputError, match=r"times do not grow: 0.19 s, then 0.19 s"):
        read(tmp_path, table)


@pytest.mark.slow
def test_the_page_the_table_and_the_summary_say_what_resampling_cost(tmp_path):
    rng = np.random.default_rng(0)
    t = (np.arange(3000) + rng.uniform(-0.1, 0.1, 3000)) / 120
    folder = tmp_path / "phone"
    folder.mkdir()
    files = [folder / name for name in ("markers.csv", "angles.csv", "angles.json")]
    table_at(t, noise=0.05).to_csv(files[0], index=False)
    measure_angles(*files, MeasureAnglesJob(rate_hz=100.0, rate_provenance="rendered at this rate"))
    angles, summary = pd.read_csv(files[1]), json.loads(files[2].read_text())
    assert summary["timing"]["frames_hz"] == pytest.approx(120, rel=0.01) and summary["rate_hz"] == 100
    assert summary["usable_share"] > 0.9 and len(angles) == summary["frames"]
    assert np.abs(t[angles["source"]] - t[0] - (angles["t"] - t[0])).max() < 0.006
    heading = _heading(RecordingSummary.load(files[2]))
    assert "Times: off even ones by up to" in heading and "resampled from 12" in heading
    assert "implies" not in heading.split("gravity")[0]  # rendered: its constants belong to a nominal time
    plot_recording(*files, folder / "page.png")
    summarise([files[2]], tmp_path / "s.csv", tmp_path / "s.md")
    row = pd.read_csv(tmp_path / "s.csv").iloc[0]
    assert row["uneven_ms"] > 0 and ";" in row["error_deg"]


def test_many_repeated_frames_are_a_warning(tmp_path):
    """24 frames/s brought to 30 by showing every fourth twice."""
    shown = np.floor(np.arange(900) * 24 / 30).astype(int)
    table = table_at(np.arange(900) / 60).iloc[shown].reset_index(drop=True)
    table = table.assign(frame=np.arange(900), t=np.arange(900) / 60)
    seen = read(tmp_path, table)
    assert seen.timing.repeated > 150
    assert "repeat the one before" in seen.timing.doubts(900)[0]

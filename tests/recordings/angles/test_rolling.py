"""Clips whose frames are not at their times, as converters leave them: what cannot be undone is said, and stated."""

import functools
import json

import numpy as np
import pandas as pd
import pytest
from pendulum_motion import MARKERS, markers, truth
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from expertaug.errors import InputError
from expertaug_recordings.angles import rolling
from expertaug_recordings.angles.marker_table import read_markers
from expertaug_recordings.angles.measure import run_stage as measure_angles
from expertaug_recordings.angles.rolling import undo_rolling
from expertaug_recordings.angles.summary import RecordingSummary
from expertaug_recordings.reports.page import _heading
from expertaug_recordings.reports.summary import run_stage as summarise
from expertaug_recordings.settings import MeasureAnglesJob
from nightly import others_slow

ANGLES = ["theta1", "theta2"]


@functools.cache
def through():
    """The true states at any time in s."""
    return CubicSpline(np.arange(16000) / 400, truth(), axis=1)


def angles_at(t, launch=0):
    """True angles (n, 2) at times t (n,) in s."""
    return through()(t)[launch][:, :2]


def clip(shown, rate, launch=0, noise=0.05, slower=0.6):
    """markers.csv of evenly timed frames that show times (n,) in s, and the angles (n, 2) at their own."""
    y = np.concatenate((angles_at(np.asarray(shown) * slower, launch), np.zeros((len(shown), 2))), axis=1)
    return markers(y, rate, noise=noise), angles_at(np.arange(len(shown)) / rate * slower, launch)


def measure(folder, table, **settings):
    files = [folder / name for name in ("markers.csv", "angles.csv", "angles.json")]
    table.to_csv(files[0], index=False)
    measure_angles(*files, MeasureAnglesJob(arm1_m=None, **settings))
    return pd.read_csv(files[1]), RecordingSummary.load(files[2])


def off_and_stated(table, true):
    """Errors and standard uncertainties (n, 2) in degrees of the measured frames; ``true`` (frames, 2) in rad.

    What all errors have in common with one shift of all times is no error of a frame.
    """
    good = (table["quality"] == 1).to_numpy()
    off = np.angle(np.exp(1j * (table[ANGLES].to_numpy() - true)))[good]
    speed = np.gradient(np.unwrap(true, axis=0), axis=0)[good]
    off = off - speed * (off * speed).sum() / (speed**2).sum()
    return np.rad2deg(off), np.rad2deg(table[[f"{name}_std" for name in ANGLES]].to_numpy()[good])


def rms(values):
    return np.sqrt(np.mean(np.square(values), axis=0))


def irregular(kind, count, rate):
    """Times in s that frames show, of clips whose pattern nothing tells."""
    rng = np.random.default_rng(3)
    even = np.arange(count) / rate
    if kind == "a screen's refresh":  # each frame shows what was drawn last
        return np.floor(even * 144 + rng.uniform(0, 1, count)) / 144
    return even + rng.uniform(-0.3, 0.3, count) / rate


@pytest.mark.parametrize("rate", others_slow([30, 60, 120]))
@pytest.mark.parametrize("kind", ["a screen's refresh", "uneven"])
def test_frames_off_their_times_are_a_warning_and_widen_the_uncertainties(tmp_path, rate, kind, caplog):
    table, true = clip(irregular(kind, 400, rate), rate)
    angles, summary = measure(tmp_path, table)
    off, stated = off_and_stated(angles, true)
    ratio = rms(stated) / rms(off)
    assert (rms(off) > 0.2).all() and ((ratio > 1 / 1.5) & (ratio < 1.5)).all(), (rms(off), ratio)
    said = [text for text in summary.warnings if "off any pendulum's motion" in text]
    assert len(said) == 1 and "frames were off their times by" in said[0] and "\n" not in said[0]
    assert said[0] in caplog.text
    assert summary.misfit_deg == pytest.approx(rms(off), rel=0.5)
    assert "angles off its motion by" in " ".join(_heading(summary).split())
    summarise([tmp_path / "angles.json"], tmp_path / "s.csv", tmp_path / "s.md")
    assert "off any pendulum's motion" in (tmp_path / "s.md").read_text()
    assert ";" in pd.read_csv(tmp_path / "s.csv")["misfit_deg"][0]


@pytest.mark.parametrize(("rate", "launch"), others_slow([(25, 0), (60, 2), (30, 1), (120, 0), (400, 1)], 2))
def test_sound_clips_are_left_alone(tmp_path, rate, launch):
    table, true = clip(np.arange(500) / rate, rate, launch)
    angles, summary = measure(tmp_path, table)
    off, stated = off_and_stated(angles, true)
    ratio = rms(stated) / rms(off)
    assert ((ratio > 1 / 1.5) & (ratio < 1.5)).all(), ratio
    assert not [text for text in summary.warnings if "off any" in text or "converted" in text]
    assert json.loads((tmp_path / "angles.json").read_text())["timing"]["repeated"] == 0


def test_a_single_pendulum_too(tmp_path):
    t = irregular("uneven", 300, 30)
    theta = solve_ivp(lambda _, s: [s[1], -40 * np.sin(s[0])], (-1, 20), [2.2, 0], dense_output=True, rtol=1e-9).sol
    true, theta = theta(np.arange(300) / 30)[0], theta(t)[0]
    y = np.stack((theta, theta, 0 * t, 0 * t), axis=1)
    angles, summary = measure(tmp_path, markers(y, 30, noise=0.03), single=True)
    assert any("off any pendulum's motion" in text for text in summary.warnings)
    good = angles["quality"] == 1
    off = rms((angles["theta1"] - true)[good])
    assert 1 / 1.5 < rms(angles["theta1_std"][good]) / off < 1.5


@pytest.mark.parametrize("share", others_slow([0.1, 0.2]))
@pytest.mark.parametrize("rate", others_slow([30, 60]))
def test_many_missing_frames_are_bridged_at_a_cost_that_is_stated(tmp_path, rate, share):
    """A phone that leaves frames out, whose timestamps are right."""
    rng = np.random.default_rng(1)
    kept = np.flatnonzero((rng.uniform(size=400) > share) | (np.arange(400) % 3 == 0))
    table, _ = clip(kept / rate, rate)
    table["t"] = kept / rate
    angles, summary = measure(tmp_path, table, rate_hz=float(rate))
    off, stated = off_and_stated(angles, angles_at(angles["t"].to_numpy() * 0.6))
    ratio = rms(stated) / rms(off)
    print(rms(off), np.median(abs(off), 0), ratio, summary.usable_share, summary.warnings)
    assert summary.usable_share > 0.8 and ((ratio > 1 / 1.5) & (ratio < 1.5)).all(), ratio


def scrambled(kind):
    """A markers.csv of which next to nothing is usable, though all markers were found, and what is said of it."""
    rng = np.random.default_rng(0)
    if kind == "gaps":
        kept = np.flatnonzero(np.arange(600) % 7 < 3)
        table, _ = clip(kept / 30, 30)
        return table.assign(t=kept / 30), r"all markers were found, \d+ are missing.*; use a video that has all frames"
    if kind == "repeats":
        shown = np.repeat(np.sort(rng.choice(400, 100, replace=False)), 4)[:300] / 60
        return clip(shown, 60)[0], r"all markers were found, .*\d+ repeat the one before.*; use the video as it was"
    return clip(np.arange(60) / 4, 4)[0], r"turn by \d+° from frame to frame.*; 4 frames/s are too few"


@pytest.mark.parametrize("kind", ["gaps", "repeats", "one frame a swing"])
def test_refusals_name_the_cause(tmp_path, kind):
    table, message = scrambled(kind)
    with pytest.raises(InputError, match=message) as error:
        measure(tmp_path, table)
    assert "check the tracking" not in str(error.value) and "\n" not in str(error.value)


def test_markers_that_were_not_found_are_the_tracking(tmp_path):
    table, _ = clip(np.arange(100) / 60, 60)
    table.loc[5:, ["tip_x", "tip_y"]] = np.nan
    with pytest.raises(InputError, match=r"in 95 the markers were not found.*; check the tracking"):
        measure(tmp_path, table)


RATES = {  # of source and file in Hz → the least frames that repeat
    (60, 50): 0,
    (24, 30): 79,
    (30, 24): 0,
    (25, 30): 66,
    (24, 25): 15,
    (50, 60): 66,
    (60, 24): 0,
    (60 / 1.001, 50): 0,
    (24 / 1.001, 30): 79,
    (30, 60): 199,
    (240, 200): 0,
}


@pytest.mark.parametrize(("source", "rate"), others_slow(RATES, 2))
def test_conversions_are_found_and_undone(tmp_path, source, rate):
    """Whatever the phase: the angles are those of their own times, and as uncertain as they say."""
    at = (np.floor(np.arange(400) * source / rate + 0.37)) / source
    table, _ = clip(at, rate)
    angles, summary = measure(tmp_path, table, rate_hz=float(rate))
    timing = summary.timing
    assert timing.converted_from_hz == pytest.approx(source, rel=1.5e-3)
    assert timing.repeated >= RATES[source, rate] and bool(timing.repeated) == (source < rate)
    off, stated = off_and_stated(angles, angles_at(angles["t"].to_numpy() * 0.6))
    ratio = rms(stated) / rms(off)
    print(rms(off), ratio, summary.usable_share, summary.warnings)
    assert (np.median(np.abs(off), axis=0) < 0.3).all() and ((ratio > 1 / 1.5) & (ratio < 1.5)).all(), ratio
    assert summary.usable_share > 0.8
    assert any(f"motion is that of {source:.5g}" in text for text in summary.warnings)
    assert "put back to those of" in " ".join(_heading(summary).split())


@pytest.mark.parametrize("rate", [24, 25, 30, 60])
def test_no_conversion_is_seen_in_fast_sound_clips(tmp_path, rate):
    table, _ = clip(np.arange(400) / rate, rate, 2, slower=0.8)
    table.to_csv(tmp_path / "markers.csv", index=False)
    assert read_markers(tmp_path / "markers.csv").timing.converted_from_hz is None


def rolled(rate, row_s, launch=0, count=300, noise=0.05):
    """markers.csv of frames whose rows are read one after another, and the angles (n, 2) at the first row's times."""
    even = np.arange(count) / rate
    places = []
    for k in (1, 2):  # joint, tip: each at the time of its own row
        at = even.copy()
        for _ in range(30):
            y = np.concatenate((angles_at(at * 0.6, launch), np.zeros((count, 2))), axis=1)
            place = markers(y, rate, noise=0.0)[list(MARKERS)].to_numpy().reshape(-1, 3, 2)[:, k]
            at = even + row_s * place[:, 1]
        places.append(place)
    table = markers(y, rate, noise=0.0)
    table[list(MARKERS[2:])] = np.concatenate(places, axis=1)
    table[list(MARKERS)] += noise * np.random.default_rng(0).normal(size=(count, 6))
    return table, angles_at(even * 0.6, launch)


@pytest.mark.parametrize(
    ("rate", "row_s"), others_slow([(60, 31e-6), (60, -25e-6), (30, 60e-6), (120, 15e-6), (240, 8e-6), (30, 20e-6)], 2)
)
def test_a_rolling_shutter_is_found_and_undone(tmp_path, rate, row_s):
    table, true = rolled(rate, row_s)
    angles, summary = measure(tmp_path, table)
    assert summary.rolling_row_us == pytest.approx(1e6 * row_s, rel=0.05)
    good = angles["quality"] == 1
    off = np.rad2deg(np.angle(np.exp(1j * (angles[ANGLES].to_numpy() - true))))[good]
    stated = np.rad2deg(angles[["theta1_std", "theta2_std"]].to_numpy())[good]
    print(rms(off), rms(stated) / rms(off))
    assert good.mean() > 0.9 and ((rms(stated) / rms(off) > 1 / 1.5) & (rms(stated) / rms(off) < 1.5)).all()
    assert sum("the shutter rolls" in text for text in summary.warnings) == 1


def test_a_shutter_that_cannot_be_undone_is_told(tmp_path, monkeypatch):
    table, true = rolled(60, 31e-6)
    monkeypatch.setattr(rolling, "_without", lambda *_: None)  # as where a marker's own times do not grow
    angles, summary = measure(tmp_path, table)
    assert any("to be undone: the uncertainties were widened" in text for text in summary.warnings)
    off, stated = off_and_stated(angles, true)
    ratio = rms(stated) / rms(off)
    assert ((ratio > 1 / 2) & (ratio < 2)).all(), ratio


@pytest.mark.parametrize(("rate", "launch"), [(30, 0), (60, 1), (400, 2)])
def test_no_shutter_rolls_in_sound_clips(tmp_path, rate, launch):
    clip(np.arange(400) / rate, rate, launch)[0].to_csv(tmp_path / "markers.csv", index=False)
    seen = read_markers(tmp_path / "markers.csv")
    assert undo_rolling(seen, np.ones(len(seen), bool)) == (seen, None)

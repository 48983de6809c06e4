"""A recording's page, and what flags and warnings it and the tables behind it show."""

import json

import numpy as np
import pandas as pd
import pytest
from pendulum_motion import CONSTANTS, markers, truth

from expertaug import plotting
from expertaug.config import recording_settings
from expertaug.config.models import Configuration
from expertaug.errors import InputError
from expertaug_recordings.angles.measure import run_stage as measure_angles
from expertaug_recordings.angles.pendulum_fit import find_gravity
from expertaug_recordings.angles.quality import NO_PIVOT
from expertaug_recordings.angles.summary import RecordingSummary
from expertaug_recordings.chunks import split_chunks
from expertaug_recordings.reports.page import _heading, plot_refused
from expertaug_recordings.reports.page import run_stage as plot_recording
from expertaug_recordings.settings import MeasureAnglesJob, RecordingKeys, SplitChunksJob
from nightly import others_slow

FLAGS = {  # reason of the tracker → frames and what it says of them
    "lost:blue": (1000, 1040),
    "lost:red+green+blue": (1500, 1530),
    "arm_length": (2000, 2030),
    "residual": (2500, 2504),
    "edge": (3000, 3040),
}


@pytest.fixture(scope="module")
def flagged(tmp_path_factory):
    """Folder of a recording in which the tracker has flagged stretches, whose positions are wild."""
    folder = tmp_path_factory.mktemp("page") / "r0"
    folder.mkdir()
    table = markers(truth()[0, :6000])
    for reason, (start, stop) in FLAGS.items():
        rows = slice(start, stop - 1)
        table.loc[rows, ["quality", "reason"]] = (0.4 if reason == "edge" else 0.0), reason
        wild = np.nan if reason.startswith("lost") else table.loc[rows, ["tip_x", "tip_y"]] + 3.0
        table.loc[rows, ["tip_x", "tip_y"]] = wild
    table.loc[3500:3549, ["pivot_x", "pivot_y"]] = np.nan
    table.loc[3500:3549, ["quality", "reason"]] = 0.0, "lost:red"
    table.to_csv(folder / "markers.csv", index=False)
    measure_angles(
        folder / "markers.csv",
        folder / "angles.csv",
        folder / "angles.json",
        MeasureAnglesJob(rate_provenance="a label"),
    )
    return folder


def test_no_flagged_frame_is_measured_and_each_reason_is_counted(flagged):
    angles = pd.read_csv(flagged / "angles.csv", keep_default_na=False)
    summary = json.loads((flagged / "angles.json").read_text())
    for reason, (start, stop) in FLAGS.items():
        assert (angles["quality"][start:stop].astype(float) < 1).all(), reason
        assert (angles["reason"][start:stop] != "").all(), reason
        if stop - start > 8:
            assert (angles["reason"][start:stop] == reason).all()
            assert summary["reasons"][reason] == stop - start
    assert summary["reasons"]["interpolated"] == 4  # the short stretch
    assert summary["reasons"][NO_PIVOT] == 50 and (angles["reason"][3500:3550] == NO_PIVOT).all()


def test_no_chunk_spans_a_flagged_frame(flagged, tmp_path):
    split_chunks([flagged / "angles.csv"], tmp_path / "data", SplitChunksJob(by="time", stride=1, min_chunks=1))
    first = pd.read_csv(tmp_path / "data" / "chunks.csv")["first_frame"].to_numpy()
    spans = first[:, None] + np.arange(19 * 4 + 1)
    assert len(first) > 1000
    for start, stop in FLAGS.values():
        assert not ((spans >= start) & (spans < stop)).any()


@pytest.mark.slow
def test_page(flagged, tmp_path):
    files = [flagged / name for name in ("markers.csv", "angles.csv", "angles.json")]
    plot_recording(*files, tmp_path / "page.png")
    plot_recording(*files, tmp_path / "again.png")
    plot_recording(*files, tmp_path / "page.pdf")
    assert (tmp_path / "page.png").stat().st_size > 50_000 and (tmp_path / "page.pdf").stat().st_size > 10_000
    assert (tmp_path / "page.png").read_bytes() == (tmp_path / "again.png").read_bytes()
    page = plot_refused("r1", "r1.mp4: is empty (0 bytes); copy the recording again")
    plotting.save_all({tmp_path / "refused.png": page})
    assert (tmp_path / "refused.png").stat().st_size > 3000


def test_heading_says_the_rates(flagged):
    summary = RecordingSummary.load(flagged / "angles.json")
    text = _heading(summary)
    assert "stated 400 Hz (a label); the motion implies 50" in text and "(+25." in text
    assert "the longest of 40 frames" in text
    nothing = {"implied_rate_hz": None, "implied_rotation_deg": None, "gaps": 0}
    text = _heading(summary.model_copy(update=nothing))
    assert "implies none: recordings.arms_m is not known" in text and "no gaps" in text


def test_what_does_not_fit_is_refused(flagged, tmp_path):
    markers_csv, angles, summary = (flagged / name for name in ("markers.csv", "angles.csv", "angles.json"))
    said = json.loads(summary.read_text())
    for change, message in (
        ({"implied_rate_hz": "fast"}, "implied_rate_hz: Input should be a valid number"),
        ({"constants": {"B1": 1.0}}, "constants: Dictionary should have at least 4 items after validation, not 1"),
        ({"constants": None}, "constants: Input should be an object"),
        ({"reasons": {"edge": "many"}}, r"reasons\.edge: Input should be a valid integer"),
        ({"warnings": "none"}, "warnings: Input should be a valid array"),
        ({"rate_hz": 0.0}, "rate_hz: Input should be greater than 0"),
        ({"arm1_px": float("nan")}, "arm1_px: Input should be a finite number"),
    ):
        (tmp_path / "angles.json").write_text(json.dumps(said | change))
        with pytest.raises(InputError, match=rf"angles\.json: {message}; run measure_angles again"):
            plot_recording(markers_csv, angles, tmp_path / "angles.json", tmp_path / "page.png")
    for text in ("", "{", "[" * 100_000, "3", "null"):
        (tmp_path / "angles.json").write_text(text)
        with pytest.raises(InputError, match=r"angles\.json: JSON: .*; run measure_angles again"):
            plot_recording(markers_csv, angles, tmp_path / "angles.json", tmp_path / "page.png")
    pd.read_csv(angles)[:100].to_csv(tmp_path / "angles.csv", index=False)
    with pytest.raises(InputError, match=r"6000 frames, .*angles\.csv has 100"):
        plot_recording(markers_csv, tmp_path / "angles.csv", summary, tmp_path / "page.png")
    with pytest.raises(InputError, match="column theta1 is missing"):
        plot_recording(markers_csv, markers_csv, summary, tmp_path / "page.png")
    assert not (tmp_path / "page.png").exists()


def test_what_the_project_rendered_itself_raises_no_alarm(tmp_path):
    """It moves by the real recordings' constants in their nominal time, which a real pendulum would contradict."""
    (tmp_path / "r0").mkdir()
    files = [tmp_path / "r0" / name for name in ("markers.csv", "angles.csv", "angles.json")]
    markers(truth()[0, :2000]).to_csv(files[0], index=False)
    job = recording_settings.measure_angles(Configuration.model_construct(recordings=RecordingKeys()))
    for provenance, warnings in ((job.rate_provenance, 0), ("a label", 1)):
        measure_angles(*files, job.model_copy(update={"rate_provenance": provenance}))
        found = RecordingSummary.load(files[2])
        assert found.implied_rate_hz == pytest.approx(500, rel=0.01) and len(found.warnings) == warnings


@pytest.mark.slow
@pytest.mark.parametrize("tilt", others_slow([10.0, -20.0, 0.0]))
def test_the_direction_of_gravity_is_stated_and_implied(tmp_path, tilt):
    y = truth()[0, :6000]
    folder = tmp_path / "r0"
    folder.mkdir()
    markers(y + np.deg2rad([tilt, tilt, 0, 0])).to_csv(folder / "markers.csv", index=False)
    files = [folder / name for name in ("markers.csv", "angles.csv", "angles.json")]
    for stated in (tilt, 0.0):
        measure_angles(*files, MeasureAnglesJob(arm1_m=None, rotation_deg=stated))
        summary = json.loads(files[2].read_text())
        assert summary["implied_rotation_deg"] == pytest.approx(tilt, abs=0.2)
        assert summary["implied_rate_hz"] is None
        warned = [w for w in summary["warnings"] if "gravity points" in w]
        assert len(warned) == len(summary["warnings"]) == (stated != tilt)
        if stated == tilt:
            angles = pd.read_csv(files[1])
            good = angles["quality"] == 1
            off = angles.loc[good, ["theta1", "theta2"]].to_numpy() - y[good, :2]
            assert np.abs(np.angle(np.exp(1j * off))).max() < 0.005
            assert summary["constants"]["G1"] == pytest.approx(CONSTANTS.G1, rel=0.02)


def test_motion_that_tells_no_direction():
    assert find_gravity(np.full((1000, 4), np.nan), 0.01, 4) is None

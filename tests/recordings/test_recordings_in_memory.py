"""What stages of recordings do is a call in memory: frames, markers and angles in, tables and images out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from angle_files import summary
from drawn import ARMS, PAINT, PIVOT, RATE, SIZE, draw, markers_of, swinging
from pendulum_motion import CONSTANTS, truth

from expertaug.errors import InputError
from expertaug.systems.double_pendulum import energy
from expertaug_recordings.chunks import Recording, split_recordings
from expertaug_recordings.ibm import convert_markers, parse_markers
from expertaug_recordings.markers.appearance import ROLES
from expertaug_recordings.rendering.render import render_recording
from expertaug_recordings.reports.exports import export_recording
from expertaug_recordings.reports.overlay import Painter, overlay, read_measured, schedule
from expertaug_recordings.reports.review import (
    ReviewedRecording,
    corrections_of,
    draw_sheet,
    draw_tile,
    look_for_worst,
    review_page,
)
from expertaug_recordings.settings import ImportMarkersJob, OverlayJob, RenderVideoJob, SplitChunksJob
from expertaug_recordings.tables import PLACES
from expertaug_recordings.video.frame_store import frames_apart, refuse_slow

COUNT = 60


@pytest.fixture(autouse=True)
def no_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    yield
    assert not list(tmp_path.iterdir())


@pytest.fixture(scope="module")
def clip():
    """Frames, markers and angles of a swing whose tip is lost in frames 20 to 25."""
    y = swinging(COUNT)
    place = markers_of(y[:, :2], PIVOT, ARMS)
    frames = draw(place, SIZE, [PAINT[name] for name in ("red", "green", "blue")])
    quality, reason = np.ones(COUNT), np.full(COUNT, "", object)
    quality[20:25], reason[20:25], place[20:25, 2] = 0, "lost:blue", np.nan
    points = pd.DataFrame({"frame": np.arange(COUNT), "t": np.arange(COUNT) / RATE})
    points = points.assign(**dict(zip(PLACES, place.reshape(COUNT, 6).T, strict=True)), quality=quality)
    states = dict(zip(("theta1", "theta2", "omega1", "omega2"), y.T, strict=True))
    table = points[["frame", "t", "quality"]].assign(**states, reason=reason, source=points["frame"])
    return frames, points, table, summary("swing", COUNT, RATE, ARMS, PIVOT)


def test_a_rendered_recording():
    job = RenderVideoJob(duration_s=0.02, count=1)
    frames, table = list(render_recording(0, job).frames), render_recording(0, job).truth
    assert len(frames) == len(table) == job.frames and frames[0].shape == (480, 480, 3)
    assert table[:, 0] == pytest.approx(np.arange(job.frames) / job.rate_hz)


def test_every_how_many_frames_are_kept():
    assert [frames_apart(rate, 100.0) for rate in (60.0, 199.0, 200.0, 399.96)] == [1, 1, 2, 4]
    assert frames_apart(400.0, None) == 1
    refuse_slow(99.95, False, 100.0)
    refuse_slow(96.0, True, 100.0)
    with pytest.raises(InputError, match="the analysis rate of 100 Hz is above the frame rate of 96 Hz"):
        refuse_slow(96.0, False, 100.0)


def test_markers_of_a_table_of_text():
    job = ImportMarkersJob()
    text = "1201,1221,977,1782,1437,1744\n" * 3
    table = convert_markers(parse_markers(text), job)
    assert table.loc[2, ["pivot_x", "pivot_y"]].tolist() == pytest.approx(
        [(1221 - job.offset) / job.scale, (1201 - job.offset) / job.scale]
    )
    assert table["t"].tolist() == pytest.approx([0, 1 / job.rate_hz, 2 / job.rate_hz])
    with pytest.raises(InputError, match="markers: row 4, column x_green: 'a' is no number"):
        parse_markers(text + "1,2,3,a,5,6\n")


def test_an_overlay(clip):
    frames, points, table, of_clip = clip
    seen = read_measured(points, table, of_clip)
    shown = schedule(seen, [], OverlayJob(start_s=0.1, speed=1.0, fps=120))
    images = list(overlay(Painter(seen, [], SIZE), shown, enumerate(frames)))
    assert len(images) == len(shown.rows) == (COUNT - 24) / 2 and images[0].shape[2] == 3
    with pytest.raises(InputError, match="they are not of one measurement"):
        read_measured(points[:-1], table, of_clip)


def test_the_worst_frames_and_their_page(clip):
    frames, points, table, of_clip = clip
    worst = look_for_worst(points, table, of_clip)
    lost = next(each for each in worst if each.reason == "lost:blue")
    assert lost.frame == 22
    rows = corrections_of(worst, "swing")
    assert rows["marker"].tolist() == list(ROLES) * len(worst)
    tiles = [draw_tile(frames[each.source], each) for each in worst]
    assert draw_sheet(tiles).shape[1] == 4 * tiles[0].shape[1] and draw_sheet([]).any()
    page = review_page([ReviewedRecording(of_clip, b"jpeg", rows.to_csv(index=False))], [("r<1", "is empty")])
    assert "swing,22,tip" in page and "r&lt;1" in page


def test_tables_for_other_programs(clip):
    _, points, table, _ = clip
    exports = export_recording(points, table)
    assert exports.units["theta1 [deg]"].to_numpy() == pytest.approx(np.rad2deg(table["theta1"]))
    assert exports.tracker.splitlines()[3 + 22].endswith(",,")
    assert (exports.deeplabcut["expertaug", "tip", "likelihood"][20:25] == 0).all()
    with pytest.raises(InputError, match="markers: no frame has a pivot"):
        export_recording(points.assign(pivot_x=np.nan), table)


def test_sets_of_recordings():
    recordings = [
        Recording(Path(f"r{k}/angles.csv"), np.arange(4000), y[:4000], np.ones(4000, bool), 400.0)
        for k, y in enumerate(truth())
    ]
    splits = split_recordings(recordings, SplitChunksJob(stride=20, min_chunks=1))
    assert {name: len(chunks) for name, chunks in splits.sets.items()} == splits.described["chunks"]
    assert splits.chunks.groupby("split").size().to_dict() == splits.described["chunks"]
    first = splits.chunks.iloc[0]
    level = energy(truth()[int(first["recording"][1:]), first["first_frame"]], CONSTANTS)
    assert level == pytest.approx(first["energy"], rel=0.2)

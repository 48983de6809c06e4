"""Markers as laboratories have them: burnt-in marks, off their hinge, lit from one side, a twin on the wall."""

import numpy as np
import pytest
import yaml
from drawn import ARMS, MARKS, PAINT, PIVOT, RATE, SIZE, _disk, compressed, draw, markers_of, swinging, write_video

from expertaug_recordings.inspection.detect import look_for_pendulum
from expertaug_recordings.inspection.inspect import inspect
from expertaug_recordings.markers.disks import fitter
from expertaug_recordings.markers.geometry import Geometry, estimate_geometry, sound
from expertaug_recordings.markers.tracker import STIFFNESS, Tracker, track_frames
from expertaug_recordings.rendering.render import run_stage as render_recording
from expertaug_recordings.settings import AppearanceKeys, RenderVideoJob, TrackMarkersJob
from nightly import others_slow

NAMES = ("red", "green", "blue")
COLOURS = [PAINT[name] for name in NAMES]
LOOK = AppearanceKeys(style="disk", pivot="red", joint="green", tip="blue")
DARK = (35, 32, 30)


@pytest.fixture(scope="module")
def centres():
    return markers_of(swinging(45)[:, :2], PIVOT, ARMS, 10.0)


def tracked(frames, diameter=24.0):
    settings = TrackMarkersJob(markers=LOOK, marker_diameter_px=diameter)
    geometry, found = estimate_geometry(frames[::3], settings)
    return track_frames(frames, geometry, settings), geometry, found


def errors(track, centres):
    good = track.quality > 0
    return np.linalg.norm(track.position - centres, axis=2)[good], good.mean()


@pytest.mark.parametrize("mark", others_slow(list(MARKS)))
def test_what_is_burnt_in_does_no_harm(mark, centres, tmp_path):
    frames = compressed(draw(centres, SIZE, COLOURS, background=DARK, mark=mark), tmp_path / "clip.mp4", RATE)
    error, used = errors(tracked(frames)[0], centres)
    assert used > 0.95 and np.median(error) < 0.08 and error.max() < 0.4


@pytest.mark.parametrize(("where", "thick"), others_slow([(0.55, 0.1), (0.55, 0.2), (0.75, 0.1)]))
def test_a_ring_that_covers_much_of_a_small_disk_does_no_harm(where, thick, centres, tmp_path, monkeypatch):
    """The disk's colour is that of its coloured parts, few as they are; its rim falls from that.  The third ring leaves
    a rim of 1.5 px and an inner disk with an edge as sharp."""
    ring = (lambda a, b, r: np.abs(np.hypot(a, b) - where * r) < thick * r, (20, 20, 20))
    monkeypatch.setitem(MARKS, "half", ring)
    frames = compressed(draw(centres, SIZE, COLOURS, 20.0, background=DARK, mark="half"), tmp_path / "clip.mp4", RATE)
    error, used = errors(tracked(frames, 20.0)[0], centres)
    assert used > 0.9 and np.median(error) < 0.1 and error.max() < 0.5


@pytest.mark.slow
@pytest.mark.parametrize("mark", ["line", "ring"])
def test_large_disks_with_something_burnt_in_are_seen_whole(mark):
    large = markers_of(swinging(120)[::10, :2], (300.0, 280.0), (140.0, 95.0))
    frames = draw(large, (600, 560), COLOURS, 50.0, background=(190, 190, 190), mark=mark)
    found, _ = look_for_pendulum(list(frames))
    assert found is not None
    for spots in found.spots:
        assert np.median([spot.diameter for spot in spots.values()]) == pytest.approx(50, abs=1)


@pytest.mark.parametrize("mark", ["", "dot"])
def test_a_disk_that_was_expected_elsewhere_is_measured_where_it_is_or_not_at_all(mark):
    """Between frames that are far apart and unevenly timed a marker is off its predicted place by a third of itself."""
    place = np.array([150.3, 140.8])
    blue = [PAINT["blue"], None, None]
    (frame,) = draw(np.tile(place, (1, 3, 1)), (300, 300), blue, 60.0, background=DARK, mark=mark)
    settings = TrackMarkersJob(markers=LOOK, marker_diameter_px=60.0)
    finder = fitter(60.0, settings.min_level, settings.rim_tolerance, settings.appearance, STIFFNESS)
    found = 0
    for angle in np.arange(0, 2 * np.pi, 0.3):
        for far in (6.0, 12.0, 16.0, 20.0, 24.0):
            disks = finder.fit(frame, (place + far * np.array([np.cos(angle), np.sin(angle)]))[None])
            if sound(disks, settings)[0] and disks.identity[0] == 2:
                found += 1
                assert np.linalg.norm(disks.centre[0] - place) < 0.1, (angle, far)
            assert far > 16 or disks.identity[0] == 2, (angle, far)
    assert found > 60


@pytest.mark.parametrize(
    ("behind", "mark", "most"), others_slow([(DARK, "", 0.1), ((60, 58, 55), "", 0.15), ((60, 58, 55), "ring", 0.15)])
)
def test_light_from_one_side_does_not_shift_the_centre(behind, mark, most, centres, tmp_path):
    """Also where the wall is as bright as the disks' dark sides, which differ from it by their colour alone."""
    frames = draw(centres, SIZE, COLOURS, background=behind, light=0.4, mark=mark)
    track, *_ = tracked(compressed(frames, tmp_path / "clip.mp4", RATE))
    error, used = errors(track, centres)
    assert used > 0.95 and np.median(error) < 1.2 * most
    assert np.abs(np.mean(track.position - centres, axis=(0, 1))).max() < most


@pytest.mark.slow
def test_a_joint_off_its_hinge_costs_no_frame(centres):
    theta = swinging(45)[:, 0] + np.deg2rad(10.0)
    off = centres.copy()
    off[:, 1] += 6.0 * np.stack([np.sin(theta), np.cos(theta)], axis=1)
    frames = draw(off, SIZE, COLOURS, background=DARK)
    track, geometry, _ = tracked(frames)
    assert set(track.reason) == {""} and geometry.spread[1] > 1.0
    assert np.linalg.norm(track.position - off, axis=2).max() < 0.4
    found, _ = look_for_pendulum(list(frames[::4]))
    assert found is not None


@pytest.mark.slow
@pytest.mark.parametrize("k", [0, 1, 2])
def test_a_twin_at_rest_is_not_taken_for_a_marker(k, centres):
    frames = draw(centres, SIZE, COLOURS, background=DARK)
    for frame in frames:
        _disk(frame, np.array([560.0, 280.0]), 12.0, COLOURS[k], "disk", 0.0)
    track, geometry, _ = tracked(frames)
    assert geometry.twins[k] == (pytest.approx((560, 280), abs=0.5),)
    error, used = errors(track, centres)
    assert used > 0.97 and error.max() < 0.4
    found, _ = look_for_pendulum(list(frames[::4]))
    for role, spots in enumerate(found.spots):
        seen = np.array([spot.centre for spot in spots.values()])
        true = np.array([centres[4 * number, role] for number in spots])
        assert np.abs(seen - true).max() < 1


@pytest.mark.slow
def test_gravity_is_told_by_the_motion_not_by_where_the_joint_hangs(tmp_path):
    """The first rendered recording goes over the top: its joint is above the pivot on average."""
    render_recording(0, tmp_path / "clip.mp4", tmp_path / "truth.csv", RenderVideoJob(rate_hz=100.0, duration_s=3.0))
    proposed = yaml.safe_load(inspect(tmp_path / "clip.mp4", tmp_path / "contact.png"))
    assert proposed["recordings"]["angles"]["rotation_deg"] == pytest.approx(0, abs=0.5)


@pytest.mark.slow
def test_where_the_motion_does_not_tell_gravity_no_direction_is_written(tmp_path):
    turning = np.linspace(0, 4, 80)  # both arms turn evenly, as if nothing pulled
    frames = draw(markers_of(np.stack((turning, 2 * turning), axis=1), PIVOT, ARMS), SIZE, COLOURS)
    text = inspect(write_video(frames, tmp_path / "clip.mp4", 100), tmp_path / "contact.png")
    assert "angles" not in yaml.safe_load(text)["recordings"]
    assert "rotation_deg: where gravity points in the image: the motion does not tell it, and 0 is taken" in text


def test_a_lost_pivot_does_not_excuse_a_covered_tip():
    """The frame is used where the pivot alone is lost: the others must be sound."""
    settings = TrackMarkersJob()
    tracker = Tracker(Geometry(90.0, 60.0, 25.0), settings)
    frame, centre = np.zeros((480, 480, 3), np.uint8), np.array([[np.nan, np.nan], [240.0, 240.0], [240.0, 300.0]])
    share = np.array([0.0, 1.0, 1.0])
    assert tracker._judge(frame, centre, share, np.zeros(3)) == (0.0, "lost:red")
    assert tracker._judge(frame, centre, share, np.array([0.0, 0.0, 2.0])) == (0.0, "residual")

"""Tracking of pendulums in other looks: disks, other colours, wide and off-centre images, unmarked pivots, tilted
cameras; after H.264."""

import csv
import struct

import cv2
import numpy as np
import pytest
from drawn import ARMS, PAINT, PIVOT, RATE, SIZE, compressed, draw, markers_of, swinging, wall, write_video

from expertaug.errors import InputError
from expertaug_recordings.markers.geometry import estimate_geometry, measure_diameter
from expertaug_recordings.markers.track import run_stage as track_markers
from expertaug_recordings.markers.tracker import track_frames
from expertaug_recordings.settings import AppearanceKeys, ExtractFramesJob, TrackMarkersJob
from expertaug_recordings.video.frame_store import FrameStore, writing
from expertaug_recordings.video.frame_store import run_stage as extract_frames
from expertaug_recordings.video.pixel_layout import Layout
from nightly import others_slow

TILT = 10.0
FRAMES = 60
LOOKS = {
    "disks on a dark wall": ("disk", ("red", "green", "blue"), (35, 32, 30), True),
    "disks on a light wall": ("disk", ("orange", "green", "purple"), (205, 208, 212), True),
    "disks before two walls": ("disk", ("red", "green", "blue"), None, True),
    "unmarked pivot": ("disk", ("red", "magenta", "cyan"), (35, 32, 30), False),
    "other quadrants": ("quadrant", ("yellow", "magenta", "cyan"), (4, 4, 4), True),
}


def settings_of(style, names, marked, diameter=24.0):
    markers = AppearanceKeys(style=style, pivot=names[0] if marked else None, joint=names[1], tip=names[2])
    return TrackMarkersJob(markers=markers, marker_diameter_px=diameter)


@pytest.fixture(scope="module")
def states():
    return swinging(40 + FRAMES)[40:]  # in which the tip goes from one wall to the other


@pytest.fixture(scope="module", params=others_slow(list(LOOKS), 2))
def clip(request, states, tmp_path_factory):
    """Frames, the true positions and the tracker's settings."""
    style, names, background, marked = LOOKS[request.param]
    centres = markers_of(states[:, :2], PIVOT, ARMS, TILT)
    colours = [PAINT[name] if marked or k else None for k, name in enumerate(names)]
    frames = draw(centres, SIZE, colours, style=style, background=wall() if background is None else background)
    path = tmp_path_factory.mktemp("clip") / "clip.mp4"
    return compressed(frames, path, RATE), centres, settings_of(style, names, marked)


def test_angles_are_those_of_the_truth(clip, states):
    frames, centres, settings = clip
    geometry, found = estimate_geometry(frames[::4], settings)
    assert found["all"] > 0.9 * found["frames"]
    track = track_frames(frames, geometry, settings)
    good = track.quality > 0
    assert good.mean() > 0.95
    error = np.linalg.norm(track.position - centres, axis=2)[good]
    assert np.median(error) < 0.15 and error.max() < 1.2
    vector = np.diff(track.position[good], axis=1)
    theta = np.arctan2(vector[..., 0], vector[..., 1]) - np.deg2rad(TILT)
    off = np.rad2deg(np.abs(np.angle(np.exp(1j * (theta - states[good, :2])))))
    assert (np.median(off, axis=0) < 0.15).all() and (np.percentile(off, 99, axis=0) < 0.9).all()
    assert geometry.arm1 == pytest.approx(ARMS[0], abs=0.3) and geometry.arm2 == pytest.approx(ARMS[1], abs=0.3)
    assert geometry.diameter == pytest.approx(24, abs=0.6)


def test_an_unknown_diameter_is_measured(clip):
    frames, _, settings = clip
    found = measure_diameter(frames[::30], TrackMarkersJob(markers=settings.markers, marker_diameter_px=None))
    assert found == pytest.approx(24, abs=1)


def test_large_disks():
    centres = markers_of(swinging(25)[:, :2], (470.0, 420.0), (260.0, 170.0))
    frames = draw(centres, (960, 840), [PAINT[n] for n in ("red", "green", "blue")], diameter=70.0)
    settings = settings_of("disk", ("red", "green", "blue"), True, diameter=70.0)
    geometry, _ = estimate_geometry(frames[::4], settings)
    track = track_frames(frames, geometry, settings)
    assert set(track.reason) <= {"", "edge"}
    assert np.linalg.norm(track.position - centres, axis=2).max() < 0.5


def test_a_partly_covered_disk_is_right_or_unusable(states):
    centres = markers_of(states[:30, :2], PIVOT, ARMS)
    frames = draw(centres, SIZE, [PAINT[n] for n in ("red", "green", "blue")])
    settings = settings_of("disk", ("red", "green", "blue"), True)
    geometry, _ = estimate_geometry(frames, settings)
    for share in (0.2, 0.5):
        spoiled = frames.copy()
        for frame, (x, y) in zip(spoiled, centres[:, 2].round().astype(int), strict=True):
            cv2.rectangle(frame, (x - 13, y - 14), (x - 13 + round(26 * share), y + 14), (90, 110, 120), -1)
        track = track_frames(spoiled, geometry, settings)
        good = track.quality > 0
        assert np.linalg.norm(track.position - centres, axis=2)[good].max(initial=0) < 0.8
        assert share < 0.5 or not good.any()


def test_an_unmarked_pivot_is_found_or_given(states, tmp_path):
    centres = markers_of(states[:, :2], PIVOT, ARMS)
    frames = draw(centres, SIZE, [None, PAINT["magenta"], PAINT["cyan"]])
    store = tmp_path / "frames.b2"
    with writing(store, Layout("bgr24", *SIZE), RATE, {}) as writer:
        for frame in frames:
            writer.append(frame)
    for given in (None, (390.0, 165.0)):
        look = AppearanceKeys(style="disk", pivot=None, joint="magenta", tip="cyan", pivot_px=given)
        track_markers(store, tmp_path / "markers.csv", TrackMarkersJob(markers=look, marker_diameter_px=24.0))
        with (tmp_path / "markers.csv").open(newline="") as stream:
            rows = list(csv.DictReader(stream))
        pivot = np.array([[float(row["pivot_x"]), float(row["pivot_y"])] for row in rows])
        assert np.ptp(pivot, axis=0).max() == 0
        assert pivot[0] == pytest.approx(given or PIVOT, abs=0.1)
    yellow = settings_of("disk", (None, "yellow", "cyan"), False)
    with pytest.raises(
        InputError, match=r"0 show both \(yellow in 0, cyan in 60\); show yellow and cyan disks of 24 px"
    ):
        track_markers(store, tmp_path / "none.csv", yellow)


def test_an_unknown_diameter_of_nothing_is_refused(tmp_path):
    store = tmp_path / "frames.b2"
    with writing(store, Layout("bgr24", 160, 120), 100.0, {}) as writer:
        for _ in range(12):
            writer.append(np.zeros((120, 160, 3), np.uint8))
    with pytest.raises(
        InputError, match=r"of 12 frames looked at, none shows a marker; show red, green and blue quadrant"
    ):
        track_markers(store, tmp_path / "markers.csv", TrackMarkersJob(marker_diameter_px=None))


def test_the_turn_that_a_phone_writes_into_its_file_is_obeyed(states, tmp_path):
    """Portrait videos are stored on their side, with the turn in the header (tkhd)."""
    centres = markers_of(states[:20, :2], (180.3, 300.6), ARMS)
    frames = draw(centres, (360, 640), [PAINT[n] for n in ("red", "green", "blue")])
    lying = np.stack([cv2.rotate(frame, cv2.ROTATE_90_COUNTERCLOCKWISE) for frame in frames])
    data = bytearray(write_video(lying, tmp_path / "plain.mp4", RATE).read_bytes())
    matrix = data.find(b"tkhd") + 44
    data[matrix : matrix + 36] = struct.pack(">9i", 0, 1 << 16, 0, -(1 << 16), 0, 0, 0, 0, 1 << 30)
    (tmp_path / "phone.mp4").write_bytes(data)
    extract_frames(tmp_path / "phone.mp4", tmp_path / "frames.b2", ExtractFramesJob())
    store = FrameStore(tmp_path / "frames.b2")
    assert store.shape == (20, 640, 360, 3)
    settings = settings_of("disk", ("red", "green", "blue"), True)
    geometry, _ = estimate_geometry(list(store), settings)
    track = track_frames(list(store), geometry, settings)
    assert np.linalg.norm(track.position - centres, axis=2).max() < 0.5

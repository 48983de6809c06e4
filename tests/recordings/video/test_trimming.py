"""Parts of recordings: spans of time that are used, and parts of the image that are not looked at."""

import av
import cv2
import numpy as np
import pytest
from containers import drawn, remux
from drawn import ARMS, PAINT, PIVOT, RATE, SIZE, draw, markers_of, swinging, write_video

from expertaug.errors import InputError
from expertaug_recordings.markers.track import MaskedFrames
from expertaug_recordings.markers.track import run_stage as track_markers
from expertaug_recordings.settings import AppearanceKeys, ExtractFramesJob, StatedTimes, TrackMarkersJob
from expertaug_recordings.video.frame_store import FrameStore
from expertaug_recordings.video.frame_store import run_stage as extract_frames
from expertaug_recordings.video.source import open_frames
from expertaug_recordings.video.writer import encode

FRAMES, SIDE = 60, 64


@pytest.fixture(scope="module")
def numbered(tmp_path_factory):
    """A clip at 30 Hz whose frames are as bright as their numbers say, with B frames."""
    path = tmp_path_factory.mktemp("clip") / "clip.mp4"
    with av.open(str(path), "w") as made:
        stream = made.add_stream("libx264", rate=30, options={"g": "25", "bf": "2", "crf": "5"})
        stream.width, stream.height, stream.pix_fmt = SIDE, SIDE, "yuv420p"
        for k in range(FRAMES):
            image = av.VideoFrame.from_ndarray(np.full((SIDE, SIDE, 3), 4 * k, np.uint8), format="bgr24")
            made.mux(stream.encode(image.reformat(format="yuv420p")))
        made.mux(stream.encode())
    return path


def number_of(image):
    return int((image.mean() + 3.9) / 4)  # compressed, it is up to 3.7 darker


def numbers(path, step=1, **span):
    with open_frames(path, StatedTimes(**span)) as frames:
        read = [(index, number_of(image)) for index, image in frames.frames(step)]
        return read, frames


def test_a_span_of_time_is_used(numbered):
    read, frames = numbers(numbered, from_s=0.5, to_s=1.0)
    assert read == [(k, 15 + k) for k in range(16)] and frames.count == 16 and frames.times is None
    assert numbers(numbered, 5, from_s=0.5, to_s=1.0)[0] == [(0, 15), (5, 20), (10, 25), (15, 30)]
    assert numbers(numbered, from_s=1.9)[0] == [(0, 57), (1, 58), (2, 59)]


def test_what_comes_after_is_not_read(tmp_path):
    broken = tmp_path / "broken.mp4"
    encode(broken, drawn(FRAMES), SIDE, 30)
    data = broken.read_bytes()
    spoiled = len(data) * 3 // 4
    broken.write_bytes(data[:spoiled] + bytes(40_000) + data[spoiled + 40_000 :])
    with pytest.raises(InputError):
        numbers(broken)
    assert len(numbers(broken, to_s=0.6)[0]) == 19


def test_a_span_of_slow_motion_is_in_the_player_s_time(numbered):
    read, frames = numbers(numbered, from_s=0.5, to_s=1.0, rate_hz=240.0)
    assert len(read) == 16 and frames.rate_hz == 240


def test_a_span_of_a_variable_rate_has_its_own_times(numbered, tmp_path):
    uneven = remux(numbered, tmp_path / "uneven.mp4", pts=lambda t: t + max(t, 0) ** 2 // 60_000)
    whole = numbers(uneven)[1].times
    read, frames = numbers(uneven, from_s=float(whole[20]), to_s=float(whole[40]))
    assert [number for _, number in read] == list(range(20, 41))
    np.testing.assert_allclose(frames.times, whole[20:41] - whole[20], atol=1e-9)


def test_a_span_of_pictures(tmp_path):
    for k in range(10):
        cv2.imwrite(str(tmp_path / f"{k}.png"), np.full((SIDE, SIDE, 3), 4 * k, np.uint8))
    assert numbers(tmp_path, rate_hz=10.0, from_s=0.3, to_s=0.5)[0] == [(0, 3), (1, 4), (2, 5)]
    read, frames = numbers(tmp_path, times="names", from_s=2, to_s=4)
    assert [n for _, n in read] == [2, 3, 4] and frames.count == 3


@pytest.mark.parametrize("span", [{"from_s": 5.0}, {"from_s": 1.0, "to_s": 0.5}, {"to_s": 0.01}])
def test_a_span_without_frames_is_refused(numbered, span):
    with pytest.raises(InputError, match=r"clip.mp4: from .* s there are [01] frames; it lasts 1.97 s: set recordings"):
        open_frames(numbered, StatedTimes(**span))


def test_extraction_keeps_the_span(numbered, tmp_path):
    extract_frames(numbered, tmp_path / "s.b2frame", ExtractFramesJob(from_s=0.5, to_s=1.0))
    store = FrameStore(tmp_path / "s.b2frame")
    assert len(store) == 16 and store.t[-1] == pytest.approx(0.5) and number_of(store[0]) == 15


@pytest.mark.slow
def test_nothing_is_found_in_a_mask(tmp_path):
    """A hand with a green disk in it moves beside the pendulum: in a mask it costs no frame."""
    theta = swinging(240, (1.2, 0.5, 0.0, 0.0))[:, :2]
    centres = markers_of(theta, PIVOT, ARMS)
    other = np.stack([80 + 60 * np.sin(np.arange(len(theta)) / 9), 60 + 40 * np.cos(np.arange(len(theta)) / 7)], axis=1)
    frames = draw(centres, SIZE, [PAINT[n] for n in ("red", "green", "blue")])
    for frame, (x, y) in zip(frames, other, strict=True):
        cv2.circle(frame, (round(x), round(y)), 40, (150, 180, 220), -1, cv2.LINE_AA)
        cv2.circle(frame, (round(x), round(y)), 12, PAINT["green"], -1, cv2.LINE_AA)
    extract_frames(write_video(frames, tmp_path / "clip.mp4", RATE), tmp_path / "s.b2frame", ExtractFramesJob())
    look = AppearanceKeys(style="disk")

    def off(mask):
        job = TrackMarkersJob(markers=look, masks=[mask], marker_diameter_px=24, max_lost_share=1.0)
        track = track_markers(tmp_path / "s.b2frame", tmp_path / "m.csv", job)
        return np.linalg.norm(track.position - centres, axis=2), track.quality

    for mask in ([[0, 0], [200, 200]], [[0, 0], [200, 0], [200, 200], [0, 200]]):
        seen, plain = MaskedFrames(FrameStore(tmp_path / "s.b2frame"), [mask])[3], FrameStore(tmp_path / "s.b2frame")[3]
        assert seen[:200, :200].max() == 0 and (seen[202:] == plain[202:]).all() and plain[:200, :200].max() > 100
        error, quality = off(mask)
        assert np.nanmax(error) < 1 and (quality > 0).all()
    with pytest.raises(InputError, match=r"red in 0, green in \d+"):
        off([[380, 150], [400, 180]])  # over the pivot

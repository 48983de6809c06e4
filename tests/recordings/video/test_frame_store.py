import json
import tracemalloc

import cv2
import numpy as np
import pytest

from expertaug.errors import InputError
from expertaug_recordings.rendering.render import run_stage as render_recording
from expertaug_recordings.settings import ExtractFramesJob, RenderVideoJob
from expertaug_recordings.video.frame_store import FrameStore, writing
from expertaug_recordings.video.frame_store import run_stage as extract_frames
from expertaug_recordings.video.pixel_layout import Layout

FRAMES = 50


@pytest.fixture(scope="module")
def video(tmp_path_factory):
    folder = tmp_path_factory.mktemp("videos")
    render_recording(0, folder / "video.mp4", folder / "truth.csv", RenderVideoJob(duration_s=FRAMES / 400))
    return folder / "video.mp4"


@pytest.fixture(scope="module")
def decoded(video):
    capture = cv2.VideoCapture(str(video))
    return np.stack([capture.read()[1] for _ in range(FRAMES)])


@pytest.fixture(scope="module")
def store(video, tmp_path_factory):
    path = tmp_path_factory.mktemp("stores") / "frames.b2frame"
    extract_frames(video, path, ExtractFramesJob())
    return path


def test_frames_are_those_of_the_decoder(store, decoded):
    frames = FrameStore(store)
    assert len(frames) == FRAMES
    np.testing.assert_array_equal(frames.read(0, FRAMES), decoded)
    np.testing.assert_array_equal(np.stack(list(frames)), decoded)


def test_seeking(store, decoded):
    frames = FrameStore(store)
    for index in (37, 0, 7, 8, FRAMES - 1, -1, -FRAMES):
        np.testing.assert_array_equal(frames[index], decoded[index])
    np.testing.assert_array_equal(frames.read(5, 19), decoded[5:19])
    assert frames.read(48, 99).shape == (2, 480, 480, 3)
    assert frames.read(20, 10).shape == (0, 480, 480, 3)
    for index in (FRAMES, -FRAMES - 1):
        with pytest.raises(IndexError):
            frames[index]


def test_times_and_source(store):
    frames = FrameStore(store)
    assert frames.rate_hz == 400
    np.testing.assert_allclose(frames.t, np.arange(FRAMES) / 400)
    assert frames.source["rate_provenance"] == "video metadata"
    assert json.dumps(frames.source)


def test_analysis_rate_keeps_every_fourth_frame(video, decoded, tmp_path):
    extract_frames(
        video, tmp_path / "s.b2frame", ExtractFramesJob(analysis_rate_hz=100, image_size_px=480, expected_frames=FRAMES)
    )
    frames = FrameStore(tmp_path / "s.b2frame")
    np.testing.assert_array_equal(frames.read(0, FRAMES), decoded[::4])
    np.testing.assert_allclose(frames.t, np.arange(FRAMES)[::4] / 400)


def test_configured_rate_stretches_time(video, tmp_path):
    extract_frames(
        video, tmp_path / "s.b2frame", ExtractFramesJob(analysis_rate_hz=100, rate_hz=500, rate_provenance="motion")
    )
    frames = FrameStore(tmp_path / "s.b2frame")
    assert (len(frames), frames.rate_hz, frames.source["rate_provenance"]) == (10, 100, "motion")


def test_of_a_rate_that_does_not_divide_the_frames_are_kept_for_resampling(video, decoded, tmp_path):
    extract_frames(video, tmp_path / "s.b2frame", ExtractFramesJob(analysis_rate_hz=150))
    frames = FrameStore(tmp_path / "s.b2frame")
    assert frames.rate_hz == 200
    np.testing.assert_array_equal(frames.read(0, FRAMES), decoded[::2])


def test_the_analysis_rate_is_at_most_the_video_s(video, tmp_path):
    with pytest.raises(InputError, match=r"analysis rate of 800 Hz is above the frame rate of 400 Hz; set .* 400 or"):
        extract_frames(video, tmp_path / "s.b2frame", ExtractFramesJob(analysis_rate_hz=800))
    assert not (tmp_path / "s.b2frame").exists()


def test_bad_video_leaves_nothing(video, tmp_path):
    data = video.read_bytes()
    (tmp_path / "bad.mp4").write_bytes(data[: len(data) // 2] + bytes(1000) + data[len(data) // 2 + 1000 :])
    with pytest.raises(InputError, match=r"bad.mp4: (spoiled|ends)"):
        extract_frames(tmp_path / "bad.mp4", tmp_path / "out" / "s.b2frame", ExtractFramesJob())
    assert not list((tmp_path / "out").iterdir())


def test_output_folder_that_cannot_be_written(video, tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=r"s\.b2frame: cannot be written"):
        extract_frames(video, tmp_path / "file" / "s.b2frame", ExtractFramesJob())


@pytest.mark.parametrize("damage", [lambda d: b"", lambda d: d[: len(d) // 2], lambda d: b"frames" * 99])
def test_damaged_store_is_named(store, tmp_path, damage):
    path = tmp_path / "frames.b2frame"
    path.write_bytes(damage(store.read_bytes()))
    with pytest.raises(InputError, match="not a frame store"):
        FrameStore(path)


def test_a_store_whose_frames_do_not_fit_into_memory_is_refused(store, monkeypatch):
    monkeypatch.setattr("expertaug_recordings.video.frame_store.memory_limit", lambda: 10_000)
    with pytest.raises(InputError, match=r"a piece takes .* GB, and there is memory for 1e-05"):
        FrameStore(store)


def test_missing_store(tmp_path):
    with pytest.raises(InputError, match="no such file; run extract_frames"):
        FrameStore(tmp_path / "frames.b2frame")


def test_interrupted_writer_leaves_nothing(tmp_path):
    with pytest.raises(KeyError), writing(tmp_path / "s.b2frame", Layout("bgr24", 8, 8), 10, {}) as out:
        out.append(np.zeros((8, 8, 3), np.uint8))
        raise KeyError
    assert not any(tmp_path.iterdir())


def test_frame_of_another_size_is_refused(tmp_path):
    with (
        pytest.raises(ValueError, match="expected"),
        writing(tmp_path / "s.b2frame", Layout("bgr24", 8, 8), 10, {}) as out,
    ):
        out.append(np.zeros((9, 8, 3), np.uint8))


def test_reading_on_holds_one_chunk_at_a_time(tmp_path, monkeypatch):
    monkeypatch.setattr("expertaug_recordings.video.frame_store.CHUNK_BYTES", 40 * 64 * 64 * 3)
    layout = Layout("bgr24", 64, 64)
    with writing(tmp_path / "s.b2frame", layout, 10, {}) as out:
        for level in range(160):
            out.append(np.full((64, 64, 3), level, np.uint8))
    frames = FrameStore(tmp_path / "s.b2frame")
    tracemalloc.start()
    try:
        levels = [int(image[0, 0, 0]) for image in frames]
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert levels == list(range(160))
    assert peak < 1.5 * 40 * layout.frame_bytes

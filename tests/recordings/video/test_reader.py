import struct

import av
import numpy as np
import pytest
from containers import drawn, remux

from expertaug.errors import InputError
from expertaug_recordings.rendering.render import run_stage as render_recording
from expertaug_recordings.settings import RenderVideoJob
from expertaug_recordings.video.reader import Video
from expertaug_recordings.video.writer import encode

FRAMES = 60


def read(path, **given):
    with Video(path, **given) as video:
        return [index for index, _ in video.frames()]


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    folder = tmp_path_factory.mktemp("videos")
    render_recording(0, folder / "video.mp4", folder / "truth.csv", RenderVideoJob(duration_s=FRAMES / 400))
    return folder / "video.mp4"


def test_good_file(good):
    with Video(good, image_size_px=480) as video:
        assert (video.count, video.rate_hz, video.width, video.height) == (FRAMES, 400, 480, 480)
        assert video.rate_provenance == "video metadata"
        assert [index for index, _ in video.frames(step=8)] == list(range(0, FRAMES, 8))


def test_matroska_with_its_rounded_timestamps_is_good(good, tmp_path):
    assert len(read(remux(good, tmp_path / "video.mkv"))) == FRAMES


def test_configured_rate_replaces_the_file_s(good):
    with Video(good, rate_hz=500, rate_provenance="motion") as video:
        assert (video.rate_hz, video.rate_provenance) == (500, "motion")
        assert len(list(video.frames())) == FRAMES


def test_nothing_reaches_standard_error(good, tmp_path, capfd):
    broken = tmp_path / "broken.mp4"
    broken.write_bytes(good.read_bytes()[:3000])
    with pytest.raises(InputError):
        Video(broken)
    assert capfd.readouterr().err == ""


def spoil(data, kind):
    if kind == "empty":
        return b""
    if kind == "truncated":
        return data[: len(data) // 2]
    if kind == "text":
        return b"t,theta1\n" * 100
    start = len(data) // 2
    if kind == "zeroed":
        return data[:start] + bytes(2000) + data[start + 2000 :]
    noise = np.random.default_rng(0).integers(0, 256, 600, dtype=np.uint8).tobytes()
    return data[:start] + noise + data[start + 600 :]


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("empty", r"is empty \(0 bytes\)"),
        ("truncated", "cannot be opened as a video; it is truncated or not a video"),
        ("text", "cannot be opened as a video"),
        ("zeroed", "spoiled near frame|ends after"),
        ("garbled", "spoiled near frame|ends after"),
    ],
)
def test_broken_file_is_one_line(good, tmp_path, kind, message):
    path = tmp_path / "recording.mp4"
    path.write_bytes(spoil(good.read_bytes(), kind))
    with pytest.raises(InputError, match=message) as caught:
        read(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("suffix", "codec", "pixels", "message"),
    [
        ("gif", "gif", "rgb8", r"is a GIF: at most 256 colours, .* times in whole 1/100 s; give the video"),
        ("png", "apng", "rgb24", "is a single picture, or several in a row .*; give a video, or a folder of pictures"),
        ("mp4", "gif", "rgb8", "is a GIF"),
    ],
)
def test_a_gif_or_a_picture_is_called_one(tmp_path, suffix, codec, pixels, message):
    path = tmp_path / f"clip.{suffix}"
    with av.open(str(path), "w", format=codec) as made:
        stream = made.add_stream(codec, rate=25)
        stream.width, stream.height, stream.pix_fmt = 64, 64, pixels
        for image in drawn(5):
            made.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="bgr24").reformat(format=pixels)))
        made.mux(stream.encode())
    with pytest.raises(InputError, match=message) as caught:
        Video(path)
    assert "\n" not in str(caught.value)


def test_missing_file(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        Video(tmp_path / "none.mp4")


def test_video_that_stops_early_though_its_metadata_claim_more(tmp_path):
    whole = tmp_path / "whole.mkv"
    encode(whole, drawn(), 64, 100)
    cut = tmp_path / "cut.mkv"
    cut.write_bytes(whole.read_bytes()[: whole.stat().st_size * 2 // 3])
    with pytest.raises(InputError, match=rf"ends after \d+ of {FRAMES} declared frames|spoiled near"):
        read(cut)


def test_unexpected_number_of_frames(good):
    with pytest.raises(InputError, match=f"declares {FRAMES} frames; 61 expected"):
        Video(good, expected_frames=61)


def test_wrong_size(good):
    with pytest.raises(InputError, match=r"images are 480x480 px; 640x480 expected \(image_size_px\)"):
        Video(good, image_size_px=(640, 480))


def test_missing_rate_is_refused_unless_given(good, tmp_path):
    bare = remux(good, tmp_path / "bare.h264", format="h264")
    with pytest.raises(InputError, match=r"no usable frame rate .* set recordings.videos.rate_hz .*--rate"):
        Video(bare)
    with pytest.raises(InputError, match="no frame count in its metadata"):
        Video(bare, rate_hz=400)


def test_absurd_rate_is_refused(good):
    with pytest.raises(InputError, match=r"recordings.videos.rate_hz: is 1e\+09 Hz"):
        Video(good, rate_hz=1e9)


def test_a_variable_rate_is_read_with_its_times(good, tmp_path):
    uneven = remux(good, tmp_path / "uneven.mp4", pts=lambda t: t + max(t, 0) ** 2 // 2000)
    with Video(uneven) as video:
        assert len(list(video.frames())) == FRAMES
        ticks = np.arange(FRAMES) * 32
        np.testing.assert_allclose(video.times, (ticks + ticks**2 // 2000) / 12800, atol=1e-9)
        assert video.rate_hz == pytest.approx(1 / np.median(np.diff(video.times)))
    with Video(uneven, rate_hz=4000) as slow:
        list(slow.frames())
        assert slow.rate_hz == 4000 and np.median(np.diff(slow.times)) == pytest.approx(1 / 4000)


@pytest.mark.parametrize("b_frames", [0, 2])
def test_a_clip_trimmed_by_an_edit_list_is_read_as_players_read_it(tmp_path, b_frames):
    """Packets before the first shown frame serve to decode it; what comes after the last is not shown either."""
    images = [np.full((64, 64, 3), 4 * k, np.uint8) for k in range(FRAMES)]
    path = tmp_path / "clip.mp4"
    with av.open(str(path), "w") as made:
        stream = made.add_stream("libx264", rate=30, options={"g": "25", "bf": str(b_frames), "crf": "10"})
        stream.width, stream.height, stream.pix_fmt = 64, 64, "yuv420p"
        for image in images:
            made.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="bgr24").reformat(format="yuv420p")))
        made.mux(stream.encode())
    with Video(path) as video:
        filmed = [frame for _, frame in video.frames()]
    data = bytearray(path.read_bytes())
    at = data.index(b"elst") + 12
    (start,) = struct.unpack(">i", data[at + 4 : at + 8])
    data[at : at + 8] = struct.pack(">Ii", 500, start + 33 * 512)  # .5 s from frame 33 on
    path.write_bytes(data)
    with Video(path) as video:
        shown = [frame for _, frame in video.frames()]
        assert video.count == len(shown) == 15 and video.times is None and video.rate_hz == pytest.approx(30)
    np.testing.assert_array_equal(shown, filmed[33:48])


def test_rotated_file_is_read_upright(tmp_path):
    """Phones store how they were held as a matrix in the track's header."""
    path, image = tmp_path / "phone.mp4", np.zeros((96, 128, 3), np.uint8)
    image[:20, :40] = 255
    encode(path, (image for _ in range(9)), (128, 96), 100)
    data = bytearray(path.read_bytes())
    at = data.index(b"tkhd") + 44
    data[at : at + 36] = struct.pack(">9i", 0, 1 << 16, 0, -(1 << 16), 0, 0, 96 << 16, 0, 1 << 30)
    path.write_bytes(data)
    with Video(path, image_size_px=(96, 128)) as video:
        upright = next(frame for _, frame in video.frames())
    assert upright.shape == (128, 96, 3)
    assert upright[5, -5, 0] > 200 and upright[5, 5, 0] < 50


def test_a_missing_frame_is_a_gap_in_the_times(good, tmp_path):
    with Video(remux(good, tmp_path / "gap.mp4", pts=lambda t: t + (t >= 30 * 32) * 32), rate_hz=400) as video:
        list(video.frames())
        np.testing.assert_allclose(np.diff(video.times), np.where(np.arange(FRAMES - 1) == 29, 0.005, 0.0025))


def test_playlist_opens_no_other_file(good, tmp_path):
    (tmp_path / "list.mp4").write_text("ffconcat version 1.0\nfile copy.mp4\n")
    (tmp_path / "copy.mp4").write_bytes(good.read_bytes())
    with pytest.raises(InputError, match="cannot be opened as a video"):
        Video(tmp_path / "list.mp4")


def test_vast_and_tiny_images_are_refused(tmp_path, monkeypatch):
    encode(tmp_path / "small.mp4", (np.zeros((12, 64, 3), np.uint8) for _ in range(3)), (64, 12), 100)
    with pytest.raises(InputError, match="declares images of 64x12 px"):
        Video(tmp_path / "small.mp4")
    encode(tmp_path / "large.mp4", drawn(3), 64, 100)
    monkeypatch.setattr("expertaug_recordings.video.reader.MAX_PX", 4000)
    with pytest.raises(InputError, match="declares images of 64x64 px"):
        Video(tmp_path / "large.mp4")


def test_the_same_complaint_counts_for_the_next_file_too(good, tmp_path):
    spoilt = [tmp_path / "one.mp4", tmp_path / "two.mp4"]
    for path in spoilt:
        path.write_bytes(spoil(good.read_bytes(), "garbled"))
    told = []
    for path in spoilt:
        with pytest.raises(InputError) as caught:
            read(path)
        told.append(str(caught.value).removeprefix(str(path)))
    assert told[0] == told[1]


def test_other_users_of_the_log_keep_their_settings(good):
    before = av.logging.get_level(), av.logging.get_skip_repeated()
    read(good)
    assert (av.logging.get_level(), av.logging.get_skip_repeated()) == before

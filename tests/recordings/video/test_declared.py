"""What containers say beside their frames is read as players read it: rate, first time, shape of a pixel, turns."""

import struct
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
import yaml
from drawn import PAINT, draw, markers_of, swinging

from expertaug.errors import InputError
from expertaug_recordings.inspection.inspect import combine, inspect
from expertaug_recordings.inspection.look import Footage, Look
from expertaug_recordings.settings import ExtractFramesJob, StatedTimes
from expertaug_recordings.video import declared
from expertaug_recordings.video.frame_store import FrameStore
from expertaug_recordings.video.frame_store import run_stage as extract_frames
from expertaug_recordings.video.reader import Video

TICKS = 100  # of a frame


def write(path, frames, rate=30, times=None, tags=None, prepare=None, **options):
    """H.264 of frames (n, H, W, 3); times in frames from 0."""
    flags = {"movflags": "use_metadata_tags"} if path.suffix == ".mp4" else {}
    options = {"crf": "10", "preset": "superfast", "g": "12"} | options
    with av.open(str(path), "w", options=flags) as made:
        made.metadata.update(tags or {})
        stream = made.add_stream(
            "libx264", rate=rate, options={"crf": "10", "preset": "superfast", "g": "12"} | options
        )
        stream.height, stream.width, stream.pix_fmt = *np.shape(frames)[1:3], "yuv420p"
        stream.codec_context.thread_count = 1
        stream.codec_context.time_base = Fraction(1, rate * TICKS)
        if prepare:
            prepare(stream)
        for k, image in enumerate(frames):
            frame = av.VideoFrame.from_ndarray(image, format="bgr24").reformat(format="yuv420p")
            frame.pts, frame.time_base = round((k if times is None else times[k]) * TICKS), Fraction(1, rate * TICKS)
            made.mux(stream.encode(frame))
        made.mux(stream.encode())
    return path


def grey(count=40, size=(48, 64)):
    return np.stack([np.full((*size, 3), 5 * k, np.uint8) for k in range(count)])


def read(path, **given):
    with Video(path, **given) as video:
        return np.stack([frame for _, frame in video.frames()]), video


# ── Rates ────────────────────────────────────────────────────────────────────


@pytest.mark.parametrize(
    ("suffix", "tag", "value", "filmed"),
    [
        ("mp4", "com.android.capture.fps", "240.000000", 240),
        ("mkv", "COM.ANDROID.CAPTURE.FPS", "120", 120),
        ("mp4", "com.arri.camera.SensorFps", "60000/1001 fps", 59.94),
        ("mp4", "com.android.capture.fps", "2.0", 2),  # a time lapse
    ],
)
def test_a_tag_of_another_rate_asks_for_the_key(tmp_path, suffix, tag, value, filmed):
    path = write(tmp_path / f"slow.{suffix}", grey(), tags={tag: value})
    with pytest.raises(InputError) as caught:
        Video(path)
    assert f"{tag.lower()}, but is shown at 30 Hz; set recordings.videos.rate_hz to {filmed:g}" in str(caught.value)
    assert read(path, rate_hz=filmed)[1].rate_hz == filmed
    assert read(path, rate_hz=30.0)[1].rate_provenance == "configured"


@pytest.mark.parametrize(
    ("tags", "times"),
    [
        ({"com.android.capture.fps": "30.000000"}, None),
        ({"com.android.capture.fps": "29.97"}, None),
        ({"com.android.capture.fps": "30"}, np.delete(np.arange(60), np.arange(5, 60, 6))),  # a phone's, with gaps
        ({"com.android.version": "240", "title": "capture fps"}, None),
        ({"com.android.capture.fps": "unknown"}, None),
        ({"x: 1\ncapture.fps": "240"}, None),
    ],
)
def test_a_tag_of_the_same_rate_or_of_none_changes_nothing(tmp_path, tags, times):
    frames = grey(40 if times is None else len(times))
    assert read(write(tmp_path / "clip.mp4", frames, times=times, tags=tags))[1].rate_hz == pytest.approx(30, rel=1e-3)


def pendulum(count=40, **how):
    centres = markers_of(swinging(count, (1.2, 0.5, 0.0, 0.0))[:, :2], (110.2, 100.7), (52.0, 38.0))
    return draw(centres, (224, 208), [PAINT[n] for n in ("red", "green", "blue")], 16, **how)


@pytest.mark.slow
def test_inspect_proposes_the_rate_of_the_tag_and_says_so(tmp_path, caplog):
    path = write(tmp_path / "slow.mp4", pendulum(), tags={"com.android.capture.fps": "240.000000"})
    text = inspect(path, tmp_path / "sheet.png")
    block = yaml.safe_load(text)["recordings"]
    assert block["videos"]["rate_hz"] == block["analysis_rate_hz"] == 240
    assert "com.android.capture.fps" in block["videos"]["rate_provenance"]
    note = "filmed at 240 Hz by its tag com.android.capture.fps and shown at 30 Hz"
    assert f"# {note}" in text and note in caplog.text


def test_tags_of_some_files_go_under_their_names():
    def look(name, **stated):
        known = StatedTimes(from_s=0.5, **stated)
        footage = Footage(Path(name), [], [], stated.get("rate_hz", 30.0), 90, None, known)
        return Look(footage, {}, None, {"markers": {"style": "disk"}, "marker_diameter_px": 20.0})

    block = combine([look("plain.mp4"), look("slow.mp4", rate_hz=240.0, rate_provenance="tag")])
    assert block["videos"] == {"path": ["plain.mp4", "slow.mp4"], "from_s": 0.5} and block["analysis_rate_hz"] == 30
    assert block["by_recording"] == {"slow": {"videos": {"rate_hz": 240.0, "rate_provenance": "tag"}}}
    both = combine([look(name, rate_hz=240.0) for name in ("a.mp4", "b.mp4")])
    assert both["videos"]["rate_hz"] == 240 and "by_recording" not in both


def with_long_last_frame(path, times):
    """Make the last frame of an MP4 of even ones last for so many; the rate in its metadata is then lower."""
    data = bytearray(path.read_bytes())
    at = data.index(b"stts") + 8
    entries, count, each = struct.unpack(">III", data[at : at + 12])
    assert entries == 1
    size = data.index(b"stts") - 4
    data[size : at + 12] = struct.pack(">I4sIIIIII", 32, b"stts", 0, 2, count - 1, each, 1, times * each)
    head = data.index(b"mdhd") + 20
    data[head : head + 4] = struct.pack(">I", struct.unpack(">I", data[head : head + 4])[0] + (times - 1) * each)
    for box in (b"moov", b"trak", b"mdia", b"minf", b"stbl"):
        start = data.index(box) - 4
        data[start : start + 4] = struct.pack(">I", struct.unpack(">I", data[start : start + 4])[0] + 8)
    path.write_bytes(data)


@pytest.mark.parametrize("first", [0, 17])
@pytest.mark.parametrize("b_frames", [0, 2])
def test_the_rate_is_that_of_the_frames_that_are_shown(tmp_path, b_frames, first):
    """A header's count and duration, of which FFmpeg makes a rate, know no edit list, and what the last frame does."""
    path = write(tmp_path / "clip.mp4", grey(), bf=str(b_frames))
    data = bytearray(path.read_bytes())
    at = data.index(b"elst") + 12
    length, start = struct.unpack(">Ii", data[at : at + 8])
    (ticks,) = struct.unpack(">I", data[(head := data.index(b"mdhd") + 16) : head + 4])
    data[at : at + 8] = struct.pack(">Ii", length - first * 1000 // 30, start + first * ticks // 30)
    path.write_bytes(data)
    with_long_last_frame(path, 5)
    with av.open(str(path)) as container:
        assert abs(float(container.streams.video[0].average_rate) - 30) > 2
    images, video = read(path)
    assert len(images) == 40 - first and video.rate_hz == pytest.approx(30)


# ── The first time ───────────────────────────────────────────────────────────


@pytest.mark.parametrize("suffix", ["mkv", "mp4", "ts", "flv", "nut", "mov"])
@pytest.mark.parametrize("b_frames", [0, 2])
def test_a_late_first_time_is_no_lack_of_frames(tmp_path, suffix, b_frames):
    path = write(tmp_path / f"late.{suffix}", grey(), times=300 + np.arange(40), bf=str(b_frames))
    images, video = read(path)
    assert len(images) == video.count == 40 and video.times is None and video.rate_hz == pytest.approx(30)


def test_a_variable_rate_is_read_without_a_count_too(tmp_path):
    times = np.delete(300 + np.arange(60), np.arange(5, 60, 6))
    images, video = read(write(tmp_path / "late.mkv", grey(len(times)), times=times))
    assert len(images) == len(times)
    np.testing.assert_allclose(video.times, (times - 300) / 30, atol=0.0006)


def test_a_cut_file_that_starts_late_is_still_refused(tmp_path):
    frames = np.random.default_rng(0).integers(0, 256, (60, 64, 64, 3), dtype=np.uint8)
    path = write(tmp_path / "late.mkv", frames, times=300 + np.arange(60))
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])
    with pytest.raises(InputError, match=r"ends after \d+ of 60 declared frames|spoiled near"):
        read(path)


# ── Pixels and their place ───────────────────────────────────────────────────


@pytest.mark.parametrize(
    ("aspect", "size", "shown"),
    [
        (Fraction(4, 3), (96, 120), (160, 96)),
        (Fraction(8, 9), (96, 128), (128, 108)),
        (Fraction(2, 1), (96, 64), (128, 96)),
    ],
)
def test_pixels_are_made_square(tmp_path, aspect, size, shown):
    """A disk that players show round is round, from the reader as from the store."""
    y, x = np.mgrid[: size[0], : size[1]]
    wide, high = shown[0] / size[1], shown[1] / size[0]
    disk = np.hypot((x + 0.5) * wide - 60, (y + 0.5) * high - 50) < 30
    frames = np.repeat(np.where(disk, 220, 20).astype(np.uint8)[None, :, :, None], 3, 3).repeat(9, 0)

    def stretched(stream):
        stream.codec_context.sample_aspect_ratio = aspect

    path = write(tmp_path / "clip.mp4", frames, prepare=stretched)
    extract_frames(path, tmp_path / "s.b2frame", ExtractFramesJob())
    images, video = read(path, image_size_px=shown)
    kept = FrameStore(tmp_path / "s.b2frame")[0]
    np.testing.assert_array_equal(kept, images[0])
    assert (video.width, video.height) == shown == kept.shape[1::-1]
    rows, columns = np.nonzero(kept[..., 1] > 120)
    assert (columns.mean() + 0.5, rows.mean() + 0.5) == pytest.approx((60, 50), abs=0.3)
    assert (np.ptp(columns), np.ptp(rows)) == pytest.approx((60, 60), abs=3)


def test_a_fragmented_file_is_counted(tmp_path):
    frames = grey()
    with av.open(str(tmp_path / "clip.mp4"), "w", options={"movflags": "frag_keyframe+empty_moov"}) as made:
        stream = made.add_stream("libx264", rate=30, options={"g": "12"})
        stream.height, stream.width, stream.pix_fmt = 48, 64, "yuv420p"
        for image in frames:
            made.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="bgr24").reformat(format="yuv420p")))
        made.mux(stream.encode())
    assert len(read(tmp_path / "clip.mp4")[0]) == 40


def test_an_absurd_aspect_is_refused(tmp_path):
    def stretched(stream):
        stream.codec_context.sample_aspect_ratio = Fraction(20, 1)

    path = write(tmp_path / "clip.mp4", grey(), prepare=stretched)
    with pytest.raises(InputError, match=r"pixels 20 times as wide as high; say the true one: ffmpeg .* -vf setsar=1"):
        Video(path)


@pytest.mark.parametrize("degrees", [0, 90, 180, 270])
@pytest.mark.parametrize("mirror", ["", "hflip", "vflip"])
def test_all_eight_ways_of_holding_a_camera_are_read(tmp_path, degrees, mirror):
    """Turned first, mirrored then, as the matrix was made."""
    image = np.full((96, 128, 3), 20, np.uint8)
    image[:48, :64], image[:48, 64:] = 230, 120
    path = write(
        tmp_path / "clip.mp4",
        np.stack([image] * 3),
        prepare=lambda s: s.set_display_rotation(degrees, **({mirror: True} if mirror else {})),
    )
    upright = np.rot90(image, degrees // 90)
    upright = {"": upright, "hflip": upright[:, ::-1], "vflip": upright[::-1]}[mirror]
    np.testing.assert_allclose(read(path)[0][0].astype(int), upright, atol=40)


def test_pixels_are_made_square_before_they_are_turned(tmp_path):
    def prepare(stream):
        stream.codec_context.sample_aspect_ratio = Fraction(4, 3)
        stream.set_display_rotation(90)

    assert read(write(tmp_path / "clip.mkv", grey(size=(96, 120)), prepare=prepare))[0].shape == (40, 160, 96, 3)


@pytest.mark.parametrize("degrees", [30, 45])
def test_a_matrix_that_is_no_quarter_turn_is_refused(tmp_path, degrees):
    path = write(tmp_path / "clip.mp4", grey(), prepare=lambda s: s.set_display_rotation(degrees))
    with pytest.raises(InputError, match=f"its display matrix turns the image by -?{degrees} degrees"):
        Video(path)


def test_rates_of_tags():
    assert declared.find_filmed_rate({"a": "1", "Capture.FPS": "119.88p"}) == ("capture.fps", 119.88)
    assert declared.find_filmed_rate({"capture.fps": "1/0"}) is None

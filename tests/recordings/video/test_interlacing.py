"""Frames woven of two fields are named, whether their codec says so or not; sound ones are not."""

import av
import cv2
import numpy as np
import pytest

from expertaug.errors import InputError
from expertaug_recordings.video.interlacing import combs
from expertaug_recordings.video.reader import Video

SIZE, COUNT = (96, 128), 30


def shown(t, way):
    """A disk and a bar, light and dark, on a wall at times t in frames: (n, H, W) uint8."""
    y, x = np.mgrid[: SIZE[0], : SIZE[1]].astype(np.float32)
    wall = 90 + 25 * np.sin(x / 9) + np.random.default_rng(0).normal(0, 2, SIZE)
    images = []
    for now in t:
        at = 64 + way[0] * np.sin(0.25 * now), 48 + way[1] * np.sin(0.25 * now)
        disk = np.clip(12.5 - np.hypot(x - at[0], y - at[1]), 0, 1)
        bar = np.clip(3.5 - np.abs(x - at[0] - 25), 0, 1) * (np.abs(y - at[1]) < 20)
        images.append(np.clip(wall * (1 - disk - bar) + 230 * disk + 10 * bar, 0, 255))
    return np.array(images, np.uint8)


def woven(t, way, parity=0):
    """The same with every other row half a frame later."""
    images, later = shown(t, way), shown(np.asarray(t) + 0.5, way)
    images[:, 1 - parity :: 2] = later[:, 1 - parity :: 2]
    return images


def write(path, images, flagged=False, crf=23):
    options = {"crf": str(crf), "preset": "superfast"} | ({"x264-params": "tff=1"} if flagged else {})
    with av.open(str(path), "w") as made:
        stream = made.add_stream("libx264", rate=25, options=options)
        stream.height, stream.width, stream.pix_fmt = *images.shape[1:], "yuv420p"
        stream.codec_context.thread_count = 1
        for image in images:
            frame = av.VideoFrame.from_ndarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), format="bgr24")
            made.mux(stream.encode(frame.reformat(format="yuv420p")))
        made.mux(stream.encode())
    return path


def read(path):
    with Video(path) as video:
        return {bool(picture.interlaced_frame) for _, picture in video.pictures()}


T = np.arange(COUNT)


@pytest.mark.parametrize("flagged", [False, True])
@pytest.mark.parametrize("parity", [0, 1])
@pytest.mark.parametrize("way", [(30, 0), (12, 0), (20, 20), (0, 30), (4, 0)], ids=str)
def test_woven_fields_are_named_with_what_helps(tmp_path, way, parity, flagged):
    path = write(tmp_path / "my clip.mp4", woven(T, way, parity), flagged)
    with pytest.raises(InputError, match=r"is interlaced \(teeth in \d+ of \d+ frames\)") as caught:
        read(path)
    assert "ffmpeg -i 'my clip.mp4' -vf bwdif" in str(caught.value) and "\n" not in str(caught.value)


def test_a_telecine_is_named(tmp_path):
    """Two of five frames are woven of two neighbours."""
    images = shown(np.arange(0, 60, 0.8), (30, 0))
    for k in range(0, len(images) - 1, 5):
        for j in (k + 2, k + 3):
            images[j, 1::2] = shown([0.8 * (j + 1)], (30, 0))[0, 1::2]
    with pytest.raises(InputError, match="is interlaced"):
        read(write(tmp_path / "clip.mp4", images))


@pytest.mark.parametrize("flagged", [False, True])
@pytest.mark.parametrize("way", [(30, 0), (0, 30), (20, 20), (3, 0)], ids=str)
def test_whole_frames_are_read_whatever_their_codec_says(tmp_path, way, flagged):
    assert read(write(tmp_path / "clip.mp4", shown(T, way), flagged)) == {flagged}


def test_noise_stripes_and_cuts_are_no_teeth(tmp_path):
    rng = np.random.default_rng(0)
    read(write(tmp_path / "noise.mp4", rng.integers(0, 256, (COUNT, *SIZE), dtype=np.uint8), crf=10))
    y = np.arange(SIZE[0])[:, None] + np.zeros(SIZE[1])
    stripes = np.array([127 + 100 * np.sign(np.sin(2 * np.pi * (y + 0.7 * k) / 6)) for k in T], np.uint8)
    read(write(tmp_path / "stripes.mp4", stripes, crf=10))
    read(write(tmp_path / "cuts.mp4", rng.integers(0, 256, (COUNT, 1, 1), dtype=np.uint8) + np.zeros(SIZE, np.uint8)))


def test_a_flag_counts_where_nothing_moves(tmp_path):
    with pytest.raises(InputError, match=r"is interlaced \(its codec says so\)"):
        read(write(tmp_path / "clip.mp4", shown(0 * T, (30, 0)), True))
    read(write(tmp_path / "still.mp4", shown(0 * T, (30, 0))))


def test_teeth_are_of_woven_fields_alone():
    before, whole, teeth = shown([0], (30, 0))[0], shown([1], (30, 0))[0], woven([1], (30, 0))[0]
    moved, sharp, rough = combs(before, teeth)
    assert sharp > 0.2 * moved > 50 and sharp > 10 * rough
    moved, sharp, _ = combs(before, whole)
    assert moved > 250 and sharp < 0.05 * moved
    assert combs(before, before) == (0, 0, 0)

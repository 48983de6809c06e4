"""A folder of pictures is a source like a video; its times come from a table, from names or from a rate."""

import cv2
import numpy as np
import pandas as pd
import pytest

from expertaug.config.sources import list_videos
from expertaug.errors import InputError
from expertaug_recordings.settings import ExtractFramesJob
from expertaug_recordings.video.frame_store import FrameStore
from expertaug_recordings.video.frame_store import run_stage as extract_frames
from expertaug_recordings.video.source import Pictures

COUNT = 12


def write(folder, suffix=".png", name="frame_{}", count=COUNT):
    folder.mkdir(parents=True, exist_ok=True)
    images = np.random.default_rng(0).integers(0, 256, (count, 32, 48, 3), dtype=np.uint8)
    for k, image in enumerate(images):
        cv2.imwrite(str(folder / f"{name.format(k)}{suffix}"), image)
    return images


@pytest.mark.parametrize("suffix", [".png", ".tif", ".PNG"])
def test_pictures_become_frames_in_their_natural_order(tmp_path, suffix):
    images = write(tmp_path / "series", suffix)
    extract_frames(tmp_path / "series", tmp_path / "s.b2frame", ExtractFramesJob(rate_hz=50, analysis_rate_hz=25))
    store = FrameStore(tmp_path / "s.b2frame")
    np.testing.assert_array_equal(np.stack(list(store)), images[::2])
    np.testing.assert_allclose(store.t, np.arange(0, COUNT, 2) / 50)


def test_times_of_a_table_are_kept(tmp_path):
    write(tmp_path / "series", ".jpg")
    t = np.cumsum(np.random.default_rng(0).uniform(20, 33, COUNT))
    names = [f"frame_{k}.jpg" for k in range(COUNT)]
    pd.DataFrame({"file": names, "t": t}).sample(frac=1, random_state=0).to_csv(tmp_path / "series" / "times.csv")
    extract_frames(tmp_path / "series", tmp_path / "s.b2frame", ExtractFramesJob(times="times.csv", time_unit_s=1e-3))
    store = FrameStore(tmp_path / "s.b2frame")
    np.testing.assert_allclose(store.t, (t - t[0]) / 1000)
    assert store.rate_hz == pytest.approx(1000 / np.median(np.diff(t)))


def test_times_of_names_give_order_and_rate(tmp_path):
    write(tmp_path / "series", name="run7_{:}00")
    with Pictures(tmp_path / "series", times="names", time_unit_s=1e-4) as series:
        assert series.times is None and series.rate_hz == pytest.approx(100) and series.count == COUNT


@pytest.mark.parametrize(
    ("stated", "message"),
    [
        ({}, "pictures have no frame rate; set recordings.videos.rate_hz or .times .*--rate or --times"),
        ({"rate_hz": 50, "times": "names"}, "give one of them"),
        ({"times": "tied.csv"}, "frame 3 is not later than the one before"),
        ({"times": "none.csv"}, "none.csv: no such file"),
        ({"times": "short.csv"}, r"no time of frame_1.png \(11 are missing\)"),
        ({"times": "text.csv"}, "no table of times"),
        ({"rate_hz": 50, "image_size_px": 32}, "pictures are 48x32 px; 32x32 expected"),
        ({"rate_hz": 50, "expected_frames": 13}, "12 pictures; 13 expected"),
    ],
)
def test_what_is_wrong_is_one_line(tmp_path, stated, message):
    write(tmp_path)
    (tmp_path / "short.csv").write_text("file,t\nframe_0.png,0\n")
    rows = [f"frame_{k}.png,{min(k, 2) + max(0, k - 3)}" for k in range(COUNT)]
    (tmp_path / "tied.csv").write_text("\n".join(["file,t", *rows]))
    (tmp_path / "text.csv").write_text("file,t\nframe_0.png,noon\n")
    with pytest.raises(InputError, match=message) as caught:
        Pictures(tmp_path, **stated)
    assert "\n" not in str(caught.value)


def test_a_spoiled_or_other_picture_is_named(tmp_path):
    write(tmp_path)
    (tmp_path / "frame_5.png").write_bytes(b"nothing")
    with pytest.raises(InputError, match=r"frame_5.png is no picture"):
        list(Pictures(tmp_path, rate_hz=50).frames())
    cv2.imwrite(str(tmp_path / "frame_5.png"), np.zeros((40, 48, 3), np.uint8))
    with pytest.raises(InputError, match=r"frame_5.png is 48x40 px; the first is 48x32 px"):
        list(Pictures(tmp_path, rate_hz=50).frames())


def test_folders_of_pictures_are_recordings_beside_videos(tmp_path):
    write(tmp_path / "a")
    write(tmp_path / "b")
    (tmp_path / "notes").mkdir()
    (tmp_path / "c.mp4").write_text("")
    (tmp_path / "contact.png").write_text("")
    assert list(list_videos(str(tmp_path))) == ["a", "b", "c"]
    assert list(list_videos(str(tmp_path / "a"))) == ["a"]
    assert list(list_videos(f"{tmp_path}/[ab]")) == ["a", "b"]

"""What is kept of a frame gives the image that OpenCV decodes, whatever the file's pixel format and colours."""

import av
import cv2
import numpy as np
import pytest

from expertaug_recordings.settings import ExtractFramesJob
from expertaug_recordings.video.frame_store import FrameStore
from expertaug_recordings.video.frame_store import run_stage as extract_frames
from expertaug_recordings.video.pixel_layout import Layout
from expertaug_recordings.video.reader import Video

BT709, UNSPECIFIED, LIMITED, FULL = 1, 2, 1, 2


def write(path, pixel_format, colorspace=UNSPECIFIED, color_range=0, size=(96, 64)):
    """A few frames of coloured noise, H.264."""
    rng = np.random.default_rng(0)
    base = cv2.resize(rng.integers(0, 256, (8, 12, 3), dtype=np.uint8), size)
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=50, options={"crf": "10"})
        (stream.width, stream.height), stream.pix_fmt = size, pixel_format
        stream.codec_context.colorspace, stream.codec_context.color_range = colorspace, color_range
        for shift in range(0, 15, 3):
            image = av.VideoFrame.from_ndarray(np.roll(base, shift, 1), format="bgr24")
            container.mux(stream.encode(image.reformat(format=pixel_format)))
        container.mux(stream.encode(None))
    return path


def by_opencv(path):
    capture, frames = cv2.VideoCapture(str(path)), []
    while (read := capture.read())[0]:
        frames.append(read[1])
    return np.stack(frames)


@pytest.mark.parametrize(
    ("written", "kept", "share"),
    [
        (("yuv420p",), "yuv420p", 0.5),
        (("yuv420p", BT709, LIMITED), "yuv420p", 0.5),
        (("yuv420p", BT709, FULL), "yuvj420p", 0.5),
        (("yuvj420p", UNSPECIFIED, FULL), "yuvj420p", 0.5),
        (("yuv444p", BT709, LIMITED), "bgr24", 1),
        (("yuv422p",), "bgr24", 1),
        (("yuv420p10le",), "bgr24", 1),
        (("yuv444p", UNSPECIFIED, 0, (97, 63)), "bgr24", 1),
        (("yuv420p", UNSPECIFIED, 0, (98, 64)), "yuv420p", 0.5),
        (("yuv420p", UNSPECIFIED, 0, (96, 66)), "bgr24", 1),
    ],
)
def test_images_are_those_of_opencv(tmp_path, written, kept, share):
    path = write(tmp_path / "video.mp4", *written)
    expected = by_opencv(path)
    with Video(path) as video:
        np.testing.assert_array_equal(np.stack([image for _, image in video.frames()]), expected)
    extract_frames(path, tmp_path / "s.b2frame", ExtractFramesJob())
    store = FrameStore(tmp_path / "s.b2frame")
    assert (store.layout.pixel_format, store.layout.frame_bytes) == (kept, share * expected[0].size)
    np.testing.assert_array_equal(store.read(0, len(store)), expected)
    np.testing.assert_array_equal(np.stack(list(store)), expected)


@pytest.mark.parametrize(
    ("layout", "frame"),
    [
        (Layout("bgr24", 8, 6), np.zeros((8, 6, 3), np.uint8)),
        (Layout("bgr24", 8, 6), np.zeros((6, 8, 3), np.float32)),
        (Layout("yuv420p", 8, 6), np.zeros((6, 8, 3), np.uint8)),
    ],
)
def test_an_image_that_does_not_fit_its_layout_is_refused(layout, frame):
    with pytest.raises(ValueError, match=r"expected an image \(6, 8, 3\) uint8|a decoder's frame expected"):
        layout.pack(frame, np.empty(layout.frame_bytes, np.uint8))

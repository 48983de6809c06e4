"""Writing frames as H.264 video."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np


def encode(
    path: Path,
    frames: Iterator[np.ndarray],
    size: int | tuple[int, int],
    rate_hz: float,
    crf: int = 18,
    speed: str = "superfast",
    flags: str = "",
) -> None:
    """Write BGR frames (height, width, 3) as H.264 on one thread; the same frames give the same bytes.

    Arguments:
        path: mp4 or mkv by its suffix.
        frames: images, uint8.
        size: side of square frames, or (width, height), even.
        rate_hz: frames per second.
        crf: constant rate factor, 0 (lossless) to 51.
        speed: x264's preset: faster ones make larger files.
        flags: FFmpeg's flags of the mp4 container; ``+faststart`` lets a browser play it while it loads.
    """
    rate = Fraction(rate_hz).limit_denominator(1001)
    width, height = (size, size) if isinstance(size, int) else size
    options = {"fflags": "+bitexact"} | ({"movflags": flags} if flags else {})
    with av.open(str(path), "w", options=options) as container:
        stream = container.add_stream("libx264", rate=rate, options={"crf": str(crf), "preset": speed})
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        stream.codec_context.thread_count = 1
        stream.time_base = stream.codec_context.time_base = 1 / rate
        for k, image in enumerate(frames):
            frame = av.VideoFrame.from_ndarray(cv2.cvtColor(image, cv2.COLOR_BGR2YUV_I420), format="yuv420p")
            frame.pts, frame.time_base = k, 1 / rate
            for packet in stream.encode(frame):
                container.mux(packet)
        for packet in stream.encode():
            container.mux(packet)

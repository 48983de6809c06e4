"""How fast frames are extracted, beside OpenCV alone on the same file: ``python benchmarks/extract.py [seconds]``.

One core and one thread.  Both are measured in turns and the medians taken, in processor time, so that other work on the
machine does not decide.
"""

from __future__ import annotations

import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import cv2

from expertaug_recordings.rendering.render import run_stage as render_recording
from expertaug_recordings.settings import ExtractFramesJob, RenderVideoJob
from expertaug_recordings.video.frame_store import FrameStore
from expertaug_recordings.video.frame_store import run_stage as extract_frames

RATE_HZ, ROUNDS = 400, 5


def opencv_alone(video: Path) -> None:
    """Read every frame and drop it."""
    capture = cv2.VideoCapture(str(video), cv2.CAP_FFMPEG, [cv2.CAP_PROP_N_THREADS, 1])
    while capture.read()[0]:
        pass


def seconds(task: Callable[[], None]) -> float:
    start = time.process_time()
    task()
    return time.process_time() - start


def main(duration_s: float) -> None:
    cv2.setNumThreads(1)
    with tempfile.TemporaryDirectory() as folder:
        video, store = Path(folder) / "video.mp4", Path(folder) / "frames.b2frame"
        job = RenderVideoJob(duration_s=duration_s, rate_hz=RATE_HZ)
        frames = round(duration_s * RATE_HZ)
        rendering = seconds(lambda: render_recording(0, video, Path(folder) / "truth.csv", job))
        size = video.stat().st_size / frames
        print(f"clip: {frames} frames, {size:.0f} bytes a frame; rendered at {frames / rendering:.0f} frames/s")
        for step in (1, 4):
            alone, ours = [], []
            for _ in range(ROUNDS):
                alone.append(seconds(lambda: opencv_alone(video)))
                extraction = ExtractFramesJob(analysis_rate_hz=RATE_HZ / step)
                ours.append(seconds(lambda: extract_frames(video, store, extraction)))  # noqa: B023
            alone_rate, our_rate = (frames / statistics.median(times) for times in (alone, ours))
            kept = len(FrameStore(store))
            print(
                f"analysis at {RATE_HZ / step:g} Hz: OpenCV alone {alone_rate:.0f} frames/s, extraction {our_rate:.0f}"
                f" frames/s, ratio {our_rate / alone_rate:.2f};"
                f" store {store.stat().st_size / kept / 1e3:.1f} kB per kept frame, raw {480 * 480 * 3 / 1e3:.0f}"
            )


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 5.0)

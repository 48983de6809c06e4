"""Speed and accuracy of the marker tracker on one core, on rendered video of the fastest motion there is.

    python benchmarks/track.py [--frames 1500] [--crf 18] [--style quadrant|disk] [--size 480]

Renders the fastest stretch of 21 recordings, compresses it as H.264, decodes it into memory and tracks it at the full
frame rate and at a quarter of it; the truth that it scores against is the renderer's.  The last line is the whole
stage: a frame store read, tracked and written as markers.csv.  Speeds are medians of five rounds.  ``--style disk``
paints a plain disk over each marker.  In a larger picture (``--size``) the arms are longer, the markers are not.
"""

from __future__ import annotations

import argparse
import os
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy

import cv2
import numpy as np

from expertaug_recordings.markers.appearance import ROLES, STYLES
from expertaug_recordings.markers.geometry import estimate_geometry
from expertaug_recordings.markers.track import run_stage as track_markers
from expertaug_recordings.markers.tracker import Track, track_frames
from expertaug_recordings.rendering.render import RenderVideoJob, markers, motion, poses
from expertaug_recordings.rendering.scene import HALF, RADIUS, Scene
from expertaug_recordings.settings import ExtractFramesJob, TrackMarkersJob
from expertaug_recordings.video.frame_store import FrameStore
from expertaug_recordings.video.frame_store import run_stage as extract_frames
from expertaug_recordings.video.writer import encode

SIZE = 480  # px, that of a real frame
SECONDS = 10  # of each recording: launches are fastest at first
RECORDINGS = 8
PAINT = ((50, 40, 210), (60, 170, 50), (200, 90, 40))  # blue, green and red of a red, a green and a blue disk
ROUNDS = 5
NOISE = 4.0  # grey levels, on the painted disks


def fastest(count: int, settings: RenderVideoJob) -> tuple[np.ndarray, tuple[float, float]]:
    """States (count, 4) round the fastest turn of the second arm in all recordings, and that recording's pivot."""
    runs = [motion(index, settings) for index in range(RECORDINGS)]
    _, states, pivot = max(runs, key=lambda run: np.abs(run[1][:, 3]).max())
    middle = int(np.abs(states[:, 3]).argmax())
    start = min(max(0, middle - count // 2), max(0, len(states) - count))
    return states[start : start + count], pivot


def render(
    path: Path,
    states: np.ndarray,
    pivot: tuple[float, float],
    arms: tuple[float, float],
    settings: RenderVideoJob,
    centres: np.ndarray | None = None,
) -> None:
    """A compressed clip of these states (n, 4), with plain disks painted at ``centres`` (n, 3, 2) px if given."""
    size = settings.image_size_px
    scene = Scene(size, pivot, arms, settings.noise, np.random.default_rng(0))
    drawn = (scene.frame(poses(state, pivot, arms, settings.exposure_s)) for state in states)
    if centres is not None:
        rng = np.random.default_rng(0)
        drawn = (paint(frame, places, rng) for frame, places in zip(drawn, centres, strict=True))
    encode(path, drawn, size, settings.rate_hz, crf=settings.crf, speed=settings.preset)


def paint(frame: np.ndarray, places: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The frame with a plain disk over each marker at ``places`` (3, 2) px, with smooth rims and noise."""
    for (x, y), colour in zip(places, PAINT, strict=True):
        x0, y0 = int(x) - HALF, int(y) - HALF
        part = frame[y0 : y0 + 2 * HALF + 1, x0 : x0 + 2 * HALF + 1]
        rows, columns = np.indices(part.shape[:2])
        cover = np.clip(RADIUS + 0.5 - np.hypot(columns + x0 - x, rows + y0 - y), 0, 1)[..., None]
        noisy = np.array(colour) + rng.normal(0, NOISE, part.shape)
        part[:] = np.rint(cover * noisy + (1 - cover) * part)
    return frame


def report(label: str, seconds: float, track: Track, truth: np.ndarray) -> None:
    error = np.linalg.norm(track.position - truth, axis=-1)
    step = np.linalg.norm(np.diff(truth[:, 2], axis=0), axis=-1).max()
    usable = np.mean(track.quality > 0)
    print(f"{label}: {len(truth) / seconds:.0f} frames/s, tip up to {step:.1f} px a frame, {usable:.2%} usable")
    for name, column in (("all", error), *zip(ROLES, error.T, strict=True)):
        middle, tail, largest = np.nanmedian(column), np.nanpercentile(column, 99), np.nanmax(column)
        print(f"    {name:5s} error median {middle:.3f} px, p99 {tail:.3f} px, largest {largest:.2f} px")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=1500)
    parser.add_argument("--crf", type=int, default=18)
    parser.add_argument("--style", choices=STYLES, default="quadrant")
    parser.add_argument("--size", type=int, default=480, help="of the picture, in px")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    usual, larger = RenderVideoJob(), options.size / SIZE
    settings = RenderVideoJob(
        duration_s=SECONDS,
        crf=options.crf,
        image_size_px=options.size,
        pixels_per_metre=usual.pixels_per_metre * larger,
        pivot_px=tuple(larger * place for place in usual.pivot_px),
    )
    arms = tuple(length * settings.pixels_per_metre for length in settings.arms_m)
    states, pivot = fastest(options.frames, settings)
    truth = np.stack([np.broadcast_to(pivot, (len(states), 2)), *markers(states, pivot, arms)], axis=1)
    with tempfile.TemporaryDirectory() as folder:
        clip, store = Path(folder) / "clip.mp4", Path(folder) / "frames.b2frame"
        render(clip, states, pivot, arms, settings, truth if options.style == "disk" else None)
        extract_frames(clip, store, ExtractFramesJob())
        measure(store, TrackMarkersJob(markers={"style": options.style}), truth, settings.rate_hz)


def measure(store: Path, look: TrackMarkersJob, truth: np.ndarray, rate_hz: float) -> None:
    """Track frames that lie decoded in memory, all and every fourth, and then those of the store."""
    frames = FrameStore(store).read(0, len(truth))
    geometry, _ = estimate_geometry(frames[:: max(1, len(frames) // look.calibration_frames)], look)
    for step in (1, 4):
        taken, track = seconds(lambda step=step: track_frames(frames[::step], geometry, look))
        report(f"{rate_hz / step:3.0f} Hz", taken, track, truth[::step])
    taken, _ = seconds(lambda: track_markers(store, store.with_name("markers.csv"), look))
    print(f"track_markers from the store: {len(frames) / taken:.0f} frames/s")


def seconds(task: Callable[[], Track]) -> tuple[float, Track]:
    """Median processor time of this one thread, which other work does not add to, and what the task returns."""
    taken = []
    for _ in range(ROUNDS):
        start = time.process_time()
        track = task()
        taken.append(time.process_time() - start)
    return statistics.median(taken), track


if __name__ == "__main__":
    main()

"""Recordings rendered as video: the embedded default for those who have no pendulum and no camera.

One recording is one call: its launch, friction and pivot follow from the seed and its number, so a recording's bytes
do not depend on how many others are rendered.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np

from expertaug.errors import InputError
from expertaug.files import atomic
from expertaug.recordings.columns import PLACES
from expertaug.recordings.rendering.motion import Launch, simulate
from expertaug.recordings.rendering.scene import Pose, Scene
from expertaug.recordings.rendering.settings import RenderSettings
from expertaug.systems.double_pendulum import Constants

TRUTH_COLUMNS = ",".join(("t", "theta1", "theta2", "omega1", "omega2", *PLACES))
VISIBLE_BLUR = 0.2  # px of motion within an exposure, below which one pose stands for all
LONG_BLUR = 2.0  # px from which on two are not enough


def render_recording(index: int, video: Path, truth: Path, settings: Mapping | RenderSettings) -> None:
    """Render recording ``index`` of the set as H.264 video, with its truth beside it for scoring.

    Arguments:
        index: number of the recording, from 0.
        video: file to write; mp4 by its name.
        truth: CSV to write, one row a frame: t in s, angles in rad, speeds in rad/s, marker centres in px.
        settings: of :class:`RenderSettings`.

    Raises:
        InputError: a setting or the output folder cannot be used.
    """
    cv2.setNumThreads(1)
    s = settings if isinstance(settings, RenderSettings) else RenderSettings.from_mapping(settings)
    if index < 0 or (s.count is not None and index >= s.count):
        raise InputError(
            "recordings.rendered", f"recording {index} of {s.count}", "they are numbered from 0 to count - 1"
        )
    times, states, pivot = motion(index, s)
    rng = np.random.default_rng([s.seed, index, 1])
    arms = tuple(length * s.pixels_per_metre for length in s.arms_m)
    scene = Scene(s.image_size_px, pivot, arms, s.noise, rng)
    with atomic(video) as temporary:
        frames = (scene.frame(poses(state, pivot, arms, s.exposure_s)) for state in states)
        encode(temporary, frames, s.image_size_px, s.rate_hz, crf=s.crf, preset=s.preset)
    green, blue = markers(states, pivot, arms)
    table = np.column_stack([times, states, np.broadcast_to(pivot, green.shape), green, blue])
    with atomic(truth) as temporary:
        np.savetxt(temporary, table, fmt="%.9g", delimiter=",", header=TRUTH_COLUMNS, comments="")


def motion(index: int, s: RenderSettings) -> tuple[np.ndarray, np.ndarray, tuple[float, float]]:
    """Times (T,), states (T, 4) and the pivot in px of one recording."""
    rng = np.random.default_rng([s.seed, index, 0])
    constants = Constants(**s.constants.model_dump())
    start = Launch(**s.launch.model_dump()).draw(rng, constants)
    pivot = tuple(float(c + rng.uniform(-1, 1) * s.pivot_spread_px) for c in s.pivot_px)
    times = np.arange(s.frames) / s.rate_hz
    return times, simulate(start[None], times, constants, s.friction)[0], pivot


def markers(states: np.ndarray, pivot: tuple[float, float], arms: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Centres of the green and blue markers in px, (..., 2) each, for states (..., 4)."""
    theta1, theta2 = states[..., 0], states[..., 1]
    green = np.asarray(pivot) + arms[0] * np.stack([np.sin(theta1), np.cos(theta1)], axis=-1)
    return green, green + arms[1] * np.stack([np.sin(theta2), np.cos(theta2)], axis=-1)


def poses(state: np.ndarray, pivot: tuple[float, float], arms: tuple[float, float], exposure: float) -> list[Pose]:
    """The poses whose mean is the exposed frame: one; where motion is visible two of the same spread, or one a px."""
    theta1, theta2, omega1, omega2 = (float(v) for v in state)
    fastest = exposure * (arms[0] * abs(omega1) + arms[1] * abs(omega2))
    if fastest < VISIBLE_BLUR:
        offsets = (0.0,)
    elif fastest < LONG_BLUR:  # uniform motion has the variance of two poses at ± exposure / √12
        offsets = (-exposure / math.sqrt(12), exposure / math.sqrt(12))
    else:
        count = math.ceil(fastest)
        offsets = [exposure * ((k + 0.5) / count - 0.5) for k in range(count)]
    out = []
    for dt in offsets:
        a, b = theta1 + omega1 * dt, theta2 + omega2 * dt
        green = (pivot[0] + arms[0] * math.sin(a), pivot[1] + arms[0] * math.cos(a))
        out.append(Pose(pivot, green, (green[0] + arms[1] * math.sin(b), green[1] + arms[1] * math.cos(b)), a, b))
    return out


def encode(
    path: Path,
    frames: Iterator[np.ndarray],
    size: int | tuple[int, int],
    rate_hz: float,
    crf: int = 18,
    preset: str = "superfast",
    flags: str = "",
) -> None:
    """Write BGR frames (height, width, 3) as H.264 on one thread; the same frames give the same bytes.

    Arguments:
        path: mp4 or mkv by its suffix.
        frames: uint8.
        size: side of square frames, or (width, height), even.
        rate_hz: frames per second.
        flags: of the mp4 container; ``+faststart`` lets a browser play it while it loads.
    """
    rate = Fraction(rate_hz).limit_denominator(1001)
    width, height = (size, size) if isinstance(size, int) else size
    options = {"fflags": "+bitexact"} | ({"movflags": flags} if flags else {})
    with av.open(str(path), "w", options=options) as container:
        stream = container.add_stream("libx264", rate=rate, options={"crf": str(crf), "preset": preset})
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

"""Recordings rendered as video: the embedded default for those who have no pendulum and no camera.

One recording is one call: its launch, friction and pivot follow from the seed and its number, so a recording's bytes
do not depend on how many others are rendered.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from expertaug.errors import InputError
from expertaug.files import atomic
from expertaug.systems.double_pendulum import Constants
from expertaug_recordings.rendering.motion import Launch, simulate
from expertaug_recordings.rendering.scene import Pose, Scene
from expertaug_recordings.settings import RenderVideoJob
from expertaug_recordings.tables import PLACES
from expertaug_recordings.video.writer import encode

TRUTH_COLUMNS = ",".join(("t", "theta1", "theta2", "omega1", "omega2", *PLACES))
VISIBLE_BLUR = 0.2  # px of motion within an exposure, below which one pose stands for all
LONG_BLUR = 2.0  # px from which on two are not enough


@dataclass(frozen=True)
class Rendering:
    """A rendered recording.

    Attributes:
        frames: images (height, width, 3), uint8 BGR, made one after the other as they are asked for, once.
        truth: a row a frame, :data:`TRUTH_COLUMNS`.
    """

    frames: Iterator[np.ndarray]
    truth: np.ndarray


def run_stage(index: int, video: Path, truth: Path, job: RenderVideoJob) -> None:
    """Stage: render recording ``index`` of the set as H.264 video, with its truth beside it for scoring.

    Arguments:
        index: number of the recording, from 0.
        video: file to write; mp4 by its name.
        truth: CSV to write, one row a frame: t in s, angles in rad, speeds in rad/s, marker centres in px.
        job: its settings.

    Raises:
        InputError: a setting or the output folder cannot be used.
    """
    rendering = render_recording(index, job)
    with atomic(video) as temporary:
        encode(temporary, rendering.frames, job.image_size_px, job.rate_hz, crf=job.crf, speed=job.preset)
    with atomic(truth) as temporary:
        np.savetxt(temporary, rendering.truth, fmt="%.9g", delimiter=",", header=TRUTH_COLUMNS, comments="")


def render_recording(index: int, job: RenderVideoJob) -> Rendering:
    """Render recording ``index`` of the set.

    Raises:
        InputError: there is no such recording, or a setting cannot be used.
    """
    cv2.setNumThreads(1)
    if index < 0 or (job.count is not None and index >= job.count):
        raise InputError(
            "recordings.rendered", f"recording {index} of {job.count}", "they are numbered from 0 to count - 1"
        )
    times, states, pivot = motion(index, job)
    rng = np.random.default_rng([job.seed, index, 1])
    arms = tuple(length * job.pixels_per_metre for length in job.arms_m)
    scene = Scene(job.image_size_px, pivot, arms, job.noise, rng)
    joint, tip = markers(states, pivot, arms)
    table = np.column_stack([times, states, np.broadcast_to(pivot, joint.shape), joint, tip])
    return Rendering((scene.frame(poses(state, pivot, arms, job.exposure_s)) for state in states), table)


def motion(index: int, job: RenderVideoJob) -> tuple[np.ndarray, np.ndarray, tuple[float, float]]:
    """Times (T,), states (T, 4) and the pivot in px of one recording."""
    rng = np.random.default_rng([job.seed, index, 0])
    constants = Constants(**job.constants.model_dump())
    start = Launch(**job.launch.model_dump()).draw(rng, constants)
    pivot = tuple(float(c + rng.uniform(-1, 1) * job.pivot_spread_px) for c in job.pivot_px)
    times = np.arange(job.frames) / job.rate_hz
    return times, simulate(start[None], times, constants, job.friction)[0], pivot


def markers(states: np.ndarray, pivot: tuple[float, float], arms: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Centres of the joint's and the tip's markers in px, (..., 2) each, for states (..., 4)."""
    theta1, theta2 = states[..., 0], states[..., 1]
    joint = np.asarray(pivot) + arms[0] * np.stack([np.sin(theta1), np.cos(theta1)], axis=-1)
    return joint, joint + arms[1] * np.stack([np.sin(theta2), np.cos(theta2)], axis=-1)


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
        joint = (pivot[0] + arms[0] * math.sin(a), pivot[1] + arms[0] * math.cos(a))
        out.append(Pose(pivot, joint, (joint[0] + arms[1] * math.sin(b), joint[1] + arms[1] * math.cos(b)), a, b))
    return out

"""Recordings rendered as video: the embedded default for those who have no pendulum and no camera.

One recording is one call: its launch, friction and pivot follow from the seed and its number, so a recording's bytes
do not depend on how many others are rendered.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from expertaug.errors import InputError
from expertaug.files import atomic
from expertaug.recordings.columns import PLACES
from expertaug.recordings.rendering.motion import Launch, simulate
from expertaug.recordings.rendering.scene import Pose, Scene
from expertaug.recordings.video.writer import encode
from expertaug.systems.double_pendulum import Constants

TRUTH_COLUMNS = ",".join(("t", "theta1", "theta2", "omega1", "omega2", *PLACES))
FITTED = Constants(B1=0.103, G1=69.4, B2=1.35, G2=93.5)  # to the real recordings, in their nominal time
BY_HAND = Launch()
VISIBLE_BLUR = 0.2  # px of motion within an exposure, below which one pose stands for all
LONG_BLUR = 2.0  # px from which on two are not enough


@dataclass(frozen=True)
class RenderSettings:
    """What is rendered; :meth:`from_mapping` reads it from configuration.

    Attributes:
        seed: of every random draw.
        count: recordings in the set; None where it is not known: no recording depends on it.
        duration_s, rate_hz: length and frame rate of each.
        image_size_px: side of the square image; even.
        crf: constant rate factor of the H.264 encoder, 0 (lossless) to 51.
        preset: speed preset of the encoder.
        noise: standard deviation of the sensor noise at full white, in grey levels; 0 for none.
        exposure_s: exposure of a frame, which blurs what moves.
        pixels_per_metre: scale of the image.
        arms_m: lengths of the two arms, between marker centres.
        pivot_px, pivot_spread_px: mean (x, y) of the pivot and half the range by which it differs between recordings.
        constants: of the rigid body (B1, G1, B2, G2).
        friction: viscous friction of the two joints in s⁻¹.
        launch: ranges of the initial states.
    """

    seed: int = 0
    count: int | None = None
    duration_s: float = 40.0
    rate_hz: float = 400.0
    image_size_px: int = 480
    crf: int = 18
    preset: str = "superfast"
    noise: float = 4.0
    exposure_s: float = 90e-6
    pixels_per_metre: float = 1294.5
    arms_m: tuple[float, float] = (0.091, 0.0696)
    pivot_px: tuple[float, float] = (238.0, 239.0)
    pivot_spread_px: float = 4.0
    constants: Constants = FITTED
    friction: tuple[float, float] = (0.045, 0.08)
    launch: Launch = BY_HAND

    def __post_init__(self) -> None:
        for name in ("duration_s", "rate_hz", "exposure_s", "pixels_per_metre"):
            if not 0 < getattr(self, name) < math.inf:
                raise InputError(f"recordings.rendered.{name}", f"is {getattr(self, name)}", "it must be positive")
        if self.image_size_px < 64 or self.image_size_px % 2:
            raise InputError(
                "recordings.rendered.image_size_px", f"is {self.image_size_px}", "it must be even and at least 64"
            )
        if not 0 <= self.crf <= 51:
            raise InputError("recordings.rendered.crf", f"is {self.crf}", "it must be 0 to 51")
        if not 0 <= self.noise <= 50:
            raise InputError("recordings.rendered.noise", f"is {self.noise}", "it must be 0 to 50 grey levels")
        if not all(self.pivot_spread_px < v < self.image_size_px - self.pivot_spread_px for v in self.pivot_px):
            raise InputError(
                "recordings.rendered.pivot_px",
                f"is {list(self.pivot_px)}",
                f"it must lie in the {self.image_size_px} px image",
            )
        for name, (low, high) in dataclasses.asdict(self.launch).items():
            if low > high:
                raise InputError(f"recordings.rendered.launch.{name}", f"is [{low}, {high}]", "it must be [low, high]")

    @classmethod
    def from_mapping(cls, mapping: Mapping) -> RenderSettings:
        """Settings from configuration; what is not given keeps its default.

        Raises:
            InputError: a key is unknown or a value cannot be used.
        """
        nested = {"constants": Constants, "launch": Launch}
        values = _known(cls, mapping, "recordings.rendered")
        for name, kind in nested.items():
            if name in values and not isinstance(values[name], kind):
                default = {f.name: f.default for f in dataclasses.fields(cls)}[name]
                values[name] = dataclasses.replace(default, **_known(kind, values[name], f"recordings.rendered.{name}"))
        return cls(**values)

    @property
    def frames(self) -> int:
        """Frames of one recording."""
        return max(1, round(self.duration_s * self.rate_hz))


def _known(kind: type, mapping: Mapping, where: str) -> dict:
    names = {f.name: f.type for f in dataclasses.fields(kind)}
    if not isinstance(mapping, Mapping):
        raise InputError(where, f"is {mapping!r}", f"give a mapping of {', '.join(names)}")
    values = {}
    for key, value in mapping.items():
        if key not in names:
            raise InputError(f"{where}.{key}", "unknown key", f"known are {', '.join(names)}")
        values[key] = _checked(value, str(names[key]), f"{where}.{key}")
    return values


def _checked(value: object, kind: str, where: str) -> object:
    """A number, a pair of numbers or a text as the annotation asks; anything else is left to its own class."""
    number = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    if kind == "int | None":
        if value is None:
            return None
        kind = "int"
    if kind == "int" and not (number and value == int(value)):
        raise InputError(where, f"is {value!r}", "give a whole number")
    if kind == "float" and not number:
        raise InputError(where, f"is {value!r}", "give a number")
    if kind == "str" and not isinstance(value, str):
        raise InputError(where, f"is {value!r}", "give a text")
    if kind.startswith("tuple"):
        pair = isinstance(value, list | tuple) and len(value) == 2
        if not pair or any(isinstance(v, bool) or not isinstance(v, int | float) for v in value):
            raise InputError(where, f"is {value!r}", "give two numbers")
        return (float(value[0]), float(value[1]))
    return int(value) if kind == "int" else float(value) if kind == "float" else value


def render_recording(index: int, video: Path, truth: Path, settings: Mapping | RenderSettings) -> None:
    """Render recording ``index`` of the set as H.264 video, with its truth beside it for scoring.

    Arguments:
        index: number of the recording, from 0.
        video: file to write; mp4 by its name.
        truth: CSV to write, one row a frame: t in s, angles in rad, speeds in rad/s, marker centres in px.
        settings: see :class:`RenderSettings`.

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
        encode(temporary, frames, s.image_size_px, s.rate_hz, crf=s.crf, speed=s.preset)
    joint, tip = markers(states, pivot, arms)
    table = np.column_stack([times, states, np.broadcast_to(pivot, joint.shape), joint, tip])
    with atomic(truth) as temporary:
        np.savetxt(temporary, table, fmt="%.9g", delimiter=",", header=TRUTH_COLUMNS, comments="")


def motion(index: int, s: RenderSettings) -> tuple[np.ndarray, np.ndarray, tuple[float, float]]:
    """Times (T,), states (T, 4) and the pivot in px of one recording."""
    rng = np.random.default_rng([s.seed, index, 0])
    start = s.launch.draw(rng, s.constants)
    pivot = tuple(float(c + rng.uniform(-1, 1) * s.pivot_spread_px) for c in s.pivot_px)
    times = np.arange(s.frames) / s.rate_hz
    return times, simulate(start[None], times, s.constants, s.friction)[0], pivot


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

"""Rendered clips that move like recordings, with the truth, for benchmarks of the tracker."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pandas as pd

from expertaug.files import read_json
from expertaug_recordings.angles.measure import run_stage as measure_angles
from expertaug_recordings.ibm import import_markers, list_marker_files
from expertaug_recordings.rendering.render import RenderVideoJob, markers, motion, poses
from expertaug_recordings.rendering.scene import Scene
from expertaug_recordings.settings import ImportMarkersJob, MeasureAnglesJob
from expertaug_recordings.video.writer import encode

SIZE, RATE_HZ = 480, 400.0


@dataclass(frozen=True)
class Motion:
    """Consecutive states (n, 4) of a pendulum at 400 Hz; pivot and lengths of the arms in px."""

    name: str
    states: np.ndarray
    pivot: tuple[float, float]
    arms: tuple[float, float]

    @property
    def truth(self) -> np.ndarray:
        """Centres of the markers (n, 3, 2) in px."""
        pivot = np.broadcast_to(self.pivot, (len(self.states), 2))
        return np.stack([pivot, *markers(self.states, self.pivot, self.arms)], axis=1)

    @property
    def step(self) -> np.ndarray:
        """Way of the tip from frame to frame in px, (n - 1,)."""
        return np.linalg.norm(np.diff(self.truth[:, 2], axis=0), axis=-1)

    def part(self, middle: int, count: int) -> Motion:
        """``count`` states round one of them."""
        start = min(max(0, middle - count // 2), max(0, len(self.states) - count))
        return Motion(self.name, self.states[start : start + count], self.pivot, self.arms)

    def fastest(self, count: int) -> Motion:
        return self.part(int(self.step.argmax()), count)

    def nearest(self, count: int) -> Motion:
        """Where the tip passes the pivot most closely."""
        return self.part(int(np.linalg.norm(self.truth[:, 2] - self.truth[:, 0], axis=-1).argmin()), count)


def recordings_folder(given: Path | None) -> Path | None:
    """Where the real recordings are: as given, by EXPERTAUG_RECORDINGS, or beside the project; None if nowhere."""
    default = Path(__file__).parents[2] / "shared" / "recordings"
    folder = given or Path(os.environ.get("EXPERTAUG_RECORDINGS", default))
    return folder if folder.is_dir() else None


def recorded(folder: Path, most: int | None = None) -> Iterator[Motion]:
    """The motion of the real recordings, from their marker CSVs."""
    with tempfile.TemporaryDirectory() as work:
        for name, path in list(list_marker_files(folder).items())[:most]:
            table, angles, summary = (Path(work) / file for file in ("markers.csv", "angles.csv", "angles.json"))
            import_markers(path, table, ImportMarkersJob())
            measure_angles(table, angles, summary, MeasureAnglesJob())
            found, known = pd.read_csv(angles), read_json(summary)
            states = found[["theta1", "theta2", "omega1", "omega2"]].to_numpy()
            states = states[np.isfinite(states).all(axis=1)]
            pivot = (known["pivot_x_px"], known["pivot_y_px"])
            yield Motion(f"recording {name}", states, pivot, (known["arm1_px"], known["arm2_px"]))


def simulated(count: int, seconds: float = 10.0) -> Iterator[Motion]:
    """The motion of the built-in simulator."""
    settings = RenderVideoJob(duration_s=seconds)
    arms = tuple(length * settings.pixels_per_metre for length in settings.arms_m)
    for index in range(count):
        _, states, pivot = motion(index, settings)
        yield Motion(f"simulated {index}", states, pivot, arms)


def film(
    clip: Motion,
    exposure_s: float = 90e-6,
    noise: float = 4.0,
    crf: int = 18,
    change: Callable[[int, np.ndarray], np.ndarray] | None = None,
) -> np.ndarray:
    """Frames (n, 480, 480, 3) after compression; ``change`` of number and frame comes before it."""
    scene = Scene(SIZE, clip.pivot, clip.arms, noise, np.random.default_rng(0))

    def drawn() -> Iterable[np.ndarray]:
        for k, state in enumerate(clip.states):
            frame = scene.frame(poses(state, clip.pivot, clip.arms, exposure_s))
            yield change(k, frame) if change else frame

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "clip.mp4"
        encode(path, drawn(), SIZE, RATE_HZ, crf=crf)
        video = cv2.VideoCapture(str(path))
        frames = np.empty((len(clip.states), SIZE, SIZE, 3), np.uint8)
        for frame in frames:
            frame[:] = video.read()[1]
    return frames

"""A series of pictures as another laboratory takes it: something burnt into each disk, one of them off its hinge, times
that are uneven and stand in a table or in the names."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import yaml
from drawn import PAINT, draw, markers_of
from pendulum_motion import CONSTANTS, FRICTION
from scipy.interpolate import CubicSpline

from expertaug.config import load as config
from expertaug.config import recording_settings
from expertaug_recordings.angles.measure import run_stage as measure_angles
from expertaug_recordings.chunks import split_chunks
from expertaug_recordings.inspection.inspect import inspect
from expertaug_recordings.markers.track import run_stage as track_markers
from expertaug_recordings.rendering.motion import simulate
from expertaug_recordings.settings import StatedTimes
from expertaug_recordings.video.frame_store import run_stage as extract_frames

DEFAULT = Path(__file__).parents[2] / "config" / "config.yaml"
SLOWER = 0.55  # a pendulum that 38 frames/s can follow
UNEVEN = 0.075  # of an interval, by which times are off: a third of the intervals by more than a tenth
FINE_HZ = 400.0


@dataclass(frozen=True)
class Series:
    """Pictures of ``side`` px; ``off`` is how far the joint's marker is off its hinge, in px where they have 1000."""

    frames: int = 600
    side: int = 1000
    rate_hz: float = 38.0
    diameter: float = 60.0
    marks: tuple[str, str, str] = ("ring", "line", "dot")
    off: float = 3.6
    light: float = 0.0
    times: str = "times.csv"
    t: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        t = (np.arange(self.frames) + np.random.default_rng(0).normal(0, UNEVEN, self.frames)) / self.rate_hz
        object.__setattr__(self, "t", np.round(t - t[0], 6))

    def angles(self, t: np.ndarray) -> np.ndarray:
        """True angles (n, 2) in rad at times (n,) in s from the first picture's."""
        fine = np.arange(int(self.t[-1] * SLOWER * FINE_HZ) + 8) / FINE_HZ
        y = simulate(np.array([[1.9, 1.2, 0.0, 0.0]]), fine, CONSTANTS, FRICTION)[0, :, :2]
        return CubicSpline(fine, y)(t * SLOWER)

    def centres(self) -> np.ndarray:
        """Of the markers, (n, 3, 2) in px."""
        theta, scale = self.angles(self.t), self.side / 1000
        found = markers_of(theta, (500.3 * scale, 480.6 * scale), (225 * scale, 150 * scale))
        aside = theta[:, 0] + 0.5
        found[:, 1] += self.off * scale * np.stack([np.sin(aside), np.cos(aside)], axis=1)
        return found

    def write(self, folder: Path) -> StatedTimes:
        """Write the pictures; what is to be stated of their times."""
        folder.mkdir(parents=True)
        paint, names = [PAINT[name] for name in ("red", "green", "blue")], []
        for k, (places, t) in enumerate(zip(self.centres(), self.t, strict=True)):
            look = {"background": (60, 58, 55), "mark": self.marks, "light": self.light, "seed": k}
            (picture,) = draw(places[None], (self.side, self.side), paint, self.diameter, **look)
            names.append(f"{round(t * 1e6):010d}.jpg" if self.times == "names" else f"{k:05d}.jpg")
            cv2.imwrite(str(folder / names[-1]), picture, [cv2.IMWRITE_JPEG_QUALITY, 90])
        if self.times == "names":
            return StatedTimes(times="names", time_unit_s=1e-6)
        pd.DataFrame({"file": names, "t": self.t}).to_csv(folder / self.times, index=False)
        return StatedTimes(times=self.times)


def to_tables(series: Path, stated: StatedTimes, work: Path) -> tuple[pd.DataFrame, pd.DataFrame, Path]:
    """From inspect to chunks by what it proposes alone: markers.csv, angles.csv and the folder of the sets."""
    proposed = yaml.safe_load(inspect(series, work / "contact.png", stated))
    settings = config.validate(config.merge(config.load([DEFAULT]), proposed | {"run": ["double_pendulum"]}))
    names = ("frames.b2frame", "markers.csv", "angles.csv", "angles.json")
    store, markers, angles, summary = (work / series.name / name for name in names)
    store.parent.mkdir(parents=True, exist_ok=True)
    extract_frames(series, store, recording_settings.extract_frames(settings, series.name))
    track_markers(store, markers, recording_settings.track_markers(settings, series.name))
    measure_angles(markers, angles, summary, recording_settings.measure_angles(settings, series.name))
    split_chunks([angles], work / "data", recording_settings.split_chunks(settings, "double_pendulum"))
    return pd.read_csv(markers), pd.read_csv(angles), work / "data"


def scores(series: Series, markers: pd.DataFrame, angles: pd.DataFrame) -> dict[str, float]:
    """Share of the frames whose markers are right (within 1 px) that are used, largest error of a used marker in px;
    of the angles that are used their share and errors in degrees, stated over actual errors, and by how much the
    direction of gravity that inspect proposes is off: that is no error of theirs."""
    places = [f"{role}_{axis}" for role in ("pivot", "joint", "tip") for axis in "xy"]
    off = np.linalg.norm(markers[places].to_numpy().reshape(-1, 3, 2) - series.centres(), axis=2)
    used, right = markers["quality"].to_numpy() > 0, (off < 1).all(axis=1)
    good = angles[angles["quality"] == 1]
    error = good[["theta1", "theta2"]].to_numpy() - series.angles(good["t"].to_numpy() - angles["t"][0])
    error = np.rad2deg(np.angle(np.exp(1j * error)))
    turned = float(np.median(error))
    error = np.abs(error - turned)
    stated = np.rad2deg(good[["theta1_std", "theta2_std"]].to_numpy())
    return {
        "used_of_right": float(used[right].mean()),
        "largest_px": float(off[used].max()),
        "angles_used": len(good) / len(angles),
        "deg": float(np.median(error)),
        "p99_deg": float(np.quantile(error, 0.99)),
        "largest_deg": float(error.max()),
        "gravity_deg": turned,
        "stated": float(np.sqrt(np.mean(stated**2) / np.mean(error**2))),
    }

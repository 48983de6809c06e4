"""How exact angles and speeds are beside the raw markers, how right their stated uncertainty is, and what goes wrong
without being flagged when a video is spoiled.

    python benchmarks/angle_accuracy.py [OUTPUT] [--frames 400] [--rates 400 240 120 60 50 38 30 25]

OUTPUT (default results/angle_accuracy) gets rates.csv and spoilers.csv.  Clips are rendered, compressed, tracked and
measured as by the pipeline's own defaults.  A used frame is wrong where a marker is off by more than 1 px or an angle
by more than .5°.  Exit status 1 where an angle is worse than the raw markers (by more than 5 % at the 99th percentile),
an uncertainty is not right within a factor of 1.5, or a wrong frame is not flagged.
"""

from __future__ import annotations

import argparse
import logging
import os
import sys
import tempfile
from collections import Counter
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy

import cv2
import numpy as np
import pandas as pd

from clips import Motion, film
from expertaug.errors import InputError
from expertaug.files import atomic
from expertaug_recordings.angles.measure import run_stage as measure_angles
from expertaug_recordings.markers.geometry import estimate_geometry
from expertaug_recordings.markers.tracker import track_frames
from expertaug_recordings.rendering.render import RenderVideoJob, motion
from expertaug_recordings.settings import MeasureAnglesJob, TrackMarkersJob
from expertaug_recordings.tables import MARKERS, PLACES

STATE = ["theta1", "theta2", "omega1", "omega2"]
WRONG_PX, WRONG_DEG = 1.0, 0.5
SECONDS = 8.0  # of clips whose frames are far apart
SHAKE_PX, TWIN_PX, PATCH = 3.0, (430, 60), 16
SPOILERS = ("none", "blur", "30 Hz", "portrait", "flicker", "hand", "crf 40", "shake", "twin")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("output", type=Path, nargs="?", default=Path("results/angle_accuracy"))
    parser.add_argument("--frames", type=int, default=400, help="of a clip at most")
    parser.add_argument("--rates", type=float, nargs="*", default=[400, 240, 120, 60, 50, 38, 30, 25])
    options = parser.parse_args()
    cv2.setNumThreads(1)
    logging.getLogger("expertaug_recordings").setLevel(logging.ERROR)
    rates = pd.DataFrame([score_rate(rate, options.frames) for rate in options.rates])
    print(rates.to_string(index=False, float_format="%.3g"))
    spoilers = pd.DataFrame([score_spoiler(name, options.frames) for name in SPOILERS])
    print(spoilers.to_string(index=False, float_format="%.3g"))
    options.output.mkdir(parents=True, exist_ok=True)
    for name, table in (("rates", rates), ("spoilers", spoilers)):
        with atomic(options.output / f"{name}.csv") as temporary:
            table.to_csv(temporary, index=False, float_format="%.4g")
    missed = [f"angles at {row.rate_hz:g} Hz" for row in rates.itertuples() if row.p99_deg > 1.05 * row.raw_p99_deg]
    stated = rates.set_index("rate_hz").filter(like="std_")
    missed += [f"uncertainty at {rate:g} Hz" for rate in stated.index[((stated < 2 / 3) | (stated > 1.5)).any(axis=1)]]
    missed += [f"{row.wrong} wrong frames by {row.spoiler}" for row in spoilers.itertuples() if row.wrong]
    print("missed: " + ", ".join(missed) if missed else "every target is met")
    return 1 if missed else 0


def clip_at(rate: float, frames: int, index: int = 0) -> Motion:
    """A simulated motion at a frame rate."""
    settings = RenderVideoJob(duration_s=min(SECONDS, frames / rate), rate_hz=rate)
    _, states, pivot = motion(index, settings)
    arms = tuple(length * settings.pixels_per_metre for length in settings.arms_m)
    return Motion(f"{rate:g} Hz", states, pivot, arms)


def measured(
    images: np.ndarray, rate: float, job: MeasureAnglesJob | None = None
) -> tuple[np.ndarray, pd.DataFrame, Counter]:
    """Marker places (n, 3, 2), the table of angles, and the reasons of frames that are not used."""
    tracking = TrackMarkersJob()
    geometry, _ = estimate_geometry(images[:: max(1, len(images) // tracking.calibration_frames)], tracking)
    if geometry is None:
        raise InputError("clip", "no markers")
    found = track_frames(images, geometry, tracking)
    table = pd.DataFrame(found.position.reshape(-1, 6), columns=list(PLACES))
    table["frame"], table["t"] = np.arange(len(table)), np.arange(len(table)) / rate
    table["quality"], table["reason"] = found.quality, found.reason
    with tempfile.TemporaryDirectory() as work:
        paths = [Path(work) / name for name in ("markers.csv", "angles.csv", "angles.json")]
        table[list(MARKERS)].to_csv(paths[0], index=False)
        measure_angles(*paths, job or MeasureAnglesJob())
        angles = pd.read_csv(paths[1], keep_default_na=True)
    return found.position, angles, Counter(angles.loc[angles["quality"] < 1, "reason"])


def turned(difference: np.ndarray) -> np.ndarray:
    """Differences of angles in degrees, within half a turn."""
    return np.rad2deg(np.angle(np.exp(1j * difference)))


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def score_rate(rate: float, frames: int) -> dict[str, float]:
    """θ2 raw, by default and smoothed over .08 s; its speed; stated over actual errors (both angles, each speed)."""
    clip = clip_at(rate, frames)
    images = film(clip)
    row: dict[str, float] = {"rate_hz": rate}
    for name, job in (("", MeasureAnglesJob()), ("fixed_", MeasureAnglesJob(smoothing_window_s=0.08))):
        _, table, _ = measured(images, rate, job)
        good = (table["quality"] == 1).to_numpy()
        off = table[STATE].to_numpy()[good] - clip.states[good]
        raw = turned(table["theta2_raw"].to_numpy()[good] - clip.states[good, 1])
        off[:, :2] = turned(off[:, :2])
        std = table[[f"{s}_std" for s in STATE]].to_numpy()[good]
        std[:, :2] = np.rad2deg(std[:, :2])
        if not name:
            row |= {
                "used": good.mean(),
                "raw_deg": np.median(np.abs(raw)),
                "raw_p99_deg": np.quantile(np.abs(raw), 0.99),
            }
        row |= {
            f"{name}deg": np.median(np.abs(off[:, 1])),
            f"{name}p99_deg": np.quantile(np.abs(off[:, 1]), 0.99),
            f"{name}rad_s": np.median(np.abs(off[:, 3])),
            f"{name}p99_rad_s": np.quantile(np.abs(off[:, 3]), 0.99),
        }
        if not name:
            row |= {"std_angles": rms(std[:, :2]) / rms(off[:, :2])}
            row |= {f"std_speed{k}": rms(std[:, 1 + k]) / rms(off[:, 1 + k]) for k in (1, 2)}
    return row


def score_spoiler(name: str, frames: int) -> dict[str, object]:
    """What a spoiled clip still gives, and how many of the used frames are wrong."""
    rate = 30.0 if name == "30 Hz" else 400.0
    clip = clip_at(rate, frames)
    images, truth, rotation = spoiled(name, clip)
    row: dict[str, object] = {"spoiler": name, "frames": len(images)}
    try:
        places, table, reasons = measured(images, rate, MeasureAnglesJob(rotation_deg=rotation))
    except InputError as error:
        return row | {"used": 0.0, "wrong": 0, "reasons": f"refused: {error}"[:120]}
    good = (table["quality"] == 1).to_numpy()
    px = np.linalg.norm(places - truth, axis=2)[good]
    degrees = np.abs(turned(table[STATE[:2]].to_numpy()[good] - clip.states[good, :2]))
    wrong = (np.nan_to_num(px).max(1) > WRONG_PX) | (degrees.max(1) > WRONG_DEG)
    return row | {
        "used": good.mean(),
        "px": np.nanmedian(px),
        "p99_px": np.nanquantile(px, 0.99),
        "deg": np.median(degrees),
        "p99_deg": np.quantile(degrees, 0.99),
        "largest_deg": degrees.max(),
        "wrong": int(wrong.sum()),
        "reasons": ", ".join(f"{reason} {count}" for reason, count in reasons.most_common(3)),
    }


def spoiled(name: str, clip: Motion) -> tuple[np.ndarray, np.ndarray, float]:
    """Frames, where the markers are in them (n, 3, 2), and where gravity points in them in degrees."""
    truth, rng = clip.truth, np.random.default_rng(0)
    if name == "blur":
        return film(clip, exposure_s=1.5e-3), truth, 0.0
    if name == "crf 40":
        return film(clip, crf=40), truth, 0.0
    if name == "portrait":
        side = 479
        lying = np.stack([np.rot90(frame).copy() for frame in film(clip)])
        return lying, np.stack((truth[..., 1], side - truth[..., 0]), axis=-1), 90.0
    if name == "flicker":
        light = 0.8 + 0.2 * np.sin(2 * np.pi * 100 / 400 * np.arange(len(truth)) + 0.3)
        return film(clip, change=lambda k, frame: np.rint(frame * light[k]).astype(np.uint8)), truth, 0.0
    if name == "hand":
        return film(clip, change=_hand), truth, 0.0
    if name == "shake":
        way = np.convolve(rng.normal(size=2 * len(truth) + 40), np.ones(11) / 11**0.5, "valid")
        way = SHAKE_PX / 2 * way[: 2 * len(truth)].reshape(-1, 2)

        def shifted(k: int, frame: np.ndarray) -> np.ndarray:
            matrix = np.float32([[1, 0, way[k, 0]], [0, 1, way[k, 1]]])
            return cv2.warpAffine(frame, matrix, frame.shape[1::-1], flags=cv2.INTER_CUBIC)

        return film(clip, change=shifted), truth + way[:, None], 0.0
    if name == "twin":
        first = film(clip.part(0, 1))[0]
        x, y = truth[0, 2].round().astype(int)
        patch = first[y - PATCH : y + PATCH + 1, x - PATCH : x + PATCH + 1]

        def doubled(_: int, frame: np.ndarray) -> np.ndarray:
            x, y = TWIN_PX
            view = frame[y - PATCH : y + PATCH + 1, x - PATCH : x + PATCH + 1]
            np.maximum(view, patch, out=view)
            return frame

        return film(clip, change=doubled), truth, 0.0
    return film(clip), truth, 0.0


def _hand(k: int, frame: np.ndarray) -> np.ndarray:
    """A hand comes in from the left, as far as over the pendulum, and goes again."""
    reach = int(300 * np.sin(np.pi * min(k, 200) / 200) ** 2)
    cv2.ellipse(frame, (reach - 120, 260), (120, 45), 0, 0, 360, (120, 150, 205), -1, cv2.LINE_AA)
    return frame


if __name__ == "__main__":
    sys.exit(main())

"""Pendulums whose markers have something drawn on them, from inspect to tracks by the proposed configuration alone.

    python benchmarks/marker_kinds.py [OUTPUT] [--frames 60]

Clips of 1000×1000 px with disks of 60 px and of 480×480 px with disks of 20 px at 38 Hz, compressed.  OUTPUT (default
results/marker_kinds) gets kinds.csv: share of the frames that are used, of those whose markers are all within 1 px the
share that is used, median error and the largest of a used frame, in px; or why a clip is refused.  Exit status 1 where
less than 95 % of a clip's right frames are used, or a used one is off by more than 1 px.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy

import cv2
import numpy as np
import pandas as pd
import yaml

ROOT = Path(__file__).resolve().parents[1]
sys.path.append(str(ROOT / "tests" / "recordings"))  # markers are drawn as its tests draw them

from drawn import MARKS, PAINT, draw, markers_of, write_video  # noqa: E402
from pendulum_motion import CONSTANTS, FRICTION  # noqa: E402

from expertaug.config import load as config  # noqa: E402
from expertaug.config import recording_settings  # noqa: E402
from expertaug.errors import InputError  # noqa: E402
from expertaug.files import atomic  # noqa: E402
from expertaug_recordings.inspection.inspect import inspect  # noqa: E402
from expertaug_recordings.markers.track import run_stage as track_markers  # noqa: E402
from expertaug_recordings.rendering.motion import simulate  # noqa: E402
from expertaug_recordings.video.frame_store import run_stage as extract_frames  # noqa: E402

RATE_HZ, SLOWER = 38.0, 0.55  # a pendulum that so few frames can follow
PLACES = ["pivot_x", "pivot_y", "joint_x", "joint_y", "tip_x", "tip_y"]
DARK, WHITE = (20, 20, 20), (240, 240, 240)
KINDS = {
    "nothing": None,
    **MARKS,
    "large text": (lambda a, b, r: MARKS["text"][0](a / 1.7, b / 1.7, r), DARK),
    "white ring": (lambda a, b, r: np.abs(np.hypot(a, b) - 0.5 * r) < 0.1 * r, WHITE),
    "ring near the rim": (lambda a, b, r: np.abs(np.hypot(a, b) - 0.75 * r) < 0.1 * r, DARK),
    "thick ring": (lambda a, b, r: np.abs(np.hypot(a, b) - 0.55 * r) < 0.2 * r, DARK),
    "dark rim": (lambda a, b, r: np.hypot(a, b) > 0.85 * r, DARK),
    "thick line": (lambda a, b, r: np.abs(a) < 0.25 * r, DARK),
    "cross": (lambda a, b, r: np.minimum(np.abs(a), np.abs(b)) < 0.12 * r, DARK),
}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("output", type=Path, nargs="?", default=Path("results/marker_kinds"))
    parser.add_argument("--frames", type=int, default=60)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    MARKS.update({name: mark for name, mark in KINDS.items() if mark is not None})
    rows = []
    for kind in KINDS:
        for side, diameter in ((1000, 60.0), (480, 20.0)):
            with tempfile.TemporaryDirectory() as folder:
                found = followed(Path(folder), "" if kind == "nothing" else kind, side, diameter, options.frames)
            rows.append({"drawn": kind, "side_px": side} | found)
            print(*rows[-1].values(), sep="  ", flush=True)
    table = pd.DataFrame(rows)
    options.output.mkdir(parents=True, exist_ok=True)
    with atomic(options.output / "kinds.csv") as path:
        table.to_csv(path, index=False)
    taken = table[table["refused"].isna()]
    return int(not ((taken["used_of_right"] >= 0.95) & (taken["largest_px"] <= 1)).all())


def followed(folder: Path, mark: str, side: int, diameter: float, count: int) -> dict[str, float | str]:
    """How a clip of disks with a mark is inspected and tracked."""
    y = simulate(np.array([[1.9, 1.2, 0.0, 0.0]]), np.arange(count) / RATE_HZ * SLOWER, CONSTANTS, FRICTION)[0]
    scale = side / 1000
    true = markers_of(y[:, :2], (500.3 * scale, 480.6 * scale), (225 * scale, 150 * scale))
    paint = [PAINT[name] for name in ("red", "green", "blue")]
    frames = draw(true, (side, side), paint, diameter, background=(60, 58, 55), mark=mark)
    video, store, table = folder / "clip.mp4", folder / "frames.b2frame", folder / "markers.csv"
    write_video(frames, video, RATE_HZ)
    try:
        proposed = yaml.safe_load(inspect(video, folder / "contact.png"))
        settings = config.load([ROOT / "config" / "config.yaml"])
        settings = config.validate(config.merge(settings, proposed | {"run": ["double_pendulum"]}))
        extract_frames(video, store, recording_settings.extract_frames(settings, "clip"))
        track_markers(store, table, recording_settings.track_markers(settings, "clip"))
    except InputError as error:
        return {"refused": str(error).replace(f"{folder}/", "")}
    seen = pd.read_csv(table)
    off = np.linalg.norm(seen[PLACES].to_numpy().reshape(-1, 3, 2) - true, axis=2)
    used, right = seen["quality"].to_numpy() > 0, (off < 1).all(axis=1)
    return {
        "refused": np.nan,
        "used": round(float(used.mean()), 3),
        "used_of_right": round(float(used[right].mean()), 3),
        "median_px": round(float(np.nanmedian(off)), 3),
        "largest_px": round(float(off[used].max()), 2),
    }


if __name__ == "__main__":
    sys.exit(main())

"""How exact the tracker is on rendered video that moves like the real recordings, and what injected faults do to it.

    python benchmarks/tracking_accuracy.py [OUTPUT] [--recordings FOLDER] [--frames 60] [--clips 20]

OUTPUT (default results/tracking_accuracy) gets accuracy.csv, faults.csv and faults.png.  Clips are the fastest turns of
every recording and its closest passages of the tip by the pivot, rendered from the real recordings' motion where they
are (--recordings, EXPERTAUG_RECORDINGS or ../shared/recordings) and from the simulator's.  Exit status 1 where a target
is missed: .08 px median, .25 px at the 99th percentile, angles .05° median, no identity swap, no lost marker.
"""

from __future__ import annotations

import argparse
import logging
import os
import sys
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy

import cv2
import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from clips import Motion, film, recorded, recordings_folder, simulated
from expertaug import plotting
from expertaug.files import atomic
from expertaug_recordings.markers.geometry import Geometry, estimate_geometry
from expertaug_recordings.markers.tracker import Track, track_frames
from expertaug_recordings.settings import TrackMarkersJob

TARGETS = {"median_px": 0.08, "p99_px": 0.25, "angle_deg": 0.05, "swaps": 0, "lost": 0}
RADIUS_PX = 12.5  # a marker found further than this from where it is, is another one
TIP, ALL = [2], [0, 1, 2]
DROP_EVERY = 20  # frames from one gap to the next; here no timestamps tell of them, by which reading refuses a file
COVERS = np.indices((480, 480), np.float32)[::-1]

# Fault → its unit, its levels, the markers whose error counts, and what it does to a clip.
FAULTS = {
    "motion blur": ("tip's way within the fastest exposure [px]", (0.7, 2, 4, 8, 12, 15, 18), ALL),
    "sensor noise": ("standard deviation at full white [levels]", (4, 8, 16, 32, 48, 64, 80, 96), ALL),
    "compression": ("constant rate factor of H.264", (18, 23, 28, 33, 38, 43, 48, 51), ALL),
    "illumination drift": ("light that is left", (1, 0.7, 0.5, 0.4, 0.35, 0.3, 0.25, 0.18), ALL),
    "frame drops": ("frames missing in a row", (0, 1, 2, 4, 8, 12, 16, 24), ALL),
    "partial occlusion": ("share of the tip's diameter that is covered", (0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6), TIP),
}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("output", type=Path, nargs="?", default=Path("results/tracking_accuracy"))
    parser.add_argument("--recordings", type=Path, help="folder of the real recordings' marker CSVs")
    parser.add_argument("--frames", type=int, default=60, help="of each of a recording's two clips")
    parser.add_argument("--clips", type=int, default=20, help="recordings of either kind, at most")
    parser.add_argument("--levels", type=int, default=8, help="of each fault, at most")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    logging.getLogger("expertaug_recordings").setLevel(logging.ERROR)
    folder = recordings_folder(options.recordings)
    if folder is None:
        print("the real recordings are not here (EXPERTAUG_RECORDINGS): simulated motion only")
    real = list(recorded(folder, options.clips)) if folder else []
    motions = [*real, *simulated(min(8, options.clips))]
    accuracy = pd.DataFrame([row for motion in motions for row in score_motion(motion, options.frames)])
    overall = accuracy.groupby("source").apply(summarise, include_groups=False).reset_index()
    fastest = max(motions, key=lambda motion: motion.step.max())
    print(overall.to_string(index=False))
    faults = inject(fastest.fastest(2 * options.frames), options.levels)
    options.output.mkdir(parents=True, exist_ok=True)
    for name, table in (("accuracy", accuracy.drop(columns=["errors", "angles"])), ("faults", faults)):
        with atomic(options.output / f"{name}.csv") as temporary:
            table.to_csv(temporary, index=False, float_format="%.4g")
    plot(faults, options.output / "faults.png")
    print(faults.to_string(index=False, float_format="%.3g"))
    missed = [f"{name} {value:.3g}" for name, limit in TARGETS.items() for value in overall[name] if value > limit]
    print("missed: " + ", ".join(missed) if missed else "every target is met")
    return 1 if missed else 0


def score_motion(motion: Motion, frames: int) -> list[dict]:
    """Rows of a recording's clips at the full rate, and of the first of them at a quarter of it."""
    rows = []
    for kind, clip in (("fastest", motion.fastest(frames)), ("closest", motion.nearest(frames))):
        images, truth = film(clip), clip.truth
        for every in (1, 4) if kind == "fastest" else (1,):
            row = {"source": motion.name.split()[0], "motion": motion.name, "clip": kind, "rate_hz": 400 / every}
            row["tip_px_a_frame"] = clip.step.max() * every
            row["nearest_px"] = np.linalg.norm(truth[:, 2] - truth[:, 0], axis=-1).min()
            rows.append(row | score(track(images[::every], clip), truth[::every]))
    return rows


def track(images: np.ndarray, clip: Motion) -> Track:
    """Track with lengths that are measured on the clip itself, as the stage does."""
    settings = TrackMarkersJob()
    geometry, _ = estimate_geometry(images[:: max(1, len(images) // settings.calibration_frames)], settings)
    return track_frames(images, geometry or Geometry(*clip.arms, 25.5), settings)


def score(found: Track, truth: np.ndarray, markers: list[int] = ALL) -> dict:
    """Errors in px of what is used, errors of the angles in degrees, and what went wrong."""
    used = found.quality > 0
    error = np.linalg.norm(found.position - truth, axis=-1)
    angles = [angle(found.position, k) - angle(truth, k) for k in (1, 2)]
    angles = np.abs(np.rad2deg(np.angle(np.exp(1j * np.stack(angles, axis=1)))))
    good = error[used][:, markers].ravel()
    return {
        "frames": len(truth),
        "flagged": float(1 - used.mean()),
        "lost": int(np.isnan(error).sum()),
        "swaps": int((error > RADIUS_PX).sum()),
        "median_px": float(np.median(good)) if len(good) else np.nan,
        "p99_px": float(np.percentile(good, 99)) if len(good) else np.nan,
        "largest_px": float(good.max()) if len(good) else np.nan,
        "angle_deg": float(np.median(angles[used])) if used.any() else np.nan,
        "errors": good,
        "angles": angles[used].ravel(),
    }


def angle(position: np.ndarray, k: int) -> np.ndarray:
    """Of the arm that ends in marker k, (n,) rad."""
    return np.arctan2(*(position[:, k] - position[:, k - 1]).T)


def summarise(rows: pd.DataFrame) -> pd.Series:
    """All clips of one source together."""
    errors, angles = np.concatenate(list(rows["errors"])), np.concatenate(list(rows["angles"]))
    return pd.Series(
        {
            "motions": rows["motion"].nunique(),
            "frames": rows["frames"].sum(),
            "fastest_px_a_frame": rows.loc[rows["rate_hz"] == 400, "tip_px_a_frame"].max(),
            "nearest_px": rows["nearest_px"].min(),
            "median_px": np.median(errors),
            "p99_px": np.percentile(errors, 99),
            "largest_px": errors.max(),
            "angle_deg": np.median(angles),
            "swaps": rows["swaps"].sum(),
            "lost": rows["lost"].sum(),
            "flagged": (rows["flagged"] * rows["frames"]).sum() / rows["frames"].sum(),
        }
    )


def inject(clip: Motion, levels: int) -> pd.DataFrame:
    """Scores of one clip at the levels of every fault."""
    rows = []
    for fault, (_, values, markers) in FAULTS.items():
        chosen = (
            values if len(values) <= levels else [values[k] for k in np.linspace(0, len(values) - 1, levels, dtype=int)]
        )
        for level in chosen:
            images, truth = spoil(clip, fault, level)
            scored = score(track(images, clip), truth, markers)
            rows.append(
                {"fault": fault, "level": level} | {k: v for k, v in scored.items() if k not in ("errors", "angles")}
            )
    return pd.DataFrame(rows)


def spoil(clip: Motion, fault: str, level: float) -> tuple[np.ndarray, np.ndarray]:
    """Frames of a clip with a fault, and where the markers are in them."""
    truth = clip.truth
    if fault == "motion blur":
        return film(clip, exposure_s=level / clip.step.max() / 400), truth
    if fault == "sensor noise":
        return film(clip, noise=level), truth
    if fault == "compression":
        return film(clip, crf=int(level)), truth
    if fault == "illumination drift":
        half = len(truth) // 2
        return film(clip, change=dimming(level, half))[half:], truth[half:]
    if fault == "frame drops":
        kept = np.arange(len(truth)) % (DROP_EVERY + int(level)) >= int(level)
        return film(clip)[kept], truth[kept]
    return film(clip, change=covering(level, truth[:, 2])), truth


def dimming(level: float, frames: int) -> Callable[[int, np.ndarray], np.ndarray]:
    """The light fades to ``level`` over so many frames, and grows redder on the way as that of a bulb does."""

    def change(k: int, frame: np.ndarray) -> np.ndarray:
        light = 1 + (level - 1) * min(1, k / frames)
        return np.rint(frame * np.array([light**1.15, light, light**0.85])).astype(np.uint8)

    return change


def covering(level: float, centres: np.ndarray) -> Callable[[int, np.ndarray], np.ndarray]:
    """Something dark lies over one side of a marker, another side in each frame."""

    def change(k: int, frame: np.ndarray) -> np.ndarray:
        x, y = (axis - middle for axis, middle in zip(COVERS, centres[k], strict=True))
        across = x * np.cos(0.7 * k) + y * np.sin(0.7 * k)
        inside = (np.hypot(x, y) < 1.3 * RADIUS_PX) & (across > RADIUS_PX * (1 - 2 * level))
        return np.where(inside[..., None], np.uint8(8), frame) if level else frame

    return change


def turning_point(rows: pd.DataFrame) -> float | None:
    """Level at which half of the frames are flagged."""
    level, flagged = rows["level"].to_numpy(float), rows["flagged"].to_numpy()
    over = np.flatnonzero(flagged >= 0.5)
    if not len(over):
        return None
    k = int(over[0])
    if k == 0:
        return float(level[0])
    share = (0.5 - flagged[k - 1]) / (flagged[k] - flagged[k - 1])
    return float(level[k - 1] + share * (level[k] - level[k - 1]))


def plot(faults: pd.DataFrame, output: Path) -> None:
    """Error of the frames that are used, and the share of frames that are not, against the level of each fault."""
    with plotting.use_style():
        figure = Figure(figsize=(9.0, 5.2), layout="constrained")
        FigureCanvasAgg(figure)
        for axis, (fault, (unit, _, _)) in zip(figure.subplots(2, 3).flat, FAULTS.items(), strict=True):
            rows = faults[faults["fault"] == fault]
            share = axis.twinx()
            share.fill_between(rows["level"], 100 * rows["flagged"], color="0.85", linewidth=0)
            share.set_ylim(0, 105)
            share.spines["right"].set_visible(True)
            axis.set_zorder(share.get_zorder() + 1)
            axis.patch.set_visible(False)
            for column, colour, mark in (("median_px", "#0072B2", "o"), ("p99_px", "#D55E00", "s")):
                axis.plot(rows["level"], rows[column], color=colour, marker=mark, markersize=3, linewidth=1.2)
                axis.axhline(TARGETS[column], color=colour, linewidth=0.6, linestyle=":")
            turn = turning_point(rows)
            if turn is not None:
                axis.axvline(turn, color="black", linewidth=0.8, linestyle="--")
            axis.set(yscale="log", ylim=(0.02, 1), xlabel=unit)
            axis.set_yticks([0.02, 0.05, 0.1, 0.2, 0.5, 1], ["0.02", "0.05", "0.1", "0.2", "0.5", "1"])
            most = rows["flagged"].max()
            shown = f"at most {most:.0%} flagged" if most else "none flagged"
            axis.set_title(f"{fault}: {shown if turn is None else f'half flagged at {turn:.2g}'}")
            if fault == "illumination drift":
                axis.invert_xaxis()
            axis.set_ylabel("error of used frames [px]")
            share.set_ylabel("frames flagged [%]", color="0.45")
        lines = [
            mpl.lines.Line2D([], [], color="#0072B2", marker="o", markersize=3, label="median"),
            mpl.lines.Line2D([], [], color="#D55E00", marker="s", markersize=3, label="99th percentile"),
            mpl.lines.Line2D([], [], color="0.4", linewidth=0.6, linestyle=":", label="target"),
            mpl.patches.Patch(color="0.85", label="frames flagged"),
            mpl.lines.Line2D([], [], color="black", linewidth=0.8, linestyle="--", label="half of the frames flagged"),
        ]
        figure.legend(handles=lines, loc="outside lower center", ncols=5)
        with atomic(output) as temporary:
            figure.savefig(temporary, dpi=200)


if __name__ == "__main__":
    sys.exit(main())

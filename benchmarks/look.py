"""How the rendered video compares with the one published real frame, side by side.

    python benchmarks/look.py [OUTPUT] [--recordings FOLDER]

Needs frame.png of the real recordings (--recordings, EXPERTAUG_RECORDINGS or ../shared/recordings).  The pendulum is
rendered in the pose that the tracker finds there, compressed as video, and both are measured alike.  OUTPUT (default
results/look, which Git ignores: the figure shows the real frame) gets look.png and look.csv.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
import tempfile
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy

import cv2
import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from clips import recordings_folder
from expertaug import plotting
from expertaug.files import atomic
from expertaug_recordings.markers.geometry import Geometry, estimate_geometry
from expertaug_recordings.markers.tracker import track_frames
from expertaug_recordings.rendering.render import RenderVideoJob
from expertaug_recordings.rendering.scene import Pose, Scene
from expertaug_recordings.settings import TrackMarkersJob
from expertaug_recordings.video.writer import encode

CHANNELS = (("blue", "#0072B2"), ("green", "#009E73"), ("red", "#D55E00"))
MARKERS = ("red", "green", "blue")
SIDE = 480
FRAMES = 12  # before and after the one that is compared, so that it is compressed like any other


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("output", type=Path, nargs="?", default=Path("results/look"))
    parser.add_argument("--recordings", type=Path, help="folder with the real frame.png")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    folder = recordings_folder(options.recordings)
    real = cv2.imread(str(folder / "frame.png")) if folder else None
    if real is None:
        print("no frame.png of the real recordings (EXPERTAUG_RECORDINGS)", file=sys.stderr)
        return 2
    settings = TrackMarkersJob()
    geometry, _ = estimate_geometry([real], settings)
    centres = track_frames([real], geometry, settings).position[0]
    rendered = render(centres, geometry)
    table = pd.DataFrame([measure(image, centres, name) for name, image in (("real", real), ("rendered", rendered))])
    options.output.mkdir(parents=True, exist_ok=True)
    with atomic(options.output / "look.csv") as temporary:
        table.set_index("frame").T.to_csv(temporary, float_format="%.4g")
    print(table.set_index("frame").T.to_string(float_format="%.3g"))
    plot(real, rendered, centres, options.output / "look.png")
    return 0


def render(centres: np.ndarray, geometry: Geometry) -> np.ndarray:
    """One frame of a compressed video in which the pendulum rests in this pose."""
    known = RenderVideoJob()
    angles = [math.atan2(*(centres[k + 1] - centres[k])) for k in (0, 1)]
    pose = Pose(*(tuple(map(float, centre)) for centre in centres), *angles)
    scene = Scene(SIDE, pose.pivot, (geometry.arm1, geometry.arm2), known.noise, np.random.default_rng(0))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "clip.mp4"
        encode(path, (scene.frame([pose]) for _ in range(2 * FRAMES)), SIDE, 400, crf=known.crf, speed=known.preset)
        video = cv2.VideoCapture(str(path))
        return [video.read()[1] for _ in range(2 * FRAMES)][FRAMES]


def measure(image: np.ndarray, centres: np.ndarray, name: str) -> dict[str, object]:
    """Numbers of a frame: overall brightness, tints, steepness of the rims, noise."""
    brightest = image.max(axis=2)
    row = {"frame": name, "black [%]": 100 * (brightest == 0).mean(), "over 50 [%]": 100 * (brightest > 50).mean()}
    row |= {f"mean {c}": value for (c, _), value in zip(CHANNELS, image.mean(axis=(0, 1)), strict=True)}
    for marker, centre in zip(MARKERS, centres, strict=True):
        for sector, colour in tints(image, centre).items():
            row |= {f"{marker} marker, {sector}, {c}": v for (c, _), v in zip(CHANNELS, colour, strict=True)}
        distance, profile = rim(image, centre)
        for (c, _), values in zip(CHANNELS, profile.T, strict=True):
            row[f"{marker} marker, rim, {c} [levels/px]"] = -np.gradient(values, distance).min()
        row[f"{marker} marker, noise [levels]"] = noise(image, centre)
    return row


def polar(image: np.ndarray, centre: np.ndarray, radii: np.ndarray) -> np.ndarray:
    """Colours on rays from a centre, (rays, radii, 3)."""
    angle = np.arange(0, 2 * np.pi, np.pi / 180)[:, None]
    x, y = centre[0] + radii * np.cos(angle), centre[1] + radii * np.sin(angle)
    return cv2.remap(image.astype(np.float32), x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR)


def tints(image: np.ndarray, centre: np.ndarray) -> dict[str, np.ndarray]:
    """Median colours (B, G, R) of a marker's white and coloured sectors."""
    rays = polar(image, centre, np.arange(4, 10, 0.5))
    level = rays.mean(axis=(1, 2))
    third = len(level) // 3
    order = np.argsort(level)
    parts = {"white": order[-third:], "coloured": order[:third]}
    return {name: np.median(rays[chosen], axis=(0, 1)) for name, chosen in parts.items()}


def rim(image: np.ndarray, centre: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance (n,) in px from the centre, and the mean colour (n, 3) there on the rays through white sectors."""
    distance = np.arange(8, 18, 0.25)
    rays = polar(image, centre, distance)
    level = rays[:, :8].mean(axis=(1, 2))
    return distance, rays[np.argsort(level)[-len(level) // 3 :]].mean(axis=0)


def noise(image: np.ndarray, centre: np.ndarray) -> float:
    """Standard deviation of what is finer than 1.2 px inside a marker's sectors, in levels."""
    x, y = np.round(centre).astype(int)
    part = image[y - 10 : y + 11, x - 10 : x + 11].astype(np.float32)
    fine = part - cv2.GaussianBlur(part, (0, 0), 1.2)
    level = part.max(axis=2)
    even = cv2.dilate(level, np.ones((5, 5))) - cv2.erode(level, np.ones((5, 5))) < 40  # not across two sectors
    return float(fine[even].std())


def plot(real: np.ndarray, rendered: np.ndarray, centres: np.ndarray, output: Path) -> None:
    """Both frames, their histograms, rims and tints."""
    images = {"real": real, "rendered": rendered}
    with plotting.use_style():
        figure = Figure(figsize=(11, 6.6), layout="constrained")
        FigureCanvasAgg(figure)
        above, below = figure.subfigures(2, 1, height_ratios=(1.1, 1))
        axes = above.subplots(1, 4, width_ratios=(1, 1, 0.6, 0.6))
        (x0, y0), (x1, y1) = ((f(centres, axis=0) + d).astype(int) for f, d in ((np.min, -28), (np.max, 28)))
        for k, (name, image) in enumerate(images.items()):
            for axis, part, title in ((axes[k], image, name), (axes[k + 2], image[y0:y1, x0:x1], f"{name}, part")):
                axis.imshow(part[..., ::-1], interpolation="nearest")
                axis.set_title(title)
                axis.axis("off")
        left, middle, right = below.subplots(1, 3)
        for (name, image), style in zip(images.items(), ("-", "--"), strict=True):
            for c, (channel, colour) in enumerate(CHANNELS):
                density = np.histogram(image[..., c], bins=np.arange(0, 257, 8))[0] / image[..., c].size
                left.stairs(density, np.arange(0, 257, 8), color=colour, linestyle=style, label=f"{channel}, {name}")
                for k, centre in enumerate(centres):
                    distance, profile = rim(image, centre)
                    middle.plot(distance + 12 * k, profile[:, c], color=colour, linestyle=style, linewidth=1)
        left.set(yscale="log", xlabel="level", ylabel="share of pixels", title="histograms")
        left.legend(fontsize=7)
        middle.set(xlabel="distance from the red, green and blue marker's centre", ylabel="level", title="white rims")
        middle.set_xticks([8 + 12 * k + d for k in range(3) for d in (0, 5)], ["8", "13"] * 3)
        for row, image in enumerate(images.values()):
            for k, centre in enumerate(centres):
                for part, colour in enumerate(tints(image, centre).values()):
                    where = (2 * k + part, 1 - row)
                    right.add_patch(mpl.patches.Rectangle(where, 1, 1, color=tuple(colour[::-1] / 255)))
                    text = "\n".join(f"{v:.0f}" for v in colour[::-1])
                    right.text(where[0] + 0.5, where[1] + 0.5, text, ha="center", va="center", fontsize=7)
        right.set(xlim=(0, 6), ylim=(0, 2), xticks=[1, 3, 5], title="tints (R, G, B)")
        right.set_xticklabels([f"{marker} marker" for marker in MARKERS])
        right.set_yticks([1.5, 0.5], list(images))
        with atomic(output) as temporary:
            figure.savefig(temporary, dpi=150)


if __name__ == "__main__":
    sys.exit(main())

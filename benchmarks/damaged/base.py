"""Small sound recordings, of which damaged ones are made: videos in several containers, a marker CSV, archives."""

from __future__ import annotations

import gzip
import io
import tarfile
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import av
import numpy as np

from expertaug_recordings.rendering.render import poses
from expertaug_recordings.rendering.scene import Scene
from expertaug_recordings.video.writer import encode

REFUSED, EITHER = "refused", "either"  # EITHER: read as it was, or refused
FRAMES, SIZE, RATE = 24, 96, 400
PIVOT, ARMS = (48.0, 48.0), (20.0, 12.0)
ROWS = 60


@dataclass(frozen=True)
class Case:
    """A file to read.

    Attributes:
        kind: ``video``, ``markers`` or ``archive``.
        base: name of the sound file that it was made from; empty where there is none.
        suffix: of the file's name.
        expected: ``refused``, or ``either``: then what is read must be what the sound file holds.
    """

    name: str
    kind: str
    base: str
    suffix: str
    data: bytes
    expected: str = REFUSED


def sound(folder: Path) -> dict[str, Case]:
    """Sound files by name: videos in several containers, a marker CSV, archives of it."""
    scene = Scene(SIZE, PIVOT, ARMS, 4.0, np.random.default_rng(0))
    angles = np.arange(FRAMES)[:, None] * (0.1, 0.2)
    states = np.concatenate((angles, np.full((FRAMES, 2), (0.1 * RATE, 0.2 * RATE))), axis=1)
    images = [scene.frame(poses(state, PIVOT, ARMS, 90e-6)) for state in states]
    path = folder / "base.mp4"
    encode(path, iter(images), SIZE, RATE)
    files = {"mp4": path.read_bytes()}
    for name, suffix, options in (
        ("faststart", ".mp4", {"movflags": "+faststart"}),
        ("fragments", ".mp4", {"movflags": "+frag_keyframe+empty_moov", "frag_duration": "10000"}),
        ("mkv", ".mkv", {}),
        ("mov", ".mov", {}),
    ):
        files[name] = _remuxed(path, folder / f"{name}{suffix}", options)
    files["mjpeg"] = _motion_jpeg(folder / "mjpeg.avi", images)
    suffixes = {"mkv": ".mkv", "mov": ".mov", "mjpeg": ".avi"}
    cases = {name: Case(name, "video", name, suffixes.get(name, ".mp4"), data, EITHER) for name, data in files.items()}
    table = marker_rows()
    cases["csv"] = Case("csv", "markers", "csv", ".csv", table, EITHER)
    members = {"original/dpc_dataset_csv/0.csv": table, "original/dpc_dataset_csv/1.csv": table[: len(table) // 2 + 1]}
    for name, data in (("tar", tar_of(members)), ("zip", zip_of(members))):
        cases[name] = Case(name, "archive", name, ".zip" if name == "zip" else ".tar.gz", data, EITHER)
    return cases


def marker_rows() -> bytes:
    """A marker CSV of the IBM layout, ROWS rows."""
    theta = np.arange(ROWS)[:, None] * (0.02, 0.05)
    red = np.tile([240.0, 238.0], (ROWS, 1))
    green = red + 118 * np.stack([np.cos(theta[:, 0]), np.sin(theta[:, 0])], axis=1)
    blue = green + 90 * np.stack([np.cos(theta[:, 1]), np.sin(theta[:, 1])], axis=1)
    rows = (np.concatenate((red, green, blue), axis=1) * 5 + 2).round().astype(int)
    return "".join(",".join(map(str, row)) + "\n" for row in rows).encode()


def tar_of(members: dict[str, bytes], change: Callable[[tarfile.TarInfo], None] | None = None) -> bytes:
    """A .tar.gz of members; ``change`` may alter each header."""
    out = io.BytesIO()
    with gzip.GzipFile(fileobj=out, mode="wb", mtime=0) as packed, tarfile.open(fileobj=packed, mode="w") as tar:
        for name, data in members.items():
            info = tarfile.TarInfo(name)
            info.size = len(data)
            if change:
                change(info)
            tar.addfile(info, io.BytesIO(data))
    return out.getvalue()


def zip_of(members: dict[str, bytes], mode: int = 0o100644) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as pack:
        for name, data in members.items():
            info = zipfile.ZipInfo(name)
            info.external_attr, info.compress_type = mode << 16, zipfile.ZIP_DEFLATED
            pack.writestr(info, data)
    return out.getvalue()


def _remuxed(source: Path, target: Path, options: dict[str, str]) -> bytes:
    with av.open(str(source)) as given, av.open(str(target), "w", options={"fflags": "+bitexact", **options}) as made:
        stream = made.add_stream_from_template(given.streams.video[0])
        for packet in given.demux(video=0):
            if packet.dts is not None:
                packet.stream = stream
                made.mux(packet)
    return target.read_bytes()


def _motion_jpeg(path: Path, images: list[np.ndarray]) -> bytes:
    with av.open(str(path), "w", options={"fflags": "+bitexact"}) as container:
        stream = container.add_stream("mjpeg", rate=RATE, options={"qscale": "2"})
        stream.width, stream.height, stream.pix_fmt = SIZE, SIZE, "yuvj420p"
        stream.codec_context.thread_count = 1
        for image in images:
            for packet in stream.encode(av.VideoFrame.from_ndarray(image, format="bgr24")):
                container.mux(packet)
        for packet in stream.encode():
            container.mux(packet)
    return path.read_bytes()

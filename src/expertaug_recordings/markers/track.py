"""From a frame store to marker positions: measure the lengths, follow the markers, refuse what shows none."""

from __future__ import annotations

import csv
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from expertaug.errors import InputError
from expertaug.files import atomic
from expertaug_recordings.markers.blending import find_blended
from expertaug_recordings.markers.geometry import Geometry, estimate_geometry, measure_diameter
from expertaug_recordings.markers.tracker import UNUSABLE, Track, track_frames
from expertaug_recordings.settings import TrackMarkersJob
from expertaug_recordings.tables import BLENDED, MARKERS
from expertaug_recordings.video.frame_store import FrameStore
from expertaug_recordings.video.pixel_layout import KeptFrame

Polygon = Sequence[tuple[float, float]]
FRACTION = 4  # bits of a px to which corners are drawn
MAY_BE_BLENDED = ("", "edge", "residual")  # reasons that this one takes the place of
DIAMETER_FRAMES = 12  # on which an unknown diameter is measured


class MaskedFrames:
    """The frames of a store, black where nothing is to be seen.

    Arguments:
        frames: the store.
        masks: polygons by their corners (x, y) in px; two are opposite corners of a rectangle.
    """

    def __init__(self, frames: FrameStore, masks: Sequence[Polygon]) -> None:
        self._frames = frames
        self.t = frames.t
        self._polygons = [_corners(mask) for mask in masks]

    def __len__(self) -> int:
        return len(self._frames)

    def __getitem__(self, index: int) -> np.ndarray:
        return self._hide(self._frames[index])

    def __iter__(self) -> Iterator[np.ndarray | KeptFrame]:
        return map(self._hide, self._frames) if self._polygons else self._frames.kept()

    def _hide(self, image: np.ndarray) -> np.ndarray:
        """Of an image in memory of its own."""
        if self._polygons:
            cv2.fillPoly(image, self._polygons, (0, 0, 0), cv2.LINE_8, FRACTION)
        return image


def _corners(mask: Polygon) -> np.ndarray:
    """Corners (k, 2) as OpenCV takes them."""
    points = np.array(mask, float)
    if len(points) == 2:
        (left, top), (right, bottom) = points
        points = np.array([(left, top), (right, top), (right, bottom), (left, bottom)])
    return np.rint(points * 2**FRACTION).astype(np.int32)


def run_stage(store: str | Path, output: str | Path, job: TrackMarkersJob) -> Track:
    """Stage: track the markers of a frame store and write ``markers.csv``.

    Arguments:
        store: frame store of one recording, evenly timed.
        output: CSV with one row a frame: frame, t (s), x and y of the markers (px from the centre of the top-left
            pixel, y down; empty where lost), quality, reason (:class:`~expertaug_recordings.markers.tracker.Track`).
        job: how they look, and tolerances.

    Returns:
        What was written.

    Raises:
        InputError: a setting is wrong, or the video shows no markers or is unusable in too many frames.
    """
    frames = FrameStore(store)
    track = track_markers(frames, job)
    _write(output, np.asarray(frames.t), track)
    return track


def track_markers(store: FrameStore, job: TrackMarkersJob) -> Track:
    """Track the markers of the frames of a recording.

    Arguments:
        store: evenly timed frames, which are read one after the other.
        job: how the markers look, and tolerances.

    Raises:
        InputError: a setting is wrong, or the video shows no markers or is unusable in too many frames.
    """
    cv2.setNumThreads(1)
    frames = MaskedFrames(store, job.masks)
    job, geometry = _calibrate(store.path, frames, job)
    track = track_frames(frames, geometry, job)
    track = _with_blended(track, find_blended(frames, track.position, geometry.diameter))
    _refuse_lost(store.path, track, job)
    return track


def _with_blended(track: Track, blended: np.ndarray) -> Track:
    """The same with frames (n,) that are mixtures of two called so, and doubted."""
    doubted = blended & np.isin(track.reason, MAY_BE_BLENDED)
    reason = [BLENDED if mixed else reason for mixed, reason in zip(doubted, track.reason, strict=True)]
    return replace(track, quality=np.where(doubted, track.quality / 2, track.quality), reason=reason)


def _calibrate(store: Path, frames: MaskedFrames, settings: TrackMarkersJob) -> tuple[TrackMarkersJob, Geometry]:
    """Settings with a diameter, and lengths from frames spread over the store; arm lengths that the settings give are
    taken from there."""
    if settings.marker_diameter_px is None:
        some = [frames[int(i)] for i in _spread(len(frames), DIAMETER_FRAMES)]
        diameter = measure_diameter(some, settings)
        if diameter is None:
            raise _no_markers(store, f"of {len(some)} frames looked at, none shows a marker", settings)
        settings = settings.model_copy(update={"marker_diameter_px": diameter})
    chosen = _spread(len(frames), settings.calibration_frames)
    try:
        geometry, counts = estimate_geometry((frames[int(i)] for i in chosen), settings)
    except InputError as error:
        raise InputError(store, str(error)) from error
    if geometry is None:
        appearance = settings.appearance
        seen = ", ".join(f"{name} in {counts[name]}" for name in appearance.seen)
        wanted = {1: "it", 2: "both", 3: "all three"}[len(appearance.seen)]
        whole = f"of {counts['frames']} frames looked at, {counts['all']} show {wanted} ({seen})"
        raise _no_markers(store, whole, settings)
    configured = (settings.arm1_px, settings.arm2_px)
    arms = [
        own if own is not None else seen for own, seen in zip(configured, (geometry.arm1, geometry.arm2), strict=True)
    ]
    return settings, replace(geometry, arm1=arms[0], arm2=arms[1])


def _spread(count: int, wanted: float) -> np.ndarray:
    return np.unique(np.linspace(0, count - 1, int(wanted)).round().astype(int))


def _no_markers(store: Path, problem: str, settings: TrackMarkersJob) -> InputError:
    appearance = settings.appearance
    size = "" if settings.marker_diameter_px is None else f" of {settings.marker_diameter_px:g} px (marker_diameter_px)"
    colours = " and ".join(filter(None, (", ".join(appearance.seen[:-1]), appearance.seen[-1])))
    kind = "quadrant disks" if appearance.style == "quadrant" else "disks"
    remedy = (
        f"show {colours} {kind}{size}, or say how yours look (recordings.tracking.markers; expertaug inspect-video)"
    )
    return InputError(store, f"no markers: {problem}", remedy)


def _refuse_lost(store: Path, track: Track, settings: TrackMarkersJob) -> None:
    unusable = track.quality == UNUSABLE
    if unusable.mean() <= settings.max_lost_share:
        return
    reasons = Counter(reason for reason, bad in zip(track.reason, unusable, strict=True) if bad).most_common(4)
    raise InputError(
        store,
        f"{unusable.sum()} of {len(unusable)} frames are unusable ({', '.join(f'{r} in {n}' for r, n in reasons)})",
        f"at most a share of {settings.max_lost_share:g} may be (max_lost_share)",
    )


def _write(output: str | Path, t: np.ndarray, track: Track) -> None:
    with atomic(output) as temporary, temporary.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(MARKERS)
        for i, place in enumerate(track.position.reshape(-1, 6).tolist()):
            values = ["" if math.isnan(v) else f"{v:.4f}" for v in place]
            writer.writerow([i, f"{t[i]:.9g}", *values, f"{track.quality[i]:.4f}", track.reason[i]])

"""From a frame store to marker positions: measure the lengths, follow the markers, refuse what shows none."""

from __future__ import annotations

import csv
import math
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from expertaug.errors import InputError
from expertaug.files import atomic
from expertaug.recordings.disks import NAMES
from expertaug.recordings.frames import FrameStore
from expertaug.recordings.tracker import UNUSABLE, Geometry, Track, TrackSettings, estimate_geometry, track_frames

COLUMNS = ("frame", "t", *(f"{name}_{axis}" for name in NAMES for axis in "xy"), "quality", "reason")


def track_markers(store: str | Path, output: str | Path, settings: Mapping[str, object] | None = None) -> Track:
    """Track the markers of a frame store and write ``markers.csv``.

    Arguments:
        store: frame store of one recording, evenly timed.
        output: CSV with one row a frame: frame, t (s), x and y of the markers (px from the centre of the top-left
            pixel, y down; empty where lost), quality, reason (:class:`~expertaug.recordings.tracker.Track`).
        settings: keys of :class:`~expertaug.recordings.tracker.TrackSettings`.

    Returns:
        What was written.

    Raises:
        InputError: a setting is wrong, or the video shows no markers or is unusable in too many frames.
    """
    checked = TrackSettings.from_mapping(settings)
    frames = FrameStore.open(store)
    geometry = _calibrate(store, frames, checked)
    track = track_frames(frames, geometry, checked)
    _refuse_lost(store, track, checked)
    _write(output, np.asarray(frames.t), track)
    return track


def _calibrate(store: str | Path, frames: FrameStore, settings: TrackSettings) -> Geometry:
    """Lengths from frames spread over the store; arm lengths that the settings give are taken from there."""
    chosen = np.unique(np.linspace(0, len(frames) - 1, settings.calibration_frames).round().astype(int))
    geometry, found = estimate_geometry((frames[int(i)] for i in chosen), settings)
    if geometry is None:
        seen = ", ".join(f"{name} in {found[name]}" for name in NAMES)
        raise InputError(
            store,
            f"no markers: of {found['frames']} frames looked at, {found['all']} show all three ({seen})",
            f"show red, green and blue quadrant disks of {settings.marker_diameter_px:g} px (marker_diameter_px)",
        )
    given = (settings.arm1_px, settings.arm2_px)
    arms = [own if own is not None else seen for own, seen in zip(given, (geometry.arm1, geometry.arm2), strict=True)]
    return Geometry(*arms, geometry.diameter)


def _refuse_lost(store: str | Path, track: Track, settings: TrackSettings) -> None:
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
        writer.writerow(COLUMNS)
        for i, place in enumerate(track.position.reshape(-1, 6).tolist()):
            values = ["" if math.isnan(v) else f"{v:.4f}" for v in place]
            writer.writerow([i, f"{t[i]:.9g}", *values, f"{track.quality[i]:.4f}", track.reason[i]])

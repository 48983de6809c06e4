"""What a video shows: frames spread over it, its markers, and the settings that track them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from expertaug.errors import InputError
from expertaug_recordings.angles.ellipse import View
from expertaug_recordings.angles.tilt import Gravity
from expertaug_recordings.inspection import proposal
from expertaug_recordings.inspection.detect import Pendulum, Spot, look_for_pendulum
from expertaug_recordings.inspection.gravity import told_by_motion
from expertaug_recordings.markers.geometry import Geometry, estimate_geometry
from expertaug_recordings.settings import StatedTimes, TrackMarkersJob
from expertaug_recordings.video.source import open_frames

FRAMES, MEMORY = 24, 2**28  # frames that are looked at, and bytes that they may take
SHOWN = 6  # frames on the contact sheet
MIN_SHARE = 0.5  # of the frames in which the tracker must find all markers with what is proposed


@dataclass(frozen=True)
class Footage:
    """Frames (H, W, 3) spread over a video with their numbers, what the file says of itself (times (n,) in s of its
    frames where they are uneven), and what its user does."""

    path: Path
    frames: list[np.ndarray]
    numbers: list[int]
    rate_hz: float
    count: int
    times: np.ndarray | None
    stated: StatedTimes

    @property
    def facts(self) -> str:
        height, width = self.frames[0].shape[:2]
        seconds = self.count / self.rate_hz
        times = " (variable)" if self.times is not None else ""
        return f"{width}x{height} px, {self.rate_hz:.6g} Hz{times}, {self.count} frames, {seconds:.2f} s"


@dataclass(frozen=True)
class Look:
    """What was seen of a video.

    Attributes:
        footage: its frames.
        spots: round coloured things by style.
        found: its pendulum; None where there is none.
        tracking: keys of the configuration that are proposed.
        gravity: its direction in the image; None where the motion does not tell it.
        view: of a camera that looks askew; None where it is not worth correcting.
        geometry: lengths with these; None where they find too little.
        counts: frames in which each marker and all are found.
        refusal: why nothing can be proposed; empty otherwise.
    """

    footage: Footage
    spots: Mapping[str, Sequence[Spot]]
    found: Pendulum | None = None
    tracking: Mapping[str, object] = field(default_factory=dict)
    gravity: Gravity | None = None
    geometry: Geometry | None = None
    counts: Counter = field(default_factory=Counter)
    refusal: str = ""
    view: View | None = None


def look_at(video: Path, stated: StatedTimes) -> Look:
    """Look for a pendulum's markers.

    Raises:
        InputError: the video cannot be used.
    """
    footage = _read(video, stated)
    found, spots = look_for_pendulum(footage.frames)
    if found is None:
        return Look(footage, spots, refusal=_missing(spots, len(footage.frames)))
    tracking, geometry, counts = _best_proposal(footage.frames, proposal.tracking(found))
    if geometry is None or counts["all"] < MIN_SHARE * counts["frames"]:
        refusal = f"its markers are all found in {counts['all']} of {counts['frames']} frames only"
        return Look(footage, spots, found, tracking, None, geometry, counts, refusal)
    gravity, view = told_by_motion(video, stated, footage.times, geometry, TrackMarkersJob.from_mapping(tracking))
    return Look(footage, spots, found, tracking, gravity, geometry, counts, view=view)


def count_with(frames: Sequence[np.ndarray], tracking: Mapping[str, object]) -> int:
    """Frames in which the tracker finds all markers with these settings."""
    return _best_proposal(frames, [tracking])[2]["all"]


def _read(path: Path, stated: StatedTimes) -> Footage:
    """All of the video is decoded, since only that tells whether it is sound and when its frames were taken."""
    with open_frames(path, stated) as video:
        wanted = max(SHOWN, min(FRAMES, MEMORY // (video.width * video.height * 3)))
        step = max(1, video.count // wanted)
        kept = [(number, image.copy()) for number, image in video.frames(step)][:wanted]
        if not kept:
            raise InputError(path, "has no frames", "copy the recording again")
        frames, numbers = [f for _, f in kept], [n for n, _ in kept]
        return Footage(path, frames, numbers, video.rate_hz, video.count, video.times, stated)


def _best_proposal(
    frames: Sequence[np.ndarray], proposals: Sequence[Mapping]
) -> tuple[Mapping, Geometry | None, Counter]:
    """The settings with which the tracker finds all markers in the most frames, the first of equals."""
    tried = []
    for one in proposals:
        try:
            tried.append((one, *estimate_geometry(frames, TrackMarkersJob.from_mapping(one))))
        except InputError:  # the tracker sees too little of the joint to find the pivot
            tried.append((one, None, Counter(frames=len(frames))))
    return max(tried, key=lambda one: one[2]["all"])


def _missing(spots: Mapping[str, Sequence[Spot]], frames: int) -> str:
    """Why no pendulum was found."""
    many = Counter({style: len({s.frame for s in seen}) for style, seen in spots.items()})
    style, seen = many.most_common(1)[0]
    if not seen:
        return f"no round coloured markers in {frames} frames"
    hues = sorted({round(s.colour[0] / 20) * 20 % 360 for s in spots[style]})
    listed = ", ".join(f"{hue}°" for hue in hues[:8])
    return (
        f"round {style}s of hues near {listed} in {seen} of {frames} frames, but no two or three of different colours"
        " that keep their distances while they swing about a fixed point"
    )

"""What a video shows, and the configuration that would track it."""

from __future__ import annotations

import glob
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import yaml

from expertaug.errors import InputError
from expertaug.files import atomic
from expertaug.recordings.angles.tilt import Gravity
from expertaug.recordings.inspection import proposal
from expertaug.recordings.inspection.detect import Spot, look_for_pendulum
from expertaug.recordings.inspection.gravity import gravity_in
from expertaug.recordings.markers.appearance import ROLES
from expertaug.recordings.markers.geometry import Geometry, best, estimate_geometry
from expertaug.recordings.markers.plain_disks import fitter
from expertaug.recordings.markers.settings import TrackSettings
from expertaug.recordings.names import printable
from expertaug.recordings.reports import drawing
from expertaug.recordings.video.reader import Video

FRAMES, MEMORY = 24, 2**28  # frames that are looked at, and bytes that they may take
SHOWN, SHOWN_WIDTH = 6, 480  # frames on the contact sheet, and their width in px
MIN_SHARE = 0.5  # of the frames in which the tracker must find all markers with what is proposed


@dataclass(frozen=True)
class Footage:
    """Frames (H, W, 3) spread over a video with their numbers, and what the file says of itself."""

    path: Path
    frames: list[np.ndarray]
    numbers: list[int]
    rate_hz: float
    count: int

    @property
    def facts(self) -> str:
        height, width = self.frames[0].shape[:2]
        seconds = self.count / self.rate_hz
        return f"{width}x{height} px, {self.rate_hz:.6g} Hz, {self.count} frames, {seconds:.2f} s"


def inspect(video: str | Path, sheet: str | Path, base: Mapping | None = None, rate_hz: float | None = None) -> str:
    """Look for a pendulum's markers in a video and propose the configuration that tracks them.

    Arguments:
        video: a file as :class:`~expertaug.recordings.video.reader.Video` takes.
        sheet: contact sheet to write, .png or .jpg: some frames with what was seen on them.
        base: configuration to which the proposal will be added (completed): the chunks of its
            experiments on recordings are fitted to the video's rate; None leaves them out.
        rate_hz: frame rate of the video; None takes the file's own.

    Returns:
        YAML text.

    Raises:
        InputError: the video cannot be used, shows no markers or none that move like a pendulum's; the contact sheet is
            written all the same where there are frames.
    """
    cv2.setNumThreads(1)
    if Path(sheet).suffix.lower() not in (".png", ".jpg", ".jpeg"):
        raise InputError(sheet, f"suffix '{Path(sheet).suffix}'", "a contact sheet is .png or .jpg")
    footage = _read(Path(video), rate_hz)
    found, spots = look_for_pendulum(footage.frames)
    if found is None:
        seen = max(spots.values(), key=len)
        _write_sheet(
            sheet, footage, [_with_spots(f, k, seen) for k, f in enumerate(footage.frames)], "no pendulum seen"
        )
        raise InputError(video, _missing(spots, len(footage.frames)), f"{sheet} shows what was seen")
    proposed, geometry, counts = _best_proposal(footage.frames, proposal.tracking(found))
    settings = TrackSettings.from_mapping(proposed)
    tracked = geometry is not None and counts["all"] >= MIN_SHARE * counts["frames"]
    gravity = gravity_in(footage.path, rate_hz, geometry, settings) if tracked else None
    caption = _caption(settings, geometry)
    _write_sheet(sheet, footage, [_with_pendulum(f, settings, geometry, gravity) for f in footage.frames], caption)
    if not tracked:
        raise InputError(
            video, f"its markers are all found in {counts['all']} of {counts['frames']} frames only", f"see {sheet}"
        )
    return _yaml(footage, proposed, gravity, counts, caption, base, rate_hz)


def _read(path: Path, rate_hz: float | None) -> Footage:
    """All of the video is decoded, since only that tells whether it is sound and evenly timed."""
    with Video(path, rate_hz) as video:
        wanted = max(SHOWN, min(FRAMES, MEMORY // (video.width * video.height * 3)))
        step = max(1, video.count // wanted)
        kept = [(number, image.copy()) for number, image in video.frames(step)][:wanted]
        if not kept:
            raise InputError(path, "has no frames", "copy the recording again")
        return Footage(path, [f for _, f in kept], [n for n, _ in kept], video.rate_hz, video.count)


def _best_proposal(
    frames: Sequence[np.ndarray], proposals: Sequence[Mapping]
) -> tuple[Mapping, Geometry | None, Counter]:
    """The settings with which the tracker finds all markers in the most frames, the first of equals."""
    tried = []
    for one in proposals:
        try:
            tried.append((one, *estimate_geometry(frames, TrackSettings.from_mapping(one))))
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


def _caption(settings: TrackSettings, geometry: Geometry | None) -> str:
    appearance = settings.markers
    named = [f"{role} {name}" if name != role else role for role, name in zip(ROLES, appearance.names, strict=True)]
    if appearance.pivot is None:
        named[0] = "pivot unmarked"
    lengths = "" if geometry is None else f"; arms {geometry.arm1:.1f} and {geometry.arm2:.1f} px"
    return f"{appearance.style}s of {settings.marker_diameter_px:g} px: {', '.join(named)}{lengths}"


def _yaml(
    footage: Footage,
    tracking: Mapping,
    gravity: Gravity | None,
    counts: Counter,
    caption: str,
    base: Mapping | None,
    rate_hz: float | None,
) -> str:
    videos: dict[str, object] = {"path": glob.escape(str(footage.path))}
    if rate_hz is not None:
        videos |= {"rate_hz": float(rate_hz)}
    recordings = {
        "source": "videos",
        "analysis_rate_hz": float(f"{footage.rate_hz:.9g}"),
        "arms_m": None,
        "videos": videos,
        "tracking": dict(tracking),
    }
    directions = "0 down, 90 right, -90 left, 180 up"
    if gravity is not None:
        recordings["angles"] = {"rotation_deg": round(gravity.degrees, 1) + 0.0}
        known = f"by the motion, to about {max(gravity.error_deg, 0.1):.1f} deg; {directions}"
    else:
        known = f"the motion does not tell it, and 0 is taken; {directions}"
    proposed: dict[str, object] = {"recordings": recordings}
    splits = {} if base is None else proposal.splits(base, recordings["analysis_rate_hz"])
    if splits:
        proposed["experiments"] = {name: {"data": {"split": split}} for name, split in splits.items()}
    lines = [
        f"# {printable(footage.path.name)}: {footage.facts}",
        f"# {caption}; all found in {counts['all']} of {counts['frames']} frames",
        "# arms_m: lengths of the arms in m, if you know them; they give the frame rate that the motion implies",
        f"# recordings.angles.rotation_deg: where gravity points in the image: {known}",
    ]
    return (
        "\n".join(lines) + "\n" + yaml.safe_dump(proposed, sort_keys=False, allow_unicode=True, default_flow_style=None)
    )


def _with_pendulum(
    frame: np.ndarray, settings: TrackSettings, geometry: Geometry | None, gravity: Gravity | None
) -> np.ndarray:
    image, factor = _small(frame)
    appearance = settings.markers
    finder = fitter(settings.marker_diameter_px, settings.min_level, settings.rim_tolerance, appearance)
    places = finder.candidates(frame)
    place = np.full((3, 2), np.nan)
    if len(places):
        disks = finder.fit(frame, places)
        for k in range(appearance.first, 3):
            chosen = best(disks, k, settings, () if geometry is None else geometry.twins[k])
            place[k] = np.nan if chosen is None else disks.centre[chosen]
    if appearance.pivot is None and geometry is not None:
        place[0] = geometry.pivot
    drawing.pendulum(image, place * factor, 0.5 * settings.marker_diameter_px * factor + 2)
    for k, role in enumerate(ROLES):
        if np.isfinite(place[k]).all():
            x, y = place[k] * factor + 0.6 * settings.marker_diameter_px * factor + 4
            drawing.text(
                image, role, (min(x, image.shape[1] - 45), min(y, image.shape[0] - 4)), drawing.ROLE_COLOURS[k]
            )
    if gravity is not None and geometry is not None and np.isfinite(place[0]).all():
        way = np.deg2rad(gravity.degrees)
        drawing.arrow(image, place[0] * factor, 0.8 * geometry.arm1 * factor * np.array([np.sin(way), np.cos(way)]))
    missing = [role for k, role in enumerate(ROLES) if np.isnan(place[k, 0])]
    if missing:
        drawing.text(image, f"not seen: {', '.join(missing)}", (6, image.shape[0] - 8), (80, 80, 255))
    return image


def _with_spots(frame: np.ndarray, number: int, spots: Sequence[Spot]) -> np.ndarray:
    image, factor = _small(frame)
    for spot in spots:
        if spot.frame == number:
            place = np.array(spot.centre) * factor
            drawing.ring(image, place, spot.diameter / 2 * factor + 2, drawing.ARM)
            drawing.text(image, f"hue {spot.colour[0]:.0f}", tuple(place + spot.diameter * factor / 2 + 3))
    return image


def _small(frame: np.ndarray) -> tuple[np.ndarray, float]:
    factor = SHOWN_WIDTH / frame.shape[1]
    return drawing.scaled(frame, factor), factor


def _write_sheet(sheet: str | Path, footage: Footage, images: Sequence[np.ndarray], caption: str) -> None:
    chosen = np.unique(np.linspace(0, len(images) - 1, SHOWN).round().astype(int))
    tiles = []
    for k in chosen:
        tile = cv2.copyMakeBorder(images[k], 0, 6, 0, 6, cv2.BORDER_CONSTANT, value=(40, 40, 40))
        drawing.text(tile, f"frame {footage.numbers[k]}", (6, 16))
        tiles.append(tile)
    columns = 3 if len(tiles) > 4 else max(1, len(tiles))
    tiles += [np.full_like(tiles[0], 40)] * (-len(tiles) % columns)
    rows = [np.concatenate(tiles[k : k + columns], axis=1) for k in range(0, len(tiles), columns)]
    picture = cv2.copyMakeBorder(np.concatenate(rows), 52, 0, 6, 0, cv2.BORDER_CONSTANT, value=(40, 40, 40))
    for line, y in ((f"{printable(footage.path.name)}: {footage.facts}", 20), (caption, 42)):
        drawing.text(picture, line.replace("°", " deg").encode("ascii", "replace").decode(), (8, y), size=0.5)
    with atomic(sheet) as temporary:
        if not cv2.imwrite(str(temporary), picture):
            raise InputError(sheet, "cannot be written as an image", "name it .png")

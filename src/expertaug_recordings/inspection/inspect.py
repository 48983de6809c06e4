"""What videos show, and the one configuration that would track them: what they share, and what differs by recording."""

from __future__ import annotations

import glob
import json
import logging
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
import yaml

from expertaug.errors import InputError, printable
from expertaug.files import atomic
from expertaug_recordings.angles.pendulum_fit import Gravity
from expertaug_recordings.angles.rectify import describe
from expertaug_recordings.inspection.detect import Spot
from expertaug_recordings.inspection.look import SHOWN, Look, count_with, look_at
from expertaug_recordings.markers.appearance import ROLES
from expertaug_recordings.markers.disks import fitter
from expertaug_recordings.markers.geometry import best
from expertaug_recordings.names import by_name
from expertaug_recordings.reports import drawing
from expertaug_recordings.settings import StatedTimes, TrackMarkersJob

logger = logging.getLogger(__name__)

AS_GOOD = 0.95  # of the frames that a recording's own settings find, for the shared ones to do
SAME_DEG = 1.0  # by which directions of gravity may differ
SAME_HZ = 1e-3  # by which rates of one kind of camera differ
DIRECTIONS = "0 down, 90 right, -90 left, 180 up"
SHOWN_WIDTH, SMALL_WIDTH = 480, 240  # px of a frame on the contact sheet of one video, and of several


def combine(looks: Sequence[Look]) -> dict[str, object]:
    """The block ``recordings`` of a configuration that tracks all of them.

    A recording keeps settings of its own where the shared ones find fewer of its markers.

    Raises:
        InputError: two recordings would have one name.
    """
    files = [look.footage.path for look in looks]
    names = {path: name for name, path in by_name("recordings.videos.path", files).items()} if len(looks) > 1 else {}
    shared = _choose_tracking(looks)
    rotation = _choose_rotation(looks)
    askew = all(look.view is not None for look in looks)
    angles = ({} if rotation is None else {"rotation_deg": rotation}) | (
        {"rectify": {"ellipse": True}} if askew else {}
    )
    stated = [look.footage.stated.model_dump(exclude_unset=True) for look in looks]
    of_all = {k: v for k, v in stated[0].items() if all(k in settings and settings[k] == v for settings in stated)}
    own: dict[str, dict[str, object]] = {}
    for look, its in zip(looks, stated, strict=True):
        block: dict[str, dict[str, object]] = {}
        if its != of_all:
            block["videos"] = {k: v for k, v in its.items() if k not in of_all}
        if look.tracking != shared and count_with(look.footage.frames, shared) < AS_GOOD * look.counts["all"]:
            block["tracking"] = {k: v for k, v in look.tracking.items() if shared.get(k) != v}
        if rotation is not None and look.gravity is not None and _apart(look.gravity, rotation):
            block["angles"] = {"rotation_deg": round(look.gravity.degrees, 1) + 0.0}
        if look.view is not None and not askew:
            block["angles"] = block.get("angles", {}) | {"rectify": {"ellipse": True}}
        if block:
            own[names[look.footage.path]] = block
    paths = [glob.escape(str(look.footage.path)) for look in looks]
    rate = min(look.footage.rate_hz for look in looks)
    return {
        "source": "videos",
        "analysis_rate_hz": float(f"{rate:.9g}"),
        "arms_m": None,
        "videos": {"path": paths[0] if len(paths) == 1 else paths, **of_all},
        "tracking": shared,
        **({"angles": angles} if angles else {}),
        **({"by_recording": own} if own else {}),
    }


def rates_differ(looks: Sequence[Look]) -> bool:
    """Whether angles of some recordings will be resampled."""
    rates = np.array([look.footage.rate_hz for look in looks])
    ratio = rates / rates.min()
    return bool(
        (np.abs(ratio - np.rint(ratio)) > SAME_HZ).any() or any(look.footage.times is not None for look in looks)
    )


def _choose_tracking(looks: Sequence[Look]) -> dict[str, object]:
    """The markers that most recordings have, with the other settings of the recording of median diameter among them."""
    markers = _commonest([look.tracking["markers"] for look in looks])
    like = sorted(
        (look for look in looks if look.tracking["markers"] == markers),
        key=lambda look: float(look.tracking["marker_diameter_px"]),
    )
    return dict(like[len(like) // 2].tracking)


def _choose_rotation(looks: Sequence[Look]) -> float | None:
    """The direction of gravity that most recordings share in degrees, None where none tells: cameras are not turned
    between most."""
    gravities = [look.gravity for look in looks if look.gravity is not None]
    if not gravities:
        return None
    like = max(([g for g in gravities if not _apart(g, gravity.degrees)] for gravity in gravities), key=len)
    return round(min(like, key=lambda g: g.error_deg).degrees, 1) + 0.0


def _apart(gravity: Gravity, degrees: float) -> bool:
    """Whether a direction is not this one."""
    off = abs((gravity.degrees - degrees + 180) % 360 - 180)
    return off > max(SAME_DEG, 3 * gravity.error_deg)


def _commonest(values: Sequence[Mapping]) -> Mapping:
    """The value that is there most often, the first of equals."""
    return json.loads(Counter(json.dumps(v) for v in values).most_common(1)[0][0])


def inspect(videos: str | Path | Sequence[str | Path], sheet: str | Path, stated: StatedTimes | None = None) -> str:
    """Look for a pendulum's markers in videos and propose the configuration that tracks them.

    Arguments:
        videos: files or folders as :func:`~expertaug_recordings.video.source.open_frames` takes.
        sheet: contact sheet to write, .png or .jpg: some frames of each with what was seen on them.
        stated: of their times, what the files do not say.

    Returns:
        YAML text.  Of several videos those of which nothing can be proposed are left out, and a comment says why.

    Raises:
        InputError: no video can be used, shows markers or some that move like a pendulum's; the contact sheet is
            written all the same where there are frames.
    """
    cv2.setNumThreads(1)
    if Path(sheet).suffix.lower() not in (".png", ".jpg", ".jpeg"):
        raise InputError(sheet, f"suffix '{Path(sheet).suffix}'", "a contact sheet is .png or .jpg")
    paths = [Path(videos)] if isinstance(videos, str | Path) else [Path(video) for video in videos]
    looks, refused = [], []
    for path in paths:
        try:
            looks.append(look_at(path, stated or StatedTimes()))
        except InputError as error:
            refused.append(error)
    if looks:
        with atomic(sheet) as temporary:
            if not cv2.imwrite(str(temporary), draw_sheet(looks)):
                raise InputError(sheet, "cannot be written as an image", "name it .png")
    refused += [
        InputError(look.footage.path, look.refusal, f"{sheet} shows what was seen") for look in looks if look.refusal
    ]
    used = [look for look in looks if not look.refusal]
    if not used:
        raise refused[0]
    for look in used:
        for note in look.notes:
            logger.warning("%s: %s", printable(str(look.footage.path)), note)
    return _yaml(used, refused)


def _yaml(looks: Sequence[Look], refused: Sequence[InputError]) -> str:
    lines = []
    for look in looks:
        lines += [
            f"# {printable(look.footage.path.name)}: {look.footage.facts}",
            f"# {_caption(look)}; all found in {look.counts['all']} of {look.counts['frames']} frames",
        ]
        lines += [f"# {note}" for note in look.notes]
        if look.view is not None:
            lines.append(
                f"# the camera looks askew, a circle is {describe(look.view)}: recordings.angles.rectify undoes it"
                f" (arms {look.view.gain:.1f} times as steady)"
            )
    lines += [f"# left out: {printable(str(error))}" for error in refused]
    if rates_differ(looks):
        lines.append("# analysis_rate_hz: angles of the other and of variable rates are resampled to it")
    if any(look.gravity is not None for look in looks):
        error = max(look.gravity.error_deg for look in looks if look.gravity is not None)
        gravity_note = f"by the motion, to about {max(error, 0.1):.1f} deg"
    else:
        gravity_note = "the motion does not tell it, and 0 is taken"
    lines += [
        "# arms_m: lengths of the arms in m, if you know them; they give the frame rate that the motion implies",
        f"# recordings.angles.rotation_deg: where gravity points in the image: {gravity_note}; {DIRECTIONS}",
    ]
    proposed = {"recordings": combine(looks)}
    return (
        "\n".join(lines) + "\n" + yaml.safe_dump(proposed, sort_keys=False, allow_unicode=True, default_flow_style=None)
    )


def _caption(look: Look) -> str:
    if look.pendulum is None:
        return "no pendulum seen"
    settings = TrackMarkersJob.from_mapping(look.tracking)
    appearance, geometry = settings.appearance, look.geometry
    named = [f"{role} {name}" if name != role else role for role, name in zip(ROLES, appearance.names, strict=True)]
    if appearance.pivot is None:
        named[0] = "pivot unmarked"
    kind, named = ("", named) if appearance.tip is not None else ("single pendulum, ", named[:2])
    lengths = [] if geometry is None else [f"{arm:.1f}" for arm in (geometry.arm1, geometry.arm2)[: len(named) - 1]]
    arms = f"; arm{'s' * (len(lengths) - 1)} {' and '.join(lengths)} px" if lengths else ""
    return f"{kind}{appearance.style}s of {settings.marker_diameter_px:g} px: {', '.join(named)}{arms}"


def _with_pendulum(frame: np.ndarray, width: int, look: Look) -> np.ndarray:
    image, factor = _small(frame, width)
    settings, geometry, gravity = TrackMarkersJob.from_mapping(look.tracking), look.geometry, look.gravity
    appearance = settings.appearance
    finder = fitter(settings.marker_diameter_px, settings.min_level, settings.rim_tolerance, appearance)
    places = finder.candidates(frame)
    place = np.full((3, 2), np.nan)
    if len(places):
        disks = finder.fit(frame, places)
        for k in range(appearance.first, appearance.last):
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
    missing = [role for k, role in enumerate(ROLES[: appearance.last]) if np.isnan(place[k, 0])]
    if missing:
        drawing.text(image, f"not seen: {', '.join(missing)}", (6, image.shape[0] - 8), (80, 80, 255))
    return image


def _with_spots(frame: np.ndarray, width: int, number: int, spots: Sequence[Spot]) -> np.ndarray:
    image, factor = _small(frame, width)
    for spot in spots:
        if spot.frame == number:
            place = np.array(spot.centre) * factor
            drawing.ring(image, place, spot.diameter / 2 * factor + 2, drawing.ARM)
            drawing.text(image, f"hue {spot.colour[0]:.0f}", tuple(place + spot.diameter * factor / 2 + 3))
    return image


def _small(frame: np.ndarray, width: int) -> tuple[np.ndarray, float]:
    factor = width / frame.shape[1]
    return drawing.resize(frame, factor), factor


def draw_sheet(looks: Sequence[Look]) -> np.ndarray:
    """The contact sheet (height, width, 3): some frames of each video with what was seen on them."""
    rows = [row for look in looks for row in _rows(look, SHOWN_WIDTH if len(looks) == 1 else SMALL_WIDTH)]
    width = max(row.shape[1] for row in rows)
    grey = (40, 40, 40)
    rows = [cv2.copyMakeBorder(r, 0, 0, 0, width - r.shape[1], cv2.BORDER_CONSTANT, value=grey) for r in rows]
    return np.concatenate(rows)


def _rows(look: Look, width: int) -> list[np.ndarray]:
    """A heading and rows of some of a video's frames with what was seen on them."""
    footage = look.footage
    tiles = []
    for k in np.unique(np.linspace(0, len(footage.frames) - 1, SHOWN).round().astype(int)):
        if look.pendulum is None:
            seen = max(look.spots.values(), key=len)
            image = _with_spots(footage.frames[k], width, int(k), seen)
        else:
            image = _with_pendulum(footage.frames[k], width, look)
        tile = cv2.copyMakeBorder(image, 0, 6, 0, 6, cv2.BORDER_CONSTANT, value=(40, 40, 40))
        drawing.text(tile, f"frame {footage.numbers[k]}", (6, 16))
        tiles.append(tile)
    columns = 3 if len(tiles) > 4 and width == SHOWN_WIDTH else len(tiles)
    tiles += [np.full_like(tiles[0], 40)] * (-len(tiles) % columns)
    rows = [np.concatenate(tiles[k : k + columns], axis=1) for k in range(0, len(tiles), columns)]
    picture = cv2.copyMakeBorder(np.concatenate(rows), 52, 0, 6, 0, cv2.BORDER_CONSTANT, value=(40, 40, 40))
    for line, y in ((f"{printable(footage.path.name)}: {footage.facts}", 20), (_caption(look), 42)):
        drawing.text(picture, line.replace("°", " deg").encode("ascii", "replace").decode(), (8, y), size=0.5)
    return [picture]

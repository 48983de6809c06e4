"""One configuration for many videos: what they share, and what differs by recording."""

from __future__ import annotations

import glob
import json
from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from expertaug_recordings.angles.tilt import Gravity
from expertaug_recordings.inspection.look import Look, count_with
from expertaug_recordings.names import by_name

AS_GOOD = 0.95  # of the frames that a recording's own settings find, for the shared ones to do
SAME_DEG = 1.0  # by which directions of gravity may differ
SAME_HZ = 1e-3  # by which rates of one kind of camera differ


def combine(looks: Sequence[Look]) -> dict[str, object]:
    """The block ``recordings`` of a configuration that tracks all of them.

    A recording keeps settings of its own where the shared ones find fewer of its markers.

    Raises:
        InputError: two recordings would have one name.
    """
    files = [look.footage.path for look in looks]
    names = {path: name for name, path in by_name("recordings.videos.path", files).items()} if len(looks) > 1 else {}
    shared = _shared_tracking(looks)
    rotation = _shared_rotation(looks)
    askew = all(look.view is not None for look in looks)
    angles = ({} if rotation is None else {"rotation_deg": rotation}) | (
        {"rectify": {"ellipse": True}} if askew else {}
    )
    own: dict[str, dict[str, object]] = {}
    for look in looks:
        block: dict[str, dict[str, object]] = {}
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
    stated = looks[0].footage.stated.model_dump(exclude_unset=True)
    return {
        "source": "videos",
        "analysis_rate_hz": float(f"{rate:.9g}"),
        "arms_m": None,
        "videos": {"path": paths[0] if len(paths) == 1 else paths, **stated},
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


def _shared_tracking(looks: Sequence[Look]) -> dict[str, object]:
    """The markers that most recordings have, with the other settings of the recording of median diameter among them."""
    markers = _commonest([look.tracking["markers"] for look in looks])
    like = sorted(
        (look for look in looks if look.tracking["markers"] == markers),
        key=lambda look: float(look.tracking["marker_diameter_px"]),
    )
    return dict(like[len(like) // 2].tracking)


def _shared_rotation(looks: Sequence[Look]) -> float | None:
    """The direction of gravity that most recordings share in degrees, None where none tells: cameras are not turned
    between most."""
    known = [look.gravity for look in looks if look.gravity is not None]
    if not known:
        return None
    like = max(([g for g in known if not _apart(g, one.degrees)] for one in known), key=len)
    return round(min(like, key=lambda g: g.error_deg).degrees, 1) + 0.0


def _apart(gravity: Gravity, degrees: float) -> bool:
    """Whether a direction is not this one."""
    off = abs((gravity.degrees - degrees + 180) % 360 - 180)
    return off > max(SAME_DEG, 3 * gravity.error_deg)


def _commonest(values: Sequence[Mapping]) -> Mapping:
    """The value that is there most often, the first of equals."""
    return json.loads(Counter(json.dumps(v) for v in values).most_common(1)[0][0])

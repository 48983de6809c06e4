"""Round things beside the pendulum that is proposed, which may be markers too: of a second pendulum, or of this one."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

import numpy as np

from expertaug_recordings.inspection.detect import MIN_PRESENCE, Pendulum, Spot, by_hue
from expertaug_recordings.markers.appearance import ROLES
from expertaug_recordings.markers.geometry import TWIN

OWN = 0.5  # diameters within which a spot is the marker itself
SAME_HUE = 15.0  # degrees: half the step between named colours


def find_left_over(pendulum: Pendulum, spots: Sequence[Spot], frames: int) -> list[str]:
    """A line for each colour of which round things are left over in most of the frames, if a marker has it, or they
    move; what is at rest and of another colour can be taken for no marker.

    Arguments:
        pendulum: the pendulum that is proposed.
        spots: all that were seen, of its markers' style.
        frames: that were looked at.
    """
    lines, single = [], pendulum.spots[2] is None
    for group in by_hue([s for s in spots if not _is_marker(s, pendulum)]):
        often = Counter(s.frame for s in group)
        if len(often) < MIN_PRESENCE * frames:
            continue
        tints = np.exp(1j * np.deg2rad([s.colour[0] for s in group]))
        hue = float(np.rad2deg(np.angle(tints.mean())) % 360)
        role, moving = _role(hue, pendulum), _moves(group, frames)
        if role is None and not moving:
            continue
        colour = f"the {role}'s colour" if role is not None else "another colour"
        count = max(often.values())
        several = f", up to {count} at once" if count > 1 else ""
        what = "that move" if moving else "at rest"
        line = f"left over: {pendulum.style}s of {colour} (hue {round(hue) % 360}) {what}"
        line += f", in {len(often)} of {frames} frames{several}"
        if moving:
            line += ": is the pendulum a double one, or are there two?" if single else ": are there two pendulums?"
            if role is not None:
                line += (
                    " Markers may be confused with them: film without, or cover their way (recordings.tracking.masks)"
                )
        lines.append(line)
    return lines


def _is_marker(spot: Spot, pendulum: Pendulum) -> bool:
    own = (group.get(spot.frame) for group in pendulum.spots if group is not None)
    return any(marker is not None and math.dist(marker.centre, spot.centre) < OWN * spot.diameter for marker in own)


def _role(hue: float, pendulum: Pendulum) -> str | None:
    """The marker whose colour is this one."""
    for role, group in zip(ROLES, pendulum.spots, strict=True):
        if group is not None:
            turns = np.exp(1j * np.deg2rad([s.colour[0] - hue for s in group.values()]))
            if abs(float(np.rad2deg(np.angle(turns.mean())))) < SAME_HUE:
                return role
    return None


def _moves(group: Sequence[Spot], frames: int) -> bool:
    """Whether these are elsewhere than at places where one of them is in most of the frames."""
    reach = TWIN * float(np.median([s.diameter for s in group]))
    centre, number = np.array([s.centre for s in group]), np.array([s.frame for s in group])
    near = np.linalg.norm(centre[:, None] - centre, axis=2) < reach
    still = np.array([len(set(number[row])) >= MIN_PRESENCE * frames for row in near])
    return len(set(number[~still])) >= MIN_PRESENCE * frames

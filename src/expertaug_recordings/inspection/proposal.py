"""From what was seen of a pendulum to the keys of the configuration that track it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from expertaug_recordings.inspection.detect import Pendulum
from expertaug_recordings.markers.appearance import COLOURS, ROLES, Colour

RANGE_DEG = 25.0  # half a proposed range of hues, or less where markers are nearer to each other
RANGE_STRENGTH = 0.5  # share of a marker's saturation and value below which a colour is not taken for its


def tracking(found: Pendulum) -> list[dict[str, object]]:
    """Settings of the tracker to try, the simplest first: colours by name, where names tell the markers apart, then as
    ranges of hue, saturation and value."""
    groups = [None if g is None else list(g.values()) for g in found.spots]
    tints = [None if g is None else np.array([s.colour for s in g]) for g in groups]
    diameter = float(np.median([s.diameter for g in groups if g is not None for s in g]))
    settings: dict[str, object] = {"marker_diameter_px": round(diameter, 1)}
    kinds = [kind for kind in (_names(tints), _ranges(tints)) if kind is not None]
    return [{"markers": {"style": found.style, **dict(zip(ROLES, kind, strict=True))}} | settings for kind in kinds]


def _names(tints: Sequence[np.ndarray | None]) -> list[str | None] | None:
    """Colours' names; None where they do not tell the markers apart."""
    names = [None if t is None else _name(_mean_hue(t[:, 0])) for t in tints]
    seen = [n for n in names if n is not None]
    named = [_all_named(t, name, seen) for t, name in zip(tints, names, strict=True) if t is not None]
    return names if len(set(seen)) == len(seen) and all(named) else None


def _ranges(tints: Sequence[np.ndarray | None]) -> list[dict[str, list[float]] | None]:
    hues = [None if t is None else _mean_hue(t[:, 0]) for t in tints]
    return [
        None if t is None else _range(t, hue, [h for h in hues if h is not None and h != hue])
        for t, hue in zip(tints, hues, strict=True)
    ]


def _mean_hue(hues: np.ndarray) -> float:
    return float(np.rad2deg(np.angle(np.exp(1j * np.deg2rad(hues)).mean())) % 360)


def _away(hue: np.ndarray | float, other: float) -> np.ndarray:
    return np.abs((np.asarray(hue) - other + 180) % 360 - 180)


def _name(hue: float) -> str:
    """The colour in whose range a hue lies best."""
    return max(COLOURS, key=lambda name: _inside(hue, name))


def _inside(hue: float, name: str) -> float:
    """Degrees to the nearer end of a colour's range, negative outside."""
    colour = Colour(name, COLOURS[name])
    return colour.reach - float(_away(hue, colour.middle))


def _all_named(tint: np.ndarray, name: str, among: Sequence[str]) -> bool:
    """Whether all of a marker's sightings are of a colour of this name, and of no other that is used."""
    colours = {other: Colour(other, COLOURS[other]) for other in among}
    own = colours[name]
    inside = (_away(tint[:, 0], own.middle) < 0.85 * own.reach).all()
    strong = (tint[:, 1] > 1.2 * own.saturation[0]).all() and (tint[:, 2] > 1.2 * own.value[0]).all()
    nearest = [min(colours, key=lambda other: float(_away(h, colours[other].middle))) for h in tint[:, 0]]
    return bool(inside and strong and set(nearest) == {name})


def _range(tint: np.ndarray, hue: float, others: Sequence[float]) -> dict[str, list[float]]:
    reach = min([RANGE_DEG, *(0.45 * float(_away(other, hue)) for other in others)])
    low = [RANGE_STRENGTH * float(np.median(tint[:, k])) for k in (1, 2)]
    return {
        "hue": [round((hue - reach) % 360), round((hue + reach) % 360)],
        "saturation": [round(low[0], 2), 1.0],
        "value": [round(low[1], 2), 1.0],
    }

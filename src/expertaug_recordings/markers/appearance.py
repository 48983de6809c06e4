"""How the markers look: their style, their colours, and which of them is the pivot.

No numerical library is loaded here: the configuration is checked with it before any job starts.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping
from dataclasses import dataclass

from expertaug.errors import InputError

WHERE = "recordings.tracking.markers"
ROLES = ("pivot", "joint", "tip")
STYLES = ("quadrant", "disk")
# Hues in degrees from the first to the second, as cameras see them: they overlap, and the nearest middle decides.
COLOURS = {
    "red": (320.0, 25.0),
    "orange": (12.0, 45.0),
    "yellow": (42.0, 75.0),
    "green": (75.0, 195.0),
    "cyan": (165.0, 210.0),
    "blue": (195.0, 265.0),
    "purple": (250.0, 300.0),
    "magenta": (285.0, 335.0),
    "pink": (315.0, 350.0),
}
SATURATION, VALUE = (0.25, 1.0), (0.12, 1.0)  # of a colour given by name or by its hue alone: neither grey nor black


@dataclass(frozen=True)
class Colour:
    """A range of colours: hue in degrees (from the first to the second, through 0 where it is smaller), saturation and
    value from 0 to 1; of quadrant disks those of the dark sectors relative to the white ones."""

    name: str
    hue: tuple[float, float]
    saturation: tuple[float, float] = SATURATION
    value: tuple[float, float] = VALUE

    @property
    def middle(self) -> float:
        """Hue in degrees."""
        return (self.hue[0] + self.reach) % 360

    @property
    def reach(self) -> float:
        """Half of the hue's range in degrees."""
        return (self.hue[1] - self.hue[0]) % 360 / 2


@dataclass(frozen=True)
class Appearance:
    """The three markers.

    Attributes:
        style: ``quadrant`` (two coloured and two white sectors) or ``disk`` (one colour).
        pivot, joint, tip: colours; a pivot of None bears no marker and does not move; with a tip of None the pendulum
            is a single one, and the joint is its bob.
        pivot_px: (x, y) of an unmarked pivot; None: the centre of the circle on which the joint moves.
    """

    style: str = "quadrant"
    pivot: Colour | None = Colour("red", COLOURS["red"])
    joint: Colour = Colour("green", COLOURS["green"])
    tip: Colour | None = Colour("blue", COLOURS["blue"])
    pivot_px: tuple[float, float] | None = None

    @property
    def colours(self) -> tuple[Colour | None, Colour, Colour | None]:
        return self.pivot, self.joint, self.tip

    @property
    def names(self) -> tuple[str, str, str]:
        """What reports call the markers: their colours' names, or their roles."""
        return tuple(role if c is None else c.name for role, c in zip(ROLES, self.colours, strict=True))

    @property
    def seen(self) -> tuple[str, ...]:
        """Names of the markers that there are."""
        return self.names[self.first : self.last]

    @property
    def first(self) -> int:
        """Number of the first marker that can be seen: 0, or 1 where the pivot bears none."""
        return 0 if self.pivot is not None else 1

    @property
    def last(self) -> int:
        """Number after that of the last marker: 3, or 2 of a single pendulum."""
        return 3 if self.tip is not None else 2

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, object] | None) -> Appearance:
        """Read and check a mapping; what is left out keeps its default.

        Raises:
            InputError: a key or a colour is unknown, or two markers have one colour.
        """
        fields = dict(mapping or {})
        valid_keys = ("style", *ROLES, "pivot_px")
        for key in fields:
            if key not in valid_keys:
                raise InputError(f"{WHERE}.{key}", "unknown key", f"known are {', '.join(valid_keys)}")
        if fields.get("style", "quadrant") not in STYLES:
            raise InputError(f"{WHERE}.style", f"is {fields['style']!r}", f"it must be {' or '.join(STYLES)}")
        for role in ROLES:
            if role in fields and not (role != "joint" and fields[role] is None):
                fields[role] = _colour(role, fields[role])
        appearance = cls(**fields)
        if appearance.pivot_px is not None:
            if appearance.pivot is not None:
                remedy = "it is measured: say pivot: null where it bears no marker"
                raise InputError(f"{WHERE}.pivot_px", f"given for a {appearance.pivot.name} pivot", remedy)
            point = _numbers(f"{WHERE}.pivot_px", appearance.pivot_px, -1e6, 1e6, "give x and y in px")
            appearance = cls(**{**fields, "pivot_px": point})
        seen: dict[tuple[float, float], str] = {}
        for role, colour in zip(ROLES, appearance.colours, strict=True):
            if colour is not None and colour.hue in seen:
                problem = f"has the colour of the {seen[colour.hue]}, {colour.name}"
                raise InputError(f"{WHERE}.{role}", problem, "give each marker a colour of its own")
            if colour is not None:
                seen[colour.hue] = role
        return appearance


def _colour(role: str, value: object) -> Colour:
    where = f"{WHERE}.{role}"
    if isinstance(value, str):
        if value not in COLOURS:
            near = difflib.get_close_matches(value, COLOURS, 1)
            remedy = f"did you mean {near[0]}?" if near else f"known are {', '.join(COLOURS)}, or give a hue"
            raise InputError(where, f"'{value}' is no known colour", remedy)
        return Colour(value, COLOURS[value])
    if not isinstance(value, Mapping):
        raise InputError(where, f"is {value!r}", "give the name of a colour or its hue, saturation and value")
    for key in value:
        if key not in ("hue", "saturation", "value"):
            raise InputError(f"{where}.{key}", "unknown key", "known are hue, saturation, value")
    if "hue" not in value:
        raise InputError(f"{where}.hue", "missing", "give its range in degrees, such as [100, 140]")
    hue = _numbers(f"{where}.hue", value["hue"], 0, 360, "give a range in degrees, 0 to 360")
    rest = {}
    for key in ("saturation", "value"):
        if key in value:
            rest[key] = _numbers(f"{where}.{key}", value[key], 0, 1, "give a range within 0 and 1")
            if rest[key][0] >= rest[key][1]:
                raise InputError(f"{where}.{key}", f"is {list(rest[key])}", "the first must be less than the second")
    if hue[0] % 360 == hue[1] % 360:
        raise InputError(f"{where}.hue", f"is {list(hue)}", "give a range that is neither empty nor all hues")
    return Colour(role, hue, **rest)


def _numbers(where: str, value: object, low: float, high: float, remedy: str) -> tuple[float, float]:
    pair = isinstance(value, list | tuple) and len(value) == 2
    if not pair or any(isinstance(v, bool) or not isinstance(v, int | float) or not math.isfinite(v) for v in value):
        raise InputError(where, f"is {value!r}", remedy)
    if not all(low <= v <= high for v in value):
        raise InputError(where, f"is {list(value)}", remedy)
    return float(value[0]), float(value[1])

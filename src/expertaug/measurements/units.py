"""Units of measured columns: a small table, and the way from one of them to another of its kind."""

from __future__ import annotations

import math
from collections.abc import Mapping

from expertaug.errors import InputError

# Kind → unit: factor to the kind's first unit, and what is added then.
KINDS: Mapping[str, Mapping[str, tuple[float, float]]] = {
    kind: {unit: value if isinstance(value, tuple) else (value, 0.0) for unit, value in units.items()}
    for kind, units in {
        "angle": {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180, "rev": 2 * math.pi},
        "angular speed": {"rad/s": 1.0, "deg/s": math.pi / 180, "rpm": math.pi / 30, "rev/s": 2 * math.pi},
        "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0, "d": 86400.0},
        "rate": {"1/s": 1.0, "1/min": 1 / 60, "1/h": 1 / 3600, "1/d": 1 / 86400, "Hz": 1.0},
        "length": {"m": 1.0, "km": 1e3, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254, "ft": 0.3048},
        "speed": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3, "km/h": 1 / 3.6},
        "acceleration": {"m/s2": 1.0, "mm/s2": 1e-3, "g0": 9.80665},
        "voltage": {"V": 1.0, "kV": 1e3, "mV": 1e-3, "uV": 1e-6},
        "current": {"A": 1.0, "mA": 1e-3, "uA": 1e-6},
        "resistance": {"ohm": 1.0, "kohm": 1e3, "Mohm": 1e6},
        "capacitance": {"F": 1.0, "mF": 1e-3, "uF": 1e-6, "nF": 1e-9, "pF": 1e-12},
        "inductance": {"H": 1.0, "mH": 1e-3, "uH": 1e-6},
        "mass": {"kg": 1.0, "g": 1e-3, "mg": 1e-6},
        "force": {"N": 1.0, "kN": 1e3, "mN": 1e-3},
        "pressure": {"Pa": 1.0, "kPa": 1e3, "hPa": 1e2, "bar": 1e5, "mbar": 1e2},
        "temperature": {"K": 1.0, "degC": (1.0, 273.15), "degF": (5 / 9, 459.67 * 5 / 9)},
        "number": {"": 1.0, "1": 1.0, "%": 1e-2, "1000": 1e3},
    }.items()
}
OTHERWISE = {"Ω": "ohm", "kΩ": "kohm", "MΩ": "Mohm", "°": "deg", "degree": "deg", "degrees": "deg", "radian": "rad"}
OTHERWISE |= {"°/s": "deg/s", "°C": "degC", "°F": "degF", "sec": "s", "second": "s", "seconds": "s", "percent": "%"}
OTHERWISE |= {"radians": "rad", "s-1": "1/s", "radians/s": "rad/s", "turn": "rev", "turns": "rev"}


def conversion(unit: str | None, to: str, where: object) -> tuple[float, float]:
    """Factor and summand that turn numbers in ``unit`` into numbers in ``to``.

    Arguments:
        unit: None means ``to``.
        to: the unit that the system has.
        where: the key, for messages.

    Raises:
        InputError: a unit is not in the table, or the two are of different kinds.
    """
    if unit is None or plain(unit) == plain(to):
        return 1.0, 0.0
    kinds = [next((kind for kind, units in KINDS.items() if plain(one) in units), None) for one in (unit, to)]
    if kinds[0] is None:
        known = KINDS[kinds[1]] if kinds[1] is not None else {}
        listed = f"units of {kinds[1]}: {', '.join(known)}" if known else f"the system has {to or 'a pure number'}"
        raise InputError(where, f"the unit '{unit}' is not known", f"{listed}; or give factor and offset")
    if kinds[0] != kinds[1]:
        found = f"'{unit}' is a unit of {kinds[0]}, the system has {to or 'a pure number'}"
        raise InputError(where, found, "correct the unit, or give factor and offset")
    (factor, summand), (own, other) = (KINDS[kinds[0]][plain(one)] for one in (unit, to))
    return factor / own, (summand - other) / own


def known(unit: str) -> bool:
    """Whether the table has a unit."""
    return any(plain(unit) in units for units in KINDS.values())


def plain(unit: str) -> str:
    """A unit as the table writes it."""
    text = unit.strip().strip("[]()").replace("µ", "u").replace("μ", "u").replace("⁻¹", "-1").replace("²", "2")
    text = text.replace("^", "").replace("·", " ").replace("sec", "s").replace(" / ", "/")
    if text.endswith(" s-1"):
        text = text.removesuffix(" s-1") + "/s"
    return OTHERWISE.get(text, text)

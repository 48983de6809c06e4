"""Units of measured columns: one parser for every way in which people write them, and the way from one to another.

A library (pint 0.25: 5 MB, .6 s of CPU to import) knows neither ``deg_s`` nor ``dps`` nor what a column's name is; of
units themselves a table of forty and the prefixes are all that tables of measurements need.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from expertaug.errors import InputError

Dimension = tuple[int, ...]  # powers of rad, s, m, kg, A, K
_RAD, _S, _M, _KG, _A, _K = (tuple(int(i == k) for i in range(6)) for k in range(6))
_ONE: Dimension = (0,) * 6
_SMALL = ("rad", "deg", "dps", "s")  # never a thousand of them: Grad is German for degree, Ms somebody's ms
_PREFIXES = {"n": 1e-9, "u": 1e-6, "m": 1e-3, "c": 1e-2, "d": 1e-1, "h": 1e2, "k": 1e3, "M": 1e6, "G": 1e9, "p": 1e-12}
_UNSURE = ("in", "min", "d", "h", "1", "1000", "")  # what also is a word or part of a name
_SYMBOLS = {"µ": "u", "μ": "u", "⁻": "-", "¹": "1", "²": "2", "³": "3", "⋅": "*", "·": "*", "×": "*", "−": "-"}
_TURN = 2 * math.pi
_TOKEN = re.compile(r"[A-Za-z%]+0?|1000(?![0-9])|\^?[-+]?\d+|[*/()_ ]")
_BRACKETS = re.compile(r"^(.*?)[\s_/,]*[\[({<]([^\])}>]*(?:\([^)]*\))?[^\])}>]*)[\])}>]\s*$")
_AFTER_SLASH = re.compile(r"^(.*?\S)\s*/\s*(\S.*)$")
_AFTER_WORD = re.compile(r"^(.*\S)(?:\s+in\s+|\s*[,:;]\s*)(\S.*)$", re.IGNORECASE)
_IN = re.compile(r"^(.*\S)\s+in\s+(\S+)$", re.IGNORECASE)
_AFTER_IN = re.compile(r"^(.+)[_.]in[_.](.+)$", re.IGNORECASE)


@dataclass(frozen=True)
class Unit:
    """A unit: a number x of it is ``factor · x + summand`` in rad, s, m, kg, A and K.

    Attributes:
        dimension: powers of these.
    """

    dimension: Dimension
    factor: float = 1.0
    summand: float = 0.0

    def __mul__(self, other: Unit) -> Unit:
        powers = tuple(a + b for a, b in zip(self.dimension, other.dimension, strict=True))
        return Unit(powers, self.factor * other.factor)

    def __pow__(self, power: int) -> Unit:
        return Unit(tuple(power * a for a in self.dimension), self.factor**power)

    @property
    def kind(self) -> str:
        """What is measured in it, for messages."""
        return _KIND_OF.get(self.dimension, "another quantity")


def _dimension(rad: int = 0, s: int = 0, m: int = 0, kg: int = 0, amp: int = 0, kelvin: int = 0) -> Dimension:
    return rad, s, m, kg, amp, kelvin


_KIND_OF: Mapping[Dimension, str] = {
    _ONE: "number",
    _RAD: "angle",
    _dimension(1, -1): "angular speed",
    _dimension(1, -2): "angular acceleration",
    _S: "time",
    _dimension(0, -1): "rate",
    _M: "length",
    _dimension(0, -1, 1): "speed",
    _dimension(0, -2, 1): "acceleration",
    _dimension(0, 0, 2): "area",
    _dimension(0, 0, 3): "volume",
    _KG: "mass",
    _dimension(0, -2, 1, 1): "force",
    _dimension(0, -2, 2, 1): "torque or energy",
    _dimension(0, -3, 2, 1): "power",
    _dimension(0, -2, -1, 1): "pressure",
    _A: "current",
    _dimension(0, -3, 2, 1, -1): "voltage",
    _dimension(0, -3, 2, 1, -2): "resistance",
    _dimension(0, 4, -2, -1, 2): "capacitance",
    _dimension(0, -2, 2, 1, -2): "inductance",
    _dimension(0, 1, 0, 0, 1): "charge",
    _K: "temperature",
}
# Units that take prefixes (k, m, …) and those that do not.
_PREFIXED: Mapping[str, Unit] = {
    "rad": Unit(_RAD),
    "s": Unit(_S),
    "m": Unit(_M),
    "g": Unit(_KG, 1e-3),
    "A": Unit(_A),
    "K": Unit(_K),
    "Hz": Unit(_dimension(0, -1)),
    "N": Unit(_dimension(0, -2, 1, 1)),
    "Pa": Unit(_dimension(0, -2, -1, 1)),
    "bar": Unit(_dimension(0, -2, -1, 1), 1e5),
    "J": Unit(_dimension(0, -2, 2, 1)),
    "W": Unit(_dimension(0, -3, 2, 1)),
    "V": Unit(_dimension(0, -3, 2, 1, -1)),
    "ohm": Unit(_dimension(0, -3, 2, 1, -2)),
    "F": Unit(_dimension(0, 4, -2, -1, 2)),
    "H": Unit(_dimension(0, -2, 2, 1, -2)),
    "C": Unit(_dimension(0, 1, 0, 0, 1)),
    "L": Unit(_dimension(0, 0, 3), 1e-3),
    "deg": Unit(_RAD, _TURN / 360),
    "dps": Unit(_dimension(1, -1), _TURN / 360),
}
_ALONE: Mapping[str, Unit] = {
    "gon": Unit(_RAD, _TURN / 400),
    "arcmin": Unit(_RAD, _TURN / 21600),
    "arcsec": Unit(_RAD, _TURN / 1296000),
    "rev": Unit(_RAD, _TURN),
    "rpm": Unit(_dimension(1, -1), _TURN / 60),
    "rps": Unit(_dimension(1, -1), _TURN),
    "min": Unit(_S, 60.0),
    "h": Unit(_S, 3600.0),
    "d": Unit(_S, 86400.0),
    "week": Unit(_S, 7 * 86400.0),
    "yr": Unit(_S, 365.25 * 86400.0),
    "in": Unit(_M, 0.0254),
    "ft": Unit(_M, 0.3048),
    "mi": Unit(_M, 1609.344),
    "kmh": Unit(_dimension(0, -1, 1), 1 / 3.6),
    "mph": Unit(_dimension(0, -1, 1), 0.44704),
    "g0": Unit(_dimension(0, -2, 1), 9.80665),
    "lb": Unit(_KG, 0.45359237),
    "degC": Unit(_K, 1.0, 273.15),
    "degF": Unit(_K, 5 / 9, 459.67 * 5 / 9),
    "%": Unit(_ONE, 1e-2),
    "1000": Unit(_ONE, 1e3),
    "1": Unit(_ONE),
    "": Unit(_ONE),
    "Nm": Unit(_dimension(0, -2, 2, 1)),
    "Ws": Unit(_dimension(0, -2, 2, 1)),
    "Ah": Unit(_dimension(0, 1, 0, 0, 1), 3600.0),
    "mAh": Unit(_dimension(0, 1, 0, 0, 1), 3.6),
}
# Words, in small letters, singular or plural; beside the symbols above in any case.
_WORDS: Mapping[str, str] = {
    word: symbol
    for symbol, words in {
        "rad": "radian radiant",
        "mrad": "milliradian",
        "deg": "degree graddeg grd",
        "gon": "gradian grade",
        "rev": "revolution turn rot rotation cycle",
        "arcmin": "arcminute",
        "arcsec": "arcsecond",
        "s": "sec second sekunde sekunden",
        "ms": "msec millis millisec millisecond",
        "us": "usec micros microsec microsecond",
        "ns": "nsec nanosecond",
        "min": "minute minuten",
        "h": "hr hour stunde stunden",
        "d": "day tag tage",
        "week": "wk",
        "yr": "year",
        "m": "meter metre",
        "mm": "millimeter millimetre",
        "cm": "centimeter centimetre",
        "km": "kilometer kilometre",
        "um": "micron micrometer micrometre",
        "in": "inch inches",
        "ft": "foot feet",
        "g": "gram gramm",
        "kg": "kilogram",
        "V": "volt",
        "mV": "millivolt",
        "A": "amp ampere",
        "mA": "milliamp milliampere",
        "ohm": "Ω",
        "N": "newton",
        "Hz": "hertz",
        "kHz": "kilohertz",
        "Pa": "pascal",
        "W": "watt",
        "J": "joule",
        "F": "farad",
        "H": "henry",
        "K": "kelvin",
        "degC": "celsius centigrade",
        "degF": "fahrenheit",
        "%": "percent prozent pct",
        "rpm": "revmin upm",
        "dps": "degps degpersec",
        "rad/s": "radps radpersec",
        "m/s": "mps",
        "kmh": "kph",
        "1": "none dimensionless unitless",
        "g0": "gee",
    }.items()
    for word in words.split()
}
_SYMBOLS |= {
    "℃": "degC",
    "°C": "degC",
    "° C": "degC",
    "°F": "degF",
    "º": "deg",
    "°": "deg",
    "\u2126": "ohm",
    "\u03a9": "ohm",
}
_SYMBOLS |= {"U/min": "rpm", "˚": "deg", "**": "^", "'": "", '"': ""}


def parse(text: str) -> Unit | None:
    """The unit that a text means; None where it means none that is known.

    A product may be written with ``*``, a dot, a blank or ``_``; ``deg_s`` and ``m_s2`` are quotients.
    """
    text = text.strip()
    while len(text) > 1 and (text[0], text[-1]) in (("[", "]"), ("(", ")"), ("{", "}"), ("<", ">")):
        text = text[1:-1].strip()
    for symbol, plain in _SYMBOLS.items():
        text = text.replace(symbol, plain)
    text = re.sub(r"(?<![A-Za-z])(?:per|Per|PER)(?![A-Za-z])|(?<=[a-z])(?:Per|per)(?=[A-Z_])", "/", text)
    text = re.sub(r"(?<=[A-Za-z0-9])\.(?=[A-Za-z])", "*", text)
    text = re.sub(r"[\s_]*([*/^])[\s_]*", r"\1", text)
    atom = _atom(text)
    if atom is not None:
        return atom
    tokens = _TOKEN.findall(text)
    if not tokens or "".join(tokens) != text or len(tokens) > 20:
        return None
    quotient = "/" not in text and "*" not in text and "-" not in text
    return _product(tokens, quotient)


def _product(tokens: list[str], quotient: bool) -> Unit | None:
    """A product of powers; all that follows a / within its brackets divides, as people mean ``deg/s``."""
    unit, sign, expects, signs = Unit(_ONE), 1, True, []
    last: Unit | None = None
    for token in tokens:
        if token == "(":
            signs.append(sign)
        elif token == ")":
            if not signs:
                return None
            sign = signs.pop()
        elif token in ("/", "*") and expects:
            return None
        elif token == "/":
            sign, expects = -(signs[-1] if signs else 1), True
        elif token in ("*", " ", "_"):
            expects = True
            if token == "_" and quotient and last is not None:
                sign = -1
        elif re.fullmatch(r"\^?[-+]?\d+", token) and not (expects and token == "1"):
            if last is None or abs(int(token.lstrip("^"))) > 9:
                return None
            power = int(token.lstrip("^"))
            unit = unit * last**-sign * last ** (sign * power)
            last = None
        else:
            atom = _atom(token)
            if atom is None or atom.summand or not expects:
                return None
            unit, last, expects = unit * atom**sign, atom, False
    return None if signs or expects else unit


def _atom(word: str) -> Unit | None:
    """A unit of one word."""
    exact = _symbol(word)
    if exact is not None:
        return exact
    lower = word.lower()
    for candidate in (lower, lower.removesuffix("s"), lower.removesuffix("es")):
        if candidate in _WORDS:
            symbol = _WORDS[candidate]
            return _symbol(symbol) or parse(symbol)
    matches = {s for s in (*_PREFIXED, *_ALONE) if len(s) > 1 and s.lower() in (lower, lower.removesuffix("s"))}
    if len(matches) == 1:
        return _symbol(matches.pop())
    # In capitals throughout: MM, MS, KHZ; never where a letter's size decides and the text is of both.
    return _symbol(lower) if word.isupper() and lower in ("s", "ms", "us", "mm", "cm", "km", "kg", "m") else None


def _symbol(word: str) -> Unit | None:
    if word in _ALONE:
        return _ALONE[word]
    if word in _PREFIXED:
        return _PREFIXED[word]
    for stem, unit in _PREFIXED.items():
        factor = _PREFIXES.get(word[: -len(stem)]) if word.endswith(stem) else None
        if factor is not None and not (stem in _SMALL and factor > 1e-3):
            return Unit(unit.dimension, factor * unit.factor)
    return None


def time_unit(text: str) -> str | None:
    """The unit of time other than the second that a unit, such as 1/h, is made with; None where there is none."""
    for word in re.findall(r"[^\W\d_]+", text):
        unit = parse(word)
        if unit is not None and unit.kind == "time" and unit.factor != 1.0:
            return word
    return None


def conversion(unit: str | None, to: str, where: object) -> tuple[float, float]:
    """Factor and summand that turn numbers in ``unit`` into numbers in ``to``.

    Arguments:
        unit: None means ``to``.
        to: the unit that the system has.
        where: the key, for messages.

    Raises:
        InputError: a unit is not known, or the two are of different kinds.
    """
    if unit is None or unit.strip() == to.strip():
        return 1.0, 0.0
    of, own = parse(unit), parse(to)
    has = f"the system has {to or 'a pure number'}"
    if of is None:
        listed = f"units of {own.kind}: {', '.join(_examples(own))}" if own else has
        raise InputError(where, f"the unit '{unit}' is not known", f"{listed}; or give factor and offset")
    if own is None or of.dimension != own.dimension:
        problem = f"'{unit}' is a unit of {of.kind}, {has}"
        raise InputError(where, problem, "correct the unit, or give factor and offset")
    return (1.0, 0.0) if of == own else (of.factor / own.factor, (of.summand - own.summand) / own.factor)


def _examples(like: Unit) -> list[str]:
    """Units of a kind that one may write."""
    common = ("rad", "deg", "mrad", "rad/s", "deg/s", "rpm", "s", "ms", "us", "m", "km", "cm", "mm", "m/s", "cm/s")
    return [s for s in dict.fromkeys((*common, "m/s2", "mV", "mA", *_PREFIXED, *_ALONE)) if s and _of(s, like)]


def _of(symbol: str, like: Unit) -> bool:
    unit = parse(symbol)
    return unit is not None and unit.dimension == like.dimension


@dataclass(frozen=True)
class Told:
    """What a column's header tells.

    Attributes:
        name: the header without its unit.
        unit: as it is written; empty where none is told.
        sure: whether the text can be nothing but a unit: it stands in brackets, behind a slash or in a row of units.
    """

    name: str
    unit: str = ""
    sure: bool = False

    def fits(self, to: str) -> bool:
        """Whether the unit, where one is told, is one of the kind of ``to``."""
        own, unit = parse(to), parse(self.unit)
        return own is not None and unit is not None and own.dimension == unit.dimension


def parse_header(header: str, row: str | None = None) -> Told:
    """Name and unit of a column's header, and of its cell in a row of units where the file has one."""
    inside = _of_header(header.strip())
    if row is not None and row.strip().strip("-–[]() "):
        return Told(inside.name if parse(inside.unit) else header.strip(), row.strip(), True)
    return inside


def _of_header(header: str) -> Told:
    match = _BRACKETS.match(header)
    if match and match[1].strip():
        inner = _of_header(match[1].strip()) if _BRACKETS.match(match[1].strip()) else None
        if inner is not None and parse(inner.unit) is not None and parse(match[2]) is None:  # theta [deg] (raw)
            return inner
        return Told(match[1].strip(), match[2].strip(), True) if match[2].strip() else Told(match[1].strip())
    match = _AFTER_WORD.match(header) or _AFTER_IN.match(header)
    if match and parse(match[2]) is not None:
        return Told(match[1].strip(), match[2].strip(), True)
    match = _IN.match(header)
    if match:  # theta in grad: a unit that is not understood
        return Told(match[1].strip(), match[2].strip(), True)
    whole = parse(header)
    if whole is not None and len(header) > 1 and header.lower() not in _UNSURE:
        return Told("", header)
    suffix = next((Told(name, unit) for name, unit in _suffixes(header) if parse(unit) is not None), None)
    if suffix is not None and "/" in suffix.unit:  # omega_rad/s
        return suffix
    match = _AFTER_SLASH.match(header)
    if match and parse(match[2]) is not None:  # not dtheta/dt
        return Told(match[1].strip(), match[2].strip(), True)
    return suffix or _in_front(header) or Told(header)


def _in_front(header: str) -> Told | None:
    """A header that begins with its unit, as deg_theta: of angles and their speeds alone, since a word before a name
    is seldom a unit."""
    for place in [m.start() for m in re.finditer(r"[_\s.\-]+", header)][::-1]:
        unit, name = header[:place], header[place:].strip("_ .-")
        of = parse(unit) if len(unit) > 1 and name else None
        if of is not None and of.kind in ("angle", "angular speed"):
            return Told(name, unit)
    return None


def _suffixes(header: str) -> Iterator[tuple[str, str]]:
    """Beginning and end of a header wherever a word may begin, the longest end first: theta_deg, omegaDegS."""
    places = [m.start() for m in re.finditer(r"[_\s.\-]+|(?<=[a-z0-9])(?=[A-Z°%µ])|(?<=[A-Za-z])(?=°)", header)]
    for place in places[-6:]:
        name, end = header[:place].strip("_ .-/"), header[place:].strip("_ .-")
        if name and end and end[0] != "/":
            words = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", end)
            for unit in (end, re.sub(r"[\s.\-]+", "_", words), end[0].lower() + end[1:]):  # timeMs
                yield name, unit


def unsure(text: str) -> bool:
    """Whether the end of a name, as of theta_min, is more often a word than a unit."""
    return len(text) == 1 or text.lower() in _UNSURE

"""What users are told of a value that cannot be used, in the words of a configuration file."""

from __future__ import annotations

import difflib
import json
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from expertaug.errors import InputError

TEXT_NUMBER = re.compile(r"[-+]?(\d[\d_]*\.?\d*|\.\d+)([eE][-+]?\d+)?")
PATTERNS = {
    "name": r"^[A-Za-z][A-Za-z0-9_]*$",
    "folder": r"^[^{}<>*?]+$",
    "sha256": r"^[0-9a-fA-F]{64}$",
}
_SAID = {
    PATTERNS["name"]: "begin with a letter; letters, digits and _ may follow",
    PATTERNS["folder"]: "name a folder, without { } < > * or ?",
    PATTERNS["sha256"]: "give the 64 hexadecimal digits that sha256sum prints",
}
KINDS = {
    "float": "a number",
    "finite_number": "a number",
    "int": "a whole number",
    "string": "a text",
    "bool": "true or false",
    "list": "a list",
    "tuple": "a list",
    "dict": "a mapping of keys",
    "model": "a mapping of keys",
}
# What people write, and what it is called here.
MEANT = {"gpu": "cuda", "none": "null", "off": "false", "on": "true"}


@dataclass(frozen=True)
class Described:
    """What is known of a place in settings: its keys with their descriptions, its own description, whether it may be
    null, and in which shapes it may be written."""

    keys: Mapping[str, str] = field(default_factory=dict)
    renamed: Mapping[str, str] = field(default_factory=dict)
    description: str = ""
    null: bool = False
    shapes: Iterable[str] = ()


def show(value: object) -> str:
    """A value as a short text that looks like YAML."""
    if isinstance(value, str):
        text = f"'{value}'"
    elif isinstance(value, float) and not math.isfinite(value):
        text = {"nan": ".nan", "inf": ".inf", "-inf": "-.inf"}[str(value)]
    elif isinstance(value, float):
        text = number_in(repr(value)) or repr(value)
    else:
        text = json.dumps(value, ensure_ascii=False, default=str)
    return text if len(text) <= 60 else f"{text[:57]}..."


def number_in(text: str) -> str | None:
    """The number in a text as YAML wants it written (``1e-3`` → ``1.0e-3``); None where it holds no number."""
    text = text.strip()
    match = TEXT_NUMBER.fullmatch(text)
    if match is None:
        return None
    if match[2] is None:
        return text
    mantissa, exponent = text[: -len(match[2])], match[2][1:]
    mantissa = mantissa if "." in mantissa else f"{mantissa}.0"
    return f"{mantissa}e{exponent if exponent[0] in '+-' else f'+{exponent}'}"


def suggest(name: object, candidates: Iterable[object]) -> str:
    """“did you mean …?” and what is known."""
    candidates = [str(k) for k in candidates]
    meant = MEANT.get(str(name).lower())
    close = [meant] if meant in candidates else difflib.get_close_matches(str(name), candidates, 1)
    return (f"did you mean '{close[0]}'? " if close else "") + f"known: {', '.join(candidates) or 'none'}"


def unknown(used: Iterable[str], candidates: Iterable[str], where: str, what: str) -> Iterator[InputError]:
    """Names in a list that are not known or are there twice; ``what`` says what the names are of."""
    candidates, used = list(candidates), list(used)
    for k, name in enumerate(used):
        yield from unknown_one(name, candidates, f"{where}[{k}]", what)
        if name in used[:k]:
            yield InputError(f"{where}[{k}]", f"'{name}' is there twice", f"name each {what} once")


def unknown_one(name: str, candidates: Iterable[str], where: str, what: str) -> Iterator[InputError]:
    """A name that is not known; the nearest known one is suggested."""
    if name not in candidates:
        yield InputError(where, f"'{name}' is no {what}", suggest(name, candidates))


def unknown_keys(used: Iterable[str], candidates: Iterable[str] | None, where: str, what: str) -> Iterator[InputError]:
    """Keys that are none of the known names; nothing where those are not known."""
    if candidates is None:
        return
    names = list(candidates)
    for name in used:
        yield from unknown_one(name, names, f"{where}.{name}", what)


def check_keys(used: Iterable[str], candidates: Iterable[str], where: str, what: str) -> None:
    """Refuse keys that are none of the known names.

    Raises:
        InputError: the first of them, what it may mean, and those that there are.
    """
    for error in unknown_keys(used, candidates, where, what):
        raise error


def other_parameters(used: Iterable[str], expected: Iterable[str], of: str) -> tuple[str, str] | None:
    """What was found and what would be right where ranges are not of the same parameters as those of something else."""
    used, expected = list(used), list(expected)
    if set(used) == set(expected):
        return None
    names = ", ".join(expected) or "none"
    return f"names {', '.join(used) or 'none'}", f"give a range for each parameter of {of}: {names}"


def is_multiple(value: float, step: float) -> bool:
    """Whether a value is a whole multiple of a step, 1 or more."""
    return abs(value / step - round(value / step)) < 1e-6 and round(value / step) >= 1


def path_of(where: str, parts: Sequence[str | int]) -> str:
    """``a.b[0]``; what tells shapes apart (``@…``) is left out."""
    named = [p for p in parts if not str(p).startswith("@")]
    text = "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in named)
    return f"{where}{text}".lstrip(".") or "configuration"


def explain(error: Mapping[str, Any], where: str, described: Callable[[Sequence[str | int]], Described]) -> InputError:
    """One of pydantic's complaints in words: the key, what was found, what would be right.

    Arguments:
        where: path of the block that was checked.
        described: what is known of a place in it.
    """
    loc, kind, value, context = list(error["loc"]), error["type"], error["input"], error.get("ctx", {})
    if kind == "missing" and isinstance(loc[-1], int):  # a list that is too short
        kind, loc, context = "length", loc[:-1], {}
    place, shown = path_of(where, loc), f"found {show(value)}"
    if loc and loc[-1] == "[key]":
        return InputError(
            path_of(where, loc[:-2]), f"found the name {shown[6:]}", "use letters, digits and _, a letter first"
        )
    if kind == "missing":
        meaning = described(loc).description
        return InputError(place, "missing", f"give {loc[-1]}" + (f" ({meaning})" if meaning else ""))
    if kind == "extra_forbidden":
        allowed = described(loc[:-1])
        remedy = allowed.renamed.get(str(loc[-1])) or suggest(loc[-1], allowed.keys)
        return InputError(place, "unknown key", remedy)
    if kind in ("wrong", "disagree"):
        block = path_of(where, loc) if where or loc else ""
        at = context["at"] if not block or context["at"].startswith("[") else f".{context['at']}"
        return InputError(f"{block}{at}".rstrip(".") or "configuration", context["found"], context["remedy"])
    if kind == "literal_error":
        allowed = [text or word.lower() for text, word in re.findall(r"'([^']*)'|(True|False)", context["expected"])]
        return InputError(place, shown, suggest(value, allowed))
    return InputError(place, *_of_a_value(kind, value, context, described(loc)))


def _of_a_value(kind: str, value: object, context: Mapping[str, Any], place: Described) -> tuple[str, str]:
    shown = f"found {show(value)}"
    if kind.startswith("union_tag"):
        return shown, f"give {' or '.join(place.shapes)}"
    stem = kind.removesuffix("_type")
    stem = {"model_attributes": "model", "int_from_float": "int", "mapping": "dict"}.get(stem, stem)
    if stem in KINDS:
        number = isinstance(value, str) and stem in ("float", "int") and number_in(value)
        if number:
            return f"{shown}, which YAML takes for a text", f"write {number}"
        return shown, f"give {KINDS[stem]}{' or null' if place.null else ''}"
    remedies = {
        "greater_than_equal": "give {ge} or more",
        "less_than_equal": "give {le} or less",
        "greater_than": "give more than {gt}",
        "less_than": "give less than {lt}",
        "multiple_of": "give a multiple of {multiple_of}",
        "too_short": "give {min_length} or more values" if isinstance(value, list | tuple) else "give at least one",
        "too_long": "give {max_length} values" if isinstance(value, list | tuple) else "give fewer",
        "length": "give 2 values",
        "string_too_short": "give a text",
        "string_too_long": "give a shorter text",
    }
    if kind == "string_pattern_mismatch":
        return shown, _SAID[context["pattern"]]
    if kind in remedies:
        numbers = {k: f"{v:g}" if isinstance(v, float) else v for k, v in context.items()}
        return shown, remedies[kind].format(**numbers)
    return shown, "correct it"

"""Names and keys that a configuration may use: whether they are known, and what to say where they are not."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from expertaug.errors import InputError
from expertaug.wording import suggest


def unknown(used: Iterable[str], known: Iterable[str], where: str, what: str) -> Iterator[InputError]:
    """Names in a list that are not known or are there twice; ``what`` says what the names are of."""
    known, used = list(known), list(used)
    for k, name in enumerate(used):
        yield from unknown_one(name, known, f"{where}[{k}]", what)
        if name in used[:k]:
            yield InputError(f"{where}[{k}]", f"'{name}' is there twice", f"name each {what} once")


def unknown_one(name: str, known: Iterable[str], where: str, what: str) -> Iterator[InputError]:
    """A name that is not known; the nearest known one is suggested."""
    if name not in known:
        yield InputError(where, f"'{name}' is no {what}", suggest(name, known))


def unknown_keys(used: Iterable[str], known: Iterable[str], where: str) -> Iterator[InputError]:
    """Keys that are not known."""
    for key in used:
        if key not in known:
            yield InputError(f"{where}.{key}", "unknown key", suggest(key, known))


def other_parameters(ranges: Mapping, expected: Iterable[str], where: str, of: str) -> Iterator[InputError]:
    """Ranges that are not of the same parameters as those of something else."""
    if set(ranges) != set(expected):
        names = ", ".join(expected) or "none"
        found = f"names {', '.join(ranges) or 'none'}"
        yield InputError(where, found, f"give a range for each parameter of {of}: {names}")

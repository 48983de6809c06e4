"""Names and keys that a configuration may use: whether they are known, and what to say where they are not."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping

from expertaug.errors import InputError


def suggest(name: object, known: Iterable[object]) -> str:
    """“did you mean …?” and what is known."""
    known = [str(k) for k in known]
    close = difflib.get_close_matches(str(name), known, 1)
    return (f"did you mean '{close[0]}'? " if close else "") + f"known: {', '.join(known) or 'none'}"


def require_all(used: Iterable[str], known: Iterable[str], where: str, what: str) -> None:
    """Every name must be known and be there once; ``what`` says what the names are of."""
    known = list(known)
    for k, name in enumerate(used):
        require(name, known, f"{where}[{k}]", what)
        if name in list(used)[:k]:
            raise InputError(f"{where}[{k}]", f"'{name}' is there twice", f"name each {what} once")


def require(name: str, known: Iterable[str], where: str, what: str) -> None:
    """A name must be known.

    Raises:
        InputError: it is not; the nearest known one is suggested.
    """
    if name not in known:
        raise InputError(where, f"'{name}' is no {what}", suggest(name, known))


def require_keys(where: str, used: Iterable[str], known: Iterable[str]) -> None:
    """Keys must be known."""
    for key in sorted(used):
        if key not in known:
            raise InputError(f"{where}.{key}", "unknown key", suggest(key, known))


def require_parameters(where: str, ranges: Mapping, expected: Iterable[str], of: str) -> None:
    """Ranges must be of the same parameters as those of something else."""
    if set(ranges) != set(expected):
        names = ", ".join(expected) or "none"
        raise InputError(
            where, f"names {', '.join(ranges) or 'none'}", f"give a range for each parameter of {of}: {names}"
        )

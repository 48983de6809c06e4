"""Reading a stage's settings: a mapping from the configuration into the stage's frozen dataclass."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import TypeVar

from expertaug.errors import InputError

T = TypeVar("T")


def read_settings(kind: type[T], settings: Mapping[str, object] | T | None, stage: str) -> T:
    """The dataclass ``kind`` filled from ``settings``; what is left out keeps its default.

    Raises:
        InputError: a key that the stage does not know, or text where a number belongs.
    """
    if settings is None:
        return kind()
    if isinstance(settings, kind):
        return settings
    known = {f.name: f for f in fields(kind)}
    for key, value in settings.items():
        if key not in known:
            raise InputError(f"{stage} settings", f"unknown key '{key}'", f"known are {', '.join(known)}")
        number = isinstance(known[key].default, int | float) and not isinstance(known[key].default, bool)
        if number and isinstance(value, str | bool):
            raise InputError(f"{stage} settings", f"{key} is {value!r}", "it must be a number")
    return kind(**settings)

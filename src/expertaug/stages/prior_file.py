"""Ranges that p⁺ has found: read from the file of the stage own-prior, and put into a stage's settings."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from expertaug.errors import InputError

if TYPE_CHECKING:
    from pydantic import JsonValue

    from expertaug.settings import Raw

OWN = "own"  # in the place of ranges
Ranges: TypeAlias = Mapping[str, Sequence[float]]


def read_ranges(path: Path) -> dict[str, list[float]]:
    """The ranges that the stage has written.

    Raises:
        InputError: no such file, or another one.
    """
    try:
        ranges = json.loads(Path(path).read_text(encoding="utf-8"))["ranges"]
        return {str(name): [float(low), float(high)] for name, (low, high) in ranges.items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(path, f"holds no ranges of p⁺ ({error})", "make it again with own-prior") from error


def with_ranges(settings: Raw, ranges: Ranges | None) -> Raw:
    """Settings of a stage in which p⁺'s ranges stand where ``prior`` is to find them itself.

    Raises:
        InputError: they are needed and not given.
    """

    def block(values: Raw) -> dict[str, JsonValue]:
        inside = {name: block(value) if isinstance(value, Mapping) else value for name, value in values.items()}
        if inside.get("prior") == OWN:
            if ranges is None:
                raise InputError("--prior", "missing", "p⁺ is to find its own ranges: give what own-prior wrote")
            inside["prior"] = {name: list(ends) for name, ends in ranges.items()}
        return inside

    return block(settings)

"""Ranges that p⁺ has found: read from the file of the stage own-prior, and put into a stage's settings."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

from expertaug.errors import InputError

OWN = "own"  # in the place of ranges


def read_ranges(path: Path) -> dict[str, list[float]]:
    """The ranges that the stage has written.

    Raises:
        InputError: no such file, or another one.
    """
    try:
        found = json.loads(Path(path).read_text(encoding="utf-8"))["ranges"]
        return {str(name): [float(low), float(high)] for name, (low, high) in found.items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(path, f"holds no ranges of p⁺ ({error})", "make it again with own-prior") from error


def with_ranges(settings: Mapping, ranges: Mapping | None) -> dict:
    """Settings of a stage in which p⁺'s ranges stand where ``prior`` is to find them itself.

    Raises:
        InputError: they are needed and not given.
    """

    def replaced(value: object) -> object:
        if not isinstance(value, Mapping):
            return value
        found = {key: replaced(one) for key, one in value.items()}
        if found.get("prior") == OWN:
            if ranges is None:
                raise InputError("--prior", "missing", "p⁺ is to find its own ranges: give what own-prior wrote")
            found["prior"] = dict(ranges)
        return found

    found = replaced(settings)
    assert isinstance(found, dict)
    return found

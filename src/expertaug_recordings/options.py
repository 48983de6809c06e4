"""Reading a stage's settings: a mapping from the configuration into the stage's model."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

from expertaug.settings import Settings, read

T = TypeVar("T", bound=Settings)


def read_settings(kind: type[T], settings: Mapping[str, object] | T | None, stage: str) -> T:
    """The settings ``kind`` from a mapping; what is left out keeps its default.

    Raises:
        InputError: a key that the stage does not know, or a value that cannot be used.
    """
    return read(kind, settings, f"{stage} settings")

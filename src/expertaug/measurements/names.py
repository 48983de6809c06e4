"""What a system calls its components and parameters: all that measurements need to know of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Names:
    """Components of the state and expert parameters with their units, in order."""

    state: Mapping[str, str]
    parameters: Mapping[str, str]

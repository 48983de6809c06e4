"""What a system calls its components and parameters: all that measurements need to know of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Names:
    """Components of the state, expert parameters and known inputs with their units, in order.

    Attributes:
        inputs: inputs, then covariates.
        constant: the covariates, which are constant along a trajectory.
        held: whether an input holds its value until the next; else it is linear in between.
        rates: component → the component whose rate of change it is.
        timed: whether the expert depends on t itself, which counts from a chunk's first point.
    """

    state: Mapping[str, str]
    parameters: Mapping[str, str]
    inputs: Mapping[str, str] = field(default_factory=dict)
    constant: frozenset[str] = frozenset()
    held: bool = False
    rates: Mapping[str, str] = field(default_factory=dict)
    timed: bool = False

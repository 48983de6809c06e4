"""Simulations as precise as their tests ask for, where the simulation is not what is tested."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

import pytest

from expertaug.systems import System
from expertaug.systems.solvers.solver import Solver

if TYPE_CHECKING:
    from collections.abc import Iterator


@contextmanager
def quickly() -> Iterator[None]:
    """Of all systems without a solver of their own: errors of 1e-6, far below any noise, in a third of the time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(System, "simulation", Solver("dopri5", rtol=1e-6, atol=1e-6))
        yield


@pytest.fixture(autouse=True, scope="module")
def quick_simulations():
    """In all tests of a room whose conftest has this fixture; fixtures of the session are made before it."""
    with quickly():
        yield

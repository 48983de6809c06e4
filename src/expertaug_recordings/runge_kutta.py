"""One step of the classical Runge-Kutta method, for tensors and arrays alike."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

State = TypeVar("State")  # a tensor or an array of any shape


def step(slope: Callable[[State], State], y: State, h: float) -> State:
    """The state of dy/dt = slope(y) a time ``h`` after ``y``, by the classical method of fourth order.

    torchdiffeq's ``rk4`` is another method of that order (the 3/8 rule), with other bits.
    """
    k1 = slope(y)
    k2 = slope(y + h / 2 * k1)
    k3 = slope(y + h / 2 * k2)
    k4 = slope(y + h * k3)
    return y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)

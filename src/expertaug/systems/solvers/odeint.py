"""torchdiffeq's solvers, imported without scipy.integrate.

That costs a third of what torch costs, in every job, and only torchdiffeq's method ``scipy_solver`` calls it, which
nothing here offers; it still works where somebody else asks for it.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable
from types import ModuleType
from typing import Any

from torch import Tensor

__all__ = ["odeint", "on_grid"]

NAME = "scipy.integrate"


def _solve_ivp(*arguments: Any, **options: Any) -> Any:
    return importlib.import_module(NAME).solve_ivp(*arguments, **options)


if NAME in sys.modules:
    from torchdiffeq import odeint
    from torchdiffeq._impl import fixed_grid
else:
    sys.modules[NAME] = ModuleType(NAME)
    sys.modules[NAME].solve_ivp = _solve_ivp  # type: ignore[attr-defined]
    try:
        from torchdiffeq import odeint
        from torchdiffeq._impl import fixed_grid
    finally:
        del sys.modules[NAME]

STEPS = {"euler": fixed_grid.Euler, "midpoint": fixed_grid.Midpoint, "rk4": fixed_grid.RK4}


def on_grid(f: Callable[[Tensor, Tensor], Tensor], y0: Tensor, t: Tensor, method: str) -> Tensor:
    """States (T, *y0.shape) at the times t (T,), the first being y0, by a step of ``method`` from time to time.

    The same as ``odeint``, which moves the times to where y0 lies and compares them there after every step: on a card
    each comparison would wait for it.  Here they are on the CPU, and so is the single number that f is given.
    """
    return STEPS[method](func=_Field(f), y0=y0, atol=0.0).integrate(t.cpu())


class _Field:
    """dy/dt as torchdiffeq's steps call it."""

    def __init__(self, f: Callable[[Tensor, Tensor], Tensor]) -> None:
        self.f = f

    def __call__(self, t: Tensor, y: Tensor, **unused: Any) -> Tensor:
        return self.f(t.to(y.dtype), y)

    def callback_step(self, *unused: Any) -> None:
        """Called before a step."""

"""torchdiffeq's odeint, imported without scipy.integrate.

That costs a third of what torch costs, in every job, and only torchdiffeq's method ``scipy_solver`` calls it, which
nothing here offers; it still works where somebody else asks for it.
"""

from __future__ import annotations

import importlib
import sys
from types import ModuleType
from typing import Any

__all__ = ["odeint"]

NAME = "scipy.integrate"


def _solve_ivp(*arguments: Any, **options: Any) -> Any:
    return importlib.import_module(NAME).solve_ivp(*arguments, **options)


if NAME in sys.modules:
    from torchdiffeq import odeint
else:
    sys.modules[NAME] = ModuleType(NAME)
    sys.modules[NAME].solve_ivp = _solve_ivp  # type: ignore[attr-defined]
    try:
        from torchdiffeq import odeint
    finally:
        del sys.modules[NAME]

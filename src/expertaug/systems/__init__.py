"""Physical systems, one module each."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Mapping
from typing import TYPE_CHECKING

from expertaug.errors import InputError

if TYPE_CHECKING:
    from expertaug.systems.base import Parameter, System

__all__ = ["Parameter", "System", "load"]


def __getattr__(name: str) -> object:
    """The classes of :mod:`expertaug.systems.base`, which load torch, when they are asked for."""
    if name in ("Parameter", "System"):
        return getattr(importlib.import_module(f"{__name__}.base"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def load(settings: Mapping[str, object]) -> System:
    """Make the system that ``settings`` describes.

    Arguments:
        settings: ``name`` is a module of this package or a dotted path of one elsewhere, which defines one
            :class:`System`; the other keys are its constructor's arguments.

    Raises:
        InputError: there is no such module, it defines no system, or the constructor refuses an argument.
    """
    from expertaug.systems.base import System

    arguments = dict(settings)
    name = str(arguments.pop("name", ""))
    try:
        module = importlib.import_module(name if "." in name else f"{__name__}.{name}")
    except ModuleNotFoundError as error:
        raise InputError(
            "system.name", f"no module for {name!r}", "name a module of expertaug.systems or a dotted path"
        ) from error
    classes = [
        c
        for _, c in inspect.getmembers(module, inspect.isclass)
        if issubclass(c, System) and c.__module__ == module.__name__
    ]
    if len(classes) != 1:
        raise InputError(
            "system.name", f"{module.__name__} defines {len(classes)} systems", "one System class a module"
        )
    known = list(inspect.signature(classes[0]).parameters)
    for key in arguments:
        if key not in known:
            raise InputError(f"system.{key}", f"unknown to {name}", f"known: {', '.join(known) or 'none'}")
    return classes[0](**arguments)

"""Physical systems, one module each."""

from __future__ import annotations

import dataclasses
import importlib
import inspect
from collections.abc import Mapping
from typing import Any

from expertaug.errors import InputError
from expertaug.systems.base import Parameter, System

__all__ = ["Parameter", "System", "describe", "load"]


def load(settings: Mapping[str, Any]) -> System:
    """Make the system that ``settings`` describes.

    Arguments:
        settings: ``name`` is a module of this package, a dotted path of one elsewhere which defines one
            :class:`System`, or ``package.module:Class``; the other keys are the constructor's arguments.

    Raises:
        InputError: there is no such module, it defines no system, or the constructor refuses an argument.
    """
    arguments = dict(settings)
    name = str(arguments.pop("name", ""))
    cls = _class(name)
    known = list(inspect.signature(cls).parameters)
    for key in arguments:
        if key not in known:
            raise InputError(f"system.{key}", f"unknown to {name}", f"known: {', '.join(known) or 'none'}")
    return cls(**arguments)


def _class(name: str) -> type[System]:
    path, _, chosen = name.partition(":")
    try:
        module = importlib.import_module(path if "." in path or chosen else f"{__name__}.{path}")
    except ModuleNotFoundError as error:
        raise InputError(
            "system.name", f"no module for {name!r}", "name a module of expertaug.systems or a dotted path"
        ) from error
    if chosen:
        found = getattr(module, chosen, None)
        if not (inspect.isclass(found) and issubclass(found, System)):
            raise InputError("system.name", f"{path} has no system {chosen!r}", "name a subclass of expertaug.System")
        return found
    classes = [
        c
        for _, c in inspect.getmembers(module, inspect.isclass)
        if issubclass(c, System) and c.__module__ == module.__name__
    ]
    if len(classes) != 1:
        raise InputError(
            "system.name", f"{module.__name__} defines {len(classes)} systems", "one System class a module"
        )
    return classes[0]


def describe(system: System) -> dict[str, object]:
    """What :func:`load` makes the system from again: ``name`` and what its constructor was given."""
    cls = type(system)
    short = cls.__module__.removeprefix(f"{__name__}.")
    name = f"{cls.__module__}:{cls.__qualname__}" if short == cls.__module__ else short
    if dataclasses.is_dataclass(system):
        given = {f.name: getattr(system, f.name) for f in dataclasses.fields(system) if f.init}
    else:
        positional, named = system._given
        given = inspect.signature(cls).bind(*positional, **named).arguments
    return {"name": name, **given}

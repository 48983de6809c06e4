"""Physical systems, one module each."""

from __future__ import annotations

import importlib
import inspect
import json
import sys
from collections.abc import Mapping

from expertaug.errors import InputError
from expertaug.systems.base import Parameter, System

__all__ = ["Parameter", "System", "describe", "load"]


def load(settings: Mapping[str, object]) -> System:
    """Make the system that ``settings`` describes.

    Arguments:
        settings: ``name`` is a module of this package or a dotted path of one elsewhere, which defines one
            :class:`System`; the other keys are its constructor's arguments.

    Raises:
        InputError: there is no such module, it defines no system, or the constructor refuses an argument.
    """
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


def describe(system: System) -> dict:
    """The settings from which :func:`load` makes a system like this one.

    Raises:
        InputError: its class cannot be found again by its module, or an argument cannot be written to a file.
    """
    cls = type(system)
    module = cls.__module__.removeprefix(f"{__name__}.")
    here = [c for _, c in inspect.getmembers(sys.modules.get(cls.__module__), inspect.isclass)]
    if module == "__main__" or cls not in here:
        remedy = "define it at the top of a module of its own, which Python can import"
        raise InputError("system", f"the class {cls.__qualname__} cannot be found again from a file", remedy)
    positional, named = system._given
    settings = inspect.signature(cls).bind(*positional, **named).arguments
    for key, value in settings.items():
        try:
            settings[key] = json.loads(json.dumps(value, allow_nan=False))
        except (TypeError, ValueError) as error:
            found = f"{cls.__name__} cannot be written to a file ({error})"
            raise InputError(f"system.{key}", found, "give numbers, texts, lists or mappings") from error
    return {"name": module, **settings}

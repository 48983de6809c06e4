"""Classes that a configuration names by a short ``kind`` or as ``package.module:Class``, found and looked at.

What kinds there are stands beside their settings (:mod:`expertaug.models.settings`,
:mod:`expertaug.learning.settings`), by name alone: nothing is imported before a class is asked for, so that no command
waits for torch without need.
"""

from __future__ import annotations

import importlib
import importlib.util
import inspect
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

from expertaug.errors import InputError
from expertaug.wording import suggest


@dataclass(frozen=True)
class Part:
    """One of the parts that a model or its training is made of.

    Attributes:
        name: encoder, interaction or objective.
        kinds: ``package.module:Class`` of the package's own, by kind.
        base: what every class of the part is.
        needed: the method that a class must define beyond its base.
        given: arguments that the package gives, to a class that takes them; the configuration gives the rest.
    """

    name: str
    kinds: Mapping[str, str]
    base: str
    needed: str
    given: tuple[str, ...]


def full_name(part: Part, kind: str, where: str) -> str:
    """``package.module:Class`` of a kind of a part.

    Raises:
        InputError: the kind is neither known nor of that form.
    """
    kinds = part.kinds
    if isinstance(kind, str) and ":" in (kind := short_name(part, kind)):
        return kind
    if not isinstance(kind, str) or kind not in kinds:
        raise InputError(where, f"{kind!r} is no {part.name}", f"{suggest(kind, kinds)}, or package.module:Class")
    return kinds[kind]


def short_name(part: Part, name: str) -> str:
    """The kind that stands for a class of the package's own; any other name as it is.

    The class counts, not its module: files of earlier versions have some where they stood then.
    """
    module, _, wanted = name.partition(":")
    own = module.startswith("expertaug.")
    return next((kind for kind, full in part.kinds.items() if own and full.partition(":")[2] == wanted), name)


def find(part: Part, kind: str, where: str) -> type:
    """The class of a kind.

    Raises:
        InputError: there is no such kind, module or class, or the class cannot be used as ``part``.
    """
    return check(part, _import(full_name(part, kind, where), where), where)


def check(part: Part, cls: Any, where: str) -> type:
    """A class that can be used as ``part``: the one given.

    Raises:
        InputError: it is no class, has another base, is abstract or lacks the method that every one of its part has.
    """
    base, needed = _import(part.base, where), part.needed
    family = part.base.replace(":", ".")
    if not inspect.isclass(cls):
        raise InputError(where, f"{getattr(cls, '__name__', cls)!r} is no class", f"name a subclass of {family}")
    if not issubclass(cls, base):
        raise InputError(where, f"the class {cls.__name__} is no {base.__name__}", f"make it a subclass of {family}")
    if inspect.isabstract(cls):
        missing = ", ".join(sorted(cls.__abstractmethods__))
        raise InputError(where, f"the class {cls.__name__} is abstract", f"define {missing}")
    if getattr(cls, needed) is getattr(base, needed):
        raise InputError(where, f"the class {cls.__name__} does not define {needed}", f"every {part.name} needs it")
    return cls


def arguments(cls: type) -> list[str] | None:
    """Names of a constructor's arguments; None where it takes any.

    ``**kwargs`` stand for the arguments of the next class in the order of inheritance, to which they are handed on.
    """
    names: list[str] = []
    handed_on = False
    for ancestor in cls.__mro__:
        if "__init__" not in vars(ancestor):
            continue
        if ancestor is object or ancestor is _import("torch.nn:Module", "torch"):
            return None if handed_on else names
        own = list(inspect.signature(ancestor.__init__).parameters.values())[1:]
        names += [p.name for p in own if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY) and p.name not in names]
        handed_on = any(p.kind is p.VAR_KEYWORD for p in own)
        if not handed_on:
            break
    return names


def import_named(module: str, where: str) -> ModuleType:
    """A module by its name.

    Raises:
        InputError: there is none, or importing it fails.
    """
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name and (module == error.name or module.startswith(f"{error.name}.")):
            raise InputError(where, f"no module '{module}'", _how_to_find(module)) from error
        raise InputError(where, f"{module} imports '{error.name}', which is not there", "install it") from error
    except InputError:
        raise
    except SyntaxError as error:
        raise InputError(f"{error.filename}:{error.lineno}", f"no Python ({error.msg})", "correct that file") from error
    except Exception as error:
        problem = f"{module} cannot be imported ({type(error).__name__}: {error})"
        raise InputError(where, problem, "correct that file") from error


def _how_to_find(module: str) -> str:
    """What helps where a module is not found: it may lie in this very folder, or be named with its class."""
    first, _, rest = module.partition(".")
    if Path(f"{first}.py").is_file() or (Path(first) / "__init__.py").is_file():
        if rest and importlib.util.find_spec(first) is not None:
            return f"give {':'.join(module.rsplit('.', 1))} for a class of {module.rpartition('.')[0]}"
        return f"{first} lies in this folder, which Python does not look into: export PYTHONPATH=$PWD"
    return "is its package installed, or on PYTHONPATH?"


def _import(name: str, where: str) -> Any:
    """What ``package.module:Name`` is."""
    module, _, attribute = name.partition(":")
    try:
        return getattr(import_named(module, where), attribute)
    except AttributeError as error:
        raise InputError(where, f"no class '{attribute}' in {module}", "correct the name") from error

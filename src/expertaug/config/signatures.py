"""Classes of one's own that a configuration names: what they take and what they have, asked of the class itself.

Only what looks like ``package.module:Class`` (a system: ``package.module``) is imported, and only for classes from
elsewhere; the package's own kinds are described in the ``settings.py`` beside them.
"""

from __future__ import annotations

import inspect
import re
import sys
import types
import typing
from collections.abc import Iterator, Mapping

from expertaug import registry
from expertaug.errors import InputError
from expertaug.learning.settings import ALL_PARTS
from expertaug.wording import number_in, show, suggest

PATH = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*")
# Arguments that the package itself gives; the configuration gives the rest.
GIVEN = {**{name: set(part.given) for name, part in ALL_PARTS.items()}, "system": set()}
# What a class must define that inherits it from this package alone.
NEEDED = {"System": ("state", "expert_parameters", "expert")}
OF_SIMULATIONS = ("truth", "sample_initial_state")
SIMPLE = {int: "a whole number", float: "a number", str: "a text", bool: "true or false"}


def load_system(name: str, where: str) -> type:
    """The System that ``package.module:Class`` names, or the one that ``package.module`` defines.

    Raises:
        InputError: there is not one, or it lacks what a system needs.
    """
    path, colon, chosen = name.partition(":")
    if not PATH.fullmatch(path) or (colon and not chosen.isidentifier()):
        raise InputError(where, f"found {show(name)}", "name it as package.module or package.module:Class")
    module = registry.import_named(path, where)
    # A module that has not loaded the base class, and torch with it, defines no System.
    base = getattr(sys.modules.get("expertaug.systems.base"), "System", ())
    classes = [c for c in vars(module).values() if isinstance(c, type) and issubclass(c, base)]
    own = [c for c in classes if c.__module__ == path]
    matches = [c for c in classes if c.__name__ == chosen] if colon else own
    if len(matches) != 1:
        number = f"no System '{chosen}'" if colon else f"{len(own)} systems" if own else "no System"
        remedy = suggest(chosen, [c.__name__ for c in own]) if colon else "name one class whose base is System"
        raise InputError(where, f"{path} defines {number}", remedy if colon else f"{remedy}: {path}:Class")
    _require(matches[0], (), where)
    return matches[0]


def require_simulation(system: type, where: str) -> None:
    """A system's class must say how it is simulated."""
    _require(system, OF_SIMULATIONS, where)


def names_of(system: type, attribute: str) -> list[str] | None:
    """Names in one of a system's tuples of parameters; None where only the constructor makes it."""
    value = getattr(system, attribute, None)
    return [p.name for p in value] if isinstance(value, tuple) else None


def has_events(kind: type) -> bool:
    """Whether a system's class defines an event, and not only the base of all systems."""
    return next(parent for parent in kind.__mro__ if "event" in vars(parent)).__module__ != "expertaug.systems.base"


def takes(kind: type, argument: str) -> bool:
    """Whether a class's constructor names an argument."""
    return argument in _parameters(kind)


def accepts(kind: type, part: str, option: str) -> bool:
    """Whether a configuration may give a class this option."""
    parameters = _parameters(kind)
    anything = any(p.kind is p.VAR_KEYWORD for p in parameters.values())
    return option not in GIVEN[part] and (option in parameters or anything)


def wrong_options(kind: type, part: str, options: dict[str, typing.Any], where: str) -> Iterator[InputError]:
    """Options that a class's constructor does not take, that it needs, or that contradict a simple annotation.

    A class that takes ``**kwargs`` takes any option.
    """
    parameters = _parameters(kind)
    anything = any(p.kind is p.VAR_KEYWORD for p in parameters.values())
    named = {n: p for n, p in parameters.items() if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY)}
    settable = [n for n in named if n not in GIVEN[part]]
    hints = _hints(kind)
    for name, value in options.items():
        if name in GIVEN[part]:
            yield InputError(f"{where}.{name}", "given by the package", "remove it")
        elif name not in settable and not anything:
            yield InputError(f"{where}.{name}", "unknown key", suggest(name, settable))
        elif name in hints:
            yield from _misfit(value, hints[name], f"{where}.{name}")
    for name in settable:
        if named[name].default is inspect.Parameter.empty and name not in options:
            yield InputError(f"{where}.{name}", "missing", f"{kind.__name__} needs it")


def _misfit(value: object, hint: object, where: str) -> Iterator[InputError]:
    """A scalar that is not what a simple annotation says; anything else is left to the class."""
    union = typing.get_origin(hint) in (typing.Union, types.UnionType)
    wanted = typing.get_args(hint) if union else (hint,)
    if any(kind not in (*SIMPLE, type(None)) for kind in wanted):
        return
    fits = type(value) in wanted or (type(value) is int and float in wanted)
    if not fits:
        number = isinstance(value, str) and {int, float} & set(wanted) and number_in(value)
        text = " or ".join(SIMPLE.get(kind, "null") for kind in wanted)
        problem = f"found {show(value)}" + (", which YAML takes for a text" if number else "")
        yield InputError(where, problem, f"write {number}" if number else f"give {text}")


def _parameters(kind: type) -> Mapping[str, inspect.Parameter]:
    try:
        return inspect.signature(kind).parameters
    except (TypeError, ValueError):
        return {"options": inspect.Parameter("options", inspect.Parameter.VAR_KEYWORD)}


def _hints(kind: type) -> Mapping[str, object]:
    try:
        return typing.get_type_hints(kind.__init__)
    except Exception:
        return {}


def _require(kind: type, names: tuple[str, ...], where: str) -> None:
    """What a class must define and this package's base class does not."""
    for base in kind.__mro__:
        if base.__module__.startswith("expertaug.") and base.__name__ in NEEDED:
            for name in (*NEEDED[base.__name__], *names):
                if getattr(kind, name, None) is getattr(base, name, None) and not is_set_by_constructor(kind, name):
                    remedy = f"a {base.__name__} needs it"
                    raise InputError(where, f"the class {kind.__name__} does not define {name}", remedy)


def is_set_by_constructor(kind: type, name: str) -> bool:
    """Whether a constructor of the class sets an attribute."""
    own = (inspect.unwrap(vars(base)["__init__"]) for base in kind.__mro__ if "__init__" in vars(base))
    return any(name in code.co_names for init in own if (code := getattr(init, "__code__", None)) is not None)

"""Recipes and their parts as names and plain values, which a file can hold; and the way back."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from functools import partial
from typing import Any

from expertaug import systems
from expertaug.errors import InputError
from expertaug.models.recipe import HybridModel
from expertaug.registry import KINDS, find
from expertaug.systems import System

PARTS = ("encoder", "interaction")
SYSTEMS = "expertaug.systems."


def settings_of(part: str, given: Mapping | Callable) -> dict:
    """A part of a model, or an objective, as ``{"kind": …}`` and its arguments.

    Arguments:
        part: encoder, interaction or objective.
        given: such a mapping, a class, or a functools.partial of one with arguments by name.

    Raises:
        InputError: something without a name: a lambda, an instance, a partial with positional arguments.
    """
    if isinstance(given, Mapping):
        return dict(given)
    made, arguments = (given.func, dict(given.keywords)) if isinstance(given, partial) else (given, {})
    name = getattr(made, "__qualname__", "<instance>")
    if name.endswith(">") or not callable(made):
        raise InputError(part, f"found {type(given).__name__} {name}", "give a class, or functools.partial of a class")
    if isinstance(given, partial) and given.args:
        raise InputError(part, f"{name} with arguments by position", "give functools.partial arguments by name")
    return {"kind": _short(part, f"{made.__module__}:{name}"), **arguments}


def class_of(part: str, given: Mapping | Callable) -> dict[str, Callable]:
    """The class of a part by its name, where it is not one of this package's; of a mapping nothing."""
    if isinstance(given, Mapping) or is_built_in(part, kind := str(settings_of(part, given)["kind"])):
        return {}
    return {kind: given.func if isinstance(given, partial) else given}


def describe(recipe: HybridModel) -> dict:
    """What a model file says of a recipe: system, model, expert, interaction."""
    given = {part: getattr(recipe, part) for part in PARTS}
    return {
        "system": systems.describe(recipe.system),
        "model": {part: settings_of(part, value) for part, value in given.items() if value is not None},
        "expert": recipe.expert,
        "interaction": recipe.interaction is not None,
    }


def own_classes(recipe: HybridModel) -> dict[str, Callable]:
    """Classes of a recipe that are not this package's, by name."""
    found: dict[str, Callable] = {}
    for part in PARTS:
        if (given := getattr(recipe, part)) is not None:
            found |= class_of(part, given)
    name = str(systems.describe(recipe.system)["name"])
    return found if _is_built_in_system(name) else {name: type(recipe.system)} | found


def recipe_of(system: System, description: Mapping, classes: Mapping[str, Callable] | None = None) -> HybridModel:
    """The recipe that :func:`describe` described.

    Arguments:
        system: what :func:`system_of` gives.
        classes: by name, instead of what importing the name would give.
    """
    classes = classes or {}
    model = description["model"]
    interaction = model["interaction"] if description["interaction"] else None
    return HybridModel(
        system,
        _with_class(model["encoder"], classes),
        interaction if interaction is None else _with_class(interaction, classes),
        description["expert"],
    )


def system_of(description: Mapping, classes: Mapping[str, Callable] | None = None) -> System:
    """The system that a description names."""
    settings = dict(description["system"])
    made = (classes or {}).get(str(settings.get("name")))
    if made is None:
        return systems.load(settings)
    del settings["name"]
    return made(**settings)


def objective_of(kind: str, classes: Mapping[str, Callable] | None = None) -> Any:
    """The class of an objective's kind."""
    return (classes or {}).get(kind) or find("objective", kind, "objective")


def foreign(description: Mapping) -> Iterator[str]:
    """Names of what a description would import that is not this package's."""
    name = str(description["system"].get("name"))
    if not _is_built_in_system(name):
        yield name
    if description["kind"] != "hybrid":
        return
    parts = {part: settings["kind"] for part, settings in description["model"].items() if part in PARTS}
    parts |= {"objective": description["objective"]} if "objective" in description else {}
    for part, kind in parts.items():
        if not is_built_in(part, str(kind)):
            yield str(kind)


def trusted(given: Collection[str | Callable]) -> tuple[set[str], dict[str, Callable]]:
    """Names that may be imported, and classes by name, from a list of both."""
    if isinstance(given, str) or not isinstance(given, Collection):
        raise InputError("classes", f"found {given!r}", "give a list of classes or of their names, module:Class")
    made = {f"{c.__module__}:{c.__qualname__}": c for c in given if not isinstance(c, str)}
    # A system may be named by its module alone.
    made |= {c.__module__: c for c in made.values() if isinstance(c, type) and issubclass(c, System)}
    return {c for c in given if isinstance(c, str)} | set(made), made


def is_built_in(part: str, kind: str) -> bool:
    """Whether a kind is one that this package names."""
    return kind in KINDS[part] or kind in KINDS[part].values()


def _is_built_in_system(name: str) -> bool:
    return name.removeprefix(SYSTEMS).isidentifier()


def _short(part: str, name: str) -> str:
    return next((kind for kind, full in KINDS[part].items() if full == name), name)


def _with_class(settings: Mapping, classes: Mapping[str, Callable]) -> Mapping | Callable:
    made = classes.get(str(settings.get("kind")))
    return settings if made is None else partial(made, **{k: v for k, v in settings.items() if k != "kind"})

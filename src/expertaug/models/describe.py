"""Recipes and their parts as names and plain values, which a file can hold; and the way back."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from functools import partial

from expertaug import systems
from expertaug.errors import InputError
from expertaug.models.card import ModelCard, RecipeRecord
from expertaug.models.decoder import Decoder
from expertaug.models.hybrid import HybridModel, build_decoder
from expertaug.models.settings import PARTS
from expertaug.registry import Part, short_name
from expertaug.systems import System

OWN = "expertaug."  # what names of the package begin with
SYSTEMS = "expertaug.systems."


def settings_of(part: Part, spec: Mapping | Callable) -> dict:
    """A part of a model, or an objective, as ``{"kind": …}`` and its arguments.

    Arguments:
        spec: such a mapping, a class, or a functools.partial of one with arguments by name.

    Raises:
        InputError: something without a name: a lambda, an instance, a partial with positional arguments.
    """
    if isinstance(spec, Mapping):
        return dict(spec)
    made, arguments = (spec.func, dict(spec.keywords)) if isinstance(spec, partial) else (spec, {})
    name = getattr(made, "__qualname__", "<instance>")
    if name.endswith(">") or not callable(made):
        raise InputError(
            part.name, f"found {type(spec).__name__} {name}", "give a class, or functools.partial of a class"
        )
    if isinstance(spec, partial) and spec.args:
        raise InputError(part.name, f"{name} with arguments by position", "give functools.partial arguments by name")
    return {"kind": short_name(part, f"{made.__module__}:{name}"), **arguments}


def class_of(part: Part, spec: Mapping | Callable) -> dict[str, Callable]:
    """The class of a part by its name, where it is not one of this package's; of a mapping nothing."""
    if isinstance(spec, Mapping) or is_built_in(kind := str(settings_of(part, spec)["kind"])):
        return {}
    return {kind: spec.func if isinstance(spec, partial) else spec}


def describe(recipe: HybridModel) -> RecipeRecord:
    """What a model file says of a recipe."""
    parts = {name: getattr(recipe, name) for name in PARTS}
    return RecipeRecord.of(
        system=systems.describe(recipe.system),
        model={name: settings_of(PARTS[name], value) for name, value in parts.items() if value is not None},
        expert=recipe.expert,
        interaction=recipe.interaction is not None,
        shared=list(recipe.shared),
    )


def own_classes(recipe: HybridModel) -> dict[str, Callable]:
    """Classes of a recipe that are not this package's, by name."""
    classes: dict[str, Callable] = {}
    for name, part in PARTS.items():
        if (value := getattr(recipe, name)) is not None:
            classes |= class_of(part, value)
    name = str(systems.describe(recipe.system)["name"])
    return classes if _is_built_in_system(name) else {name: type(recipe.system)} | classes


def recipe_of(system: System, card: RecipeRecord, classes: Mapping[str, Callable] | None = None) -> HybridModel:
    """The recipe that :func:`describe` described.

    Arguments:
        system: what :func:`system_of` gives.
        classes: by name, instead of what importing the name would give.
    """
    classes = classes or {}
    encoder, interaction = card.model.encoder, card.model.interaction if card.interaction else None
    if encoder is None or (card.interaction and interaction is None):
        raise InputError("model", "lacks a part", "give encoder and interaction")
    return HybridModel(
        system,
        _with_class(encoder, classes),
        interaction if interaction is None else _with_class(interaction, classes),
        card.expert,
        tuple(card.shared),
    )


def decoder_of(system: System, card: ModelCard, classes: Mapping[str, Callable] | None = None) -> Decoder:
    """The decoder without an encoder, of a card of kind alternating; arguments as :func:`recipe_of`."""
    if card.model.interaction is None or card.latent_size is None:
        raise InputError("model", "lacks what is learned", "give interaction and latent_size")
    interaction = _with_class(card.model.interaction, classes or {})
    return build_decoder(system, interaction, card.latent_size, card.seeds, card.t[: card.observed])


def system_of(card: RecipeRecord, classes: Mapping[str, Callable] | None = None) -> System:
    """The system that a card names."""
    settings = dict(card.system)
    made = (classes or {}).get(str(settings.get("name")))
    if made is None:
        return systems.load(settings)
    del settings["name"]
    return made(**settings)


def foreign(card: ModelCard, has_parts: bool = True) -> Iterator[str]:
    """Names of what a card would import that is not this package's.

    Arguments:
        has_parts: whether its kind learns networks, so that what the card says of encoder and interaction is made.
    """
    if ":" in card.kind and not card.kind.startswith(OWN):
        yield card.kind
    name = card.system_name
    if not _is_built_in_system(name):
        yield name
    if not has_parts:
        return
    kinds = [str(part["kind"]) for part in (card.model.encoder, card.model.interaction) if part is not None]
    kinds += [card.objective] if card.objective is not None else []
    yield from (kind for kind in kinds if not is_built_in(kind))


def list_trusted(classes: Collection[str | Callable]) -> tuple[set[str], dict[str, Callable]]:
    """Names that may be imported, and classes by name, from a list of both."""
    if isinstance(classes, str) or not isinstance(classes, Collection):
        raise InputError("classes", f"found {classes!r}", "give a list of classes or of their names, module:Class")
    made = {f"{c.__module__}:{c.__qualname__}": c for c in classes if not isinstance(c, str)}
    # A system may be named by its module alone.
    made |= {c.__module__: c for c in made.values() if isinstance(c, type) and issubclass(c, System)}
    return {c for c in classes if isinstance(c, str)} | set(made), made


def is_built_in(kind: str) -> bool:
    """Whether a kind is a short one, or names one of the package's own parts."""
    return any(":" not in short_name(part, kind) for part in PARTS.values())


def _is_built_in_system(name: str) -> bool:
    return name.removeprefix(SYSTEMS).isidentifier()


def _with_class(settings: Mapping, classes: Mapping[str, Callable]) -> Mapping | Callable:
    made = classes.get(str(settings.get("kind")))
    return settings if made is None else partial(made, **{k: v for k, v in settings.items() if k != "kind"})

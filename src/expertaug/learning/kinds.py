"""Kinds of objectives, by name alone, and what a whole training names."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from expertaug.models import settings as of_models
from expertaug.registry import Part, find, full_name

OBJECTIVE = Part(
    "objective",
    {
        "aphynity": "expertaug.learning.objectives:Aphynity",
        "hvae": "expertaug.learning.hvae:HybridVAE",
    },
    base="expertaug.learning.objectives:Objective",
    needed="loss",
    given=("seeds", "choices", "prior"),
)
PARTS = {**of_models.PARTS, OBJECTIVE.name: OBJECTIVE}


def modules(system: str, model: Mapping[str, Mapping], objective: str | None) -> list[str]:
    """What a model and its training name: the module of the system, classes as ``package.module:Class``.

    Arguments:
        system: a module of ``expertaug.systems``, or a dotted path.
        model: settings of the encoder and of the interaction, those that there are, with their kind.
        objective: its kind; None where nothing is trained.
    """
    kinds = {name: model[name]["kind"] for name in PARTS if name in model}
    if objective is not None:
        kinds["objective"] = objective
    named = [full_name(PARTS[name], kind, name) for name, kind in kinds.items()]
    return [system if "." in system or ":" in system else f"expertaug.systems.{system}", *named]


def objective_of(kind: str, classes: Mapping[str, Callable] | None = None) -> Any:
    """The class of an objective's kind.

    Arguments:
        classes: by name, instead of what importing the name would give.
    """
    return (classes or {}).get(kind) or find(OBJECTIVE, kind, "objective")

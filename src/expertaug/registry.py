"""Classes that a configuration may name by a short ``kind``; any other is named as ``package.module:Class``.

Only names stand here, so that checking a configuration does not wait for torch.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping

from expertaug.errors import InputError

KINDS = {
    "encoder": {
        "recurrent": "expertaug.models.encoders.recurrent:RecurrentEncoder",
        "window": "expertaug.models.encoders.window:WindowEncoder",
        "two_step": "expertaug.models.encoders.two_step:MLPTwoStep",
        "conv_two_step": "expertaug.models.encoders.two_step_fields:ConvTwoStep",
        "conv": "expertaug.models.encoders.convolutional:ConvEncoder",
        "moments": "expertaug.models.encoders.moments:MomentEncoder",
    },
    "interaction": {
        "mlp": "expertaug.models.interactions.mlp:MLPInteraction",
        "conv": "expertaug.models.interactions.convolutional:ConvInteraction",
        "polynomial": "expertaug.models.interactions.polynomial:PolynomialInteraction",
        "damping": "expertaug.models.interactions.damping:DampingInteraction",
    },
    "objective": {
        "aphynity": "expertaug.learning.objectives:Aphynity",
        "hvae": "expertaug.learning.hvae:HybridVAE",
    },
}


def full_name(part: str, kind: str, where: str) -> str:
    """``package.module:Class`` of a kind of ``part`` (encoder, interaction, objective).

    Raises:
        InputError: the kind is neither known nor of that form.
    """
    if ":" in kind:
        return kind
    known = KINDS[part]
    if kind not in known:
        raise InputError(where, f"'{kind}' is no {part}", f"known: {', '.join(known)}, or package.module:Class")
    return known[kind]


def find(part: str, kind: str, where: str) -> type:
    """The class of a kind.

    Raises:
        InputError: there is no such kind, module or class.
    """
    module, _, name = full_name(part, kind, where).partition(":")
    try:
        return getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError) as error:
        raise InputError(where, repr(kind), f"one of {', '.join(KINDS[part])}, or package.module:Class") from error


def modules(system: str, model: Mapping[str, Mapping], objective: str | None) -> list[str]:
    """What a model and its training name: the module of the system, classes as ``package.module:Class``.

    Arguments:
        system: a module of ``expertaug.systems``, or a dotted path.
        model: settings of the encoder and of the interaction, those that there are, with their kind.
        objective: its kind; None where nothing is trained.
    """
    kinds = {part: model[part]["kind"] for part in ("encoder", "interaction") if part in model}
    if objective is not None:
        kinds["objective"] = objective
    named = [full_name(part, kind, part) for part, kind in kinds.items()]
    return [system if "." in system else f"expertaug.systems.{system}", *named]

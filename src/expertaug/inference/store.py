"""Files of estimators: a trained model's, or a flow's, which holds its base model as well."""

from __future__ import annotations

from collections.abc import Callable, Collection
from pathlib import Path

import torch

from expertaug.errors import InputError
from expertaug.inference import flow
from expertaug.models import store
from expertaug.models.store import StoredModel

__all__ = ["FLOW", "load"]

FLOW, BASE = "flow", "base."  # the kind in a description; where the base model's tensors are


def load(path: str | Path, device: torch.device | str = "cpu", classes: Collection[str | Callable] = ()) -> StoredModel:
    """Read a model file of any kind; arguments and errors as :func:`expertaug.models.store.load`.

    A flow's ``model`` is a :class:`~expertaug.inference.flow.FlowEstimator`, and its card has its base model's
    under ``base``.
    """
    header, tensors = store.read_tensors(path)
    card = store.card_of(path, header)
    if card.kind != FLOW:
        return store.restore(path, card, tensors, device, classes)
    own = {name.removeprefix(BASE): value for name, value in tensors.items() if name.startswith(BASE)}
    try:
        base = store.restore(path, card.base, own, "cpu", classes)
        model = flow.build(base.model, card)
        model.load_state_dict(tensors)
    except (KeyError, TypeError, RuntimeError, AttributeError) as error:
        raise InputError(path, f"describes no flow ({error})", "make it again with its stage") from error
    return StoredModel(model.to(device).eval(), card, base.classes)

"""Some seeds of a group."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

import torch
from torch import nn

from expertaug.models.card import ModelCard

Model = TypeVar("Model", bound=nn.Module)


def of_card(card: ModelCard, places: Sequence[int]) -> ModelCard:
    """What a model file says of a group's seeds at some places: one value a seed becomes theirs."""
    count, chosen = len(card.seeds), {}
    for key in ("seeds", "best_score", "best_epoch", "best_step"):
        if (value := getattr(card, key)) is not None:
            chosen[key] = [value[k] for k in places]

    def theirs(block: Mapping[str, Any]) -> dict[str, Any]:
        each = {k: v for k, v in block.items() if isinstance(v, list) and len(v) == count}
        return {**block, **{key: [value[k] for k in places] for key, value in each.items()}}

    if card.carried is not None:
        chosen["carried"] = theirs(card.carried)
    for key in ("latent", "misfit"):
        if (value := getattr(card, key)) is not None:
            chosen[key] = theirs(value.model_dump())
    return card.but(**chosen)


def select(model: Model, places: Sequence[int], count: int) -> Model:
    """A model of the seeds at some places of a group; the group's own stays as it is.

    Arguments:
        model: stacked over ``count`` seeds, the leading axis of its parameters and buffers; a model without parameters
            is the same for all seeds.
        places: from 0.
    """
    chosen = copy.deepcopy(model)
    if not any(True for _ in model.parameters()):
        return chosen
    index = torch.tensor(list(places), dtype=torch.long)
    for module in chosen.modules():
        for name, value in module._parameters.items():
            if value is not None:
                kept = value.detach()[index.to(value.device)].clone()
                module._parameters[name] = nn.Parameter(kept, requires_grad=value.requires_grad)
        for name, value in module._buffers.items():
            if value is not None:
                module._buffers[name] = value[index.to(value.device)].clone()
        if getattr(module, "seeds", None) == count:  # a wrapped module counts them
            vars(module)["seeds"] = len(index)
    return chosen

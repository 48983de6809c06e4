"""States of a model at several stages of its training, in one file: each can be used like a trained model."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import Any, TypedDict

import torch
from torch import Tensor

from expertaug.errors import InputError
from expertaug.models import store
from expertaug.models.card import ModelCard

NAME = "snapshots.safetensors"


class Snapshot(TypedDict):
    """State of a model after a pass of its training.

    Attributes:
        carried: options that fine-tuning takes over (:meth:`expertaug.learning.objectives.Objective.carried`).
        wall_s: seconds of training so far.
        model: state_dict of the stacked model.
    """

    carried: dict[str, Any]
    wall_s: float
    model: dict[str, Tensor]


def save(path: Path, snapshots: Mapping[int, Snapshot], card: ModelCard) -> None:
    """Write the snapshots by pass; what they hold beside the model is what a model file says of its training.

    Arguments:
        card: of the model that they are states of.
    """
    tensors = {
        f"{epoch}/{name}": value for epoch, snapshot in snapshots.items() for name, value in snapshot["model"].items()
    }
    records = {epoch: {k: v for k, v in snapshot.items() if k != "model"} for epoch, snapshot in snapshots.items()}
    store.write_tensors(path, tensors, {"description": card.model_dump(), "records": records})


def load(path: Path, device: torch.device, classes: Collection[str | Callable] = ()) -> dict[int, store.StoredModel]:
    """The snapshots by pass, as models.

    Arguments:
        classes: see :func:`expertaug.models.store.load`.

    Raises:
        InputError: the file is missing, damaged or of another kind.
    """
    header, tensors = _read(path)
    models = {}
    for epoch, record in header["records"].items():
        own = {k.removeprefix(f"{epoch}/"): v for k, v in tensors.items() if k.startswith(f"{epoch}/")}
        card = store.card_of(path, header["description"] | record)
        models[int(epoch)] = store.restore(path, card, own, device, classes)
    return models


def read_card(path: Path) -> ModelCard:
    """The card of the model that the snapshots are states of.

    Raises:
        InputError: as :func:`load`.
    """
    return store.card_of(path, _read(path)[0]["description"])


def passes(path: Path) -> list[int]:
    """After which passes they were taken."""
    return sorted(map(int, _read(path)[0]["records"]))


def _read(path: Path) -> tuple[dict, dict[str, Tensor]]:
    header, tensors = store.read_tensors(path)
    if not {"description", "records"} <= header.keys():
        raise InputError(path, "holds no snapshots", "make it again with train")
    return header, tensors

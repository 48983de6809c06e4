"""States of a model at several stages of its training, in one file: each can be used like a trained model."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import torch
from safetensors.torch import save_file

from expertaug import systems
from expertaug.files import atomic
from expertaug.models import store

NAME = "snapshots.safetensors"


def save(path: Path, snapshots: Mapping[int, Mapping], description: Mapping) -> None:
    """Write the snapshots by pass.

    Arguments:
        snapshots: of each pass the state_dict of the stacked model as ``model``; the rest is what a model file says of
            its training.
        description: of the model that they are states of.
    """
    tensors = {
        f"{epoch}/{name}": value.cpu().contiguous()
        for epoch, snapshot in snapshots.items()
        for name, value in snapshot["model"].items()
    }
    records = {epoch: {k: v for k, v in snapshot.items() if k != "model"} for epoch, snapshot in snapshots.items()}
    header = json.dumps({"description": description, "records": records})
    with atomic(path) as temporary:
        save_file(tensors, temporary, metadata={"expertaug": header})


def load(path: Path, device: torch.device) -> dict[int, store.StoredModel]:
    """The snapshots by pass, as models.

    Raises:
        InputError: the file is missing or of another kind.
    """
    header, tensors = store.read_tensors(path)
    found = {}
    for epoch, record in header["records"].items():
        description = header["description"] | record
        model = store.make(systems.load(description["system"]), description)
        prefix = f"{epoch}/"
        model.load_state_dict({k.removeprefix(prefix): v for k, v in tensors.items() if k.startswith(prefix)})
        found[int(epoch)] = store.StoredModel(model.to(device), description)
    return found

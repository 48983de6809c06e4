"""Model files: safetensors with the description that makes the model again in the header."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor, nn

from expertaug import systems
from expertaug.errors import InputError
from expertaug.files import atomic
from expertaug.models.hybrid import HybridNet
from expertaug.models.mean import MeanModel
from expertaug.models.recipe import HybridModel


@dataclass(frozen=True)
class StoredModel:
    """A model for a group of seeds and what is known about it.

    Attributes:
        model: stacked over the seeds of ``description["seeds"]``.
        description: system, method, model, choices, t (all times), observed (points) and the training's record.
    """

    model: nn.Module
    description: Mapping

    @property
    def seeds(self) -> list[int]:
        return list(self.description["seeds"])

    @property
    def failed(self) -> list[int]:
        """Those of the seeds that could not be trained."""
        return list(self.description.get("failed", ()))


def save(path: Path, model: nn.Module, description: Mapping) -> None:
    """Write a model file atomically."""
    tensors = {name: value.detach().cpu().contiguous() for name, value in model.state_dict().items()}
    with atomic(path) as temporary:
        save_file(tensors, temporary, metadata={"expertaug": json.dumps(description)})


def load(path: Path, device: torch.device | str = "cpu") -> StoredModel:
    """Read a model file.

    Raises:
        InputError: the file is missing or no model file, or its layers are no longer what its description says.
    """
    description, tensors = read_tensors(path)
    system = systems.load(description["system"])
    if description["kind"] == "mean":
        model: nn.Module = MeanModel(system, tensors["mean"])
    else:
        model = make(system, description)
        try:
            model.load_state_dict(tensors)
        except RuntimeError as error:
            raise InputError(path, "holds other layers than it describes", "train it again") from error
    return StoredModel(model.to(device).eval(), description)


def make(system: systems.System, description: Mapping) -> HybridNet:
    """The stacked hybrid model that a description describes, one initialisation a seed."""
    times = torch.tensor(description["t"][: description["observed"]], dtype=torch.float64)
    recipe = HybridModel.from_dict(description, system)
    return recipe.build(times, description["seeds"], description.get("likelihood", False))


def read_tensors(path: Path) -> tuple[dict, dict[str, Tensor]]:
    """Header and tensors of a file that this package wrote.

    Raises:
        InputError: the file is missing, damaged or from elsewhere.
    """
    try:
        with safe_open(path, framework="pt") as file:
            header = json.loads((file.metadata() or {})["expertaug"])
            return header, {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except FileNotFoundError as error:
        raise InputError(path, "no such file", "run the stage that makes it") from error
    except (KeyError, ValueError, SafetensorError) as error:
        raise InputError(path, f"not a file of this package ({error})", "make it again with its stage") from error

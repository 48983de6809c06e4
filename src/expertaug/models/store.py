"""Model files: safetensors with the description that makes the model again in the header."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from expertaug.errors import InputError
from expertaug.models import describe
from expertaug.models.decoder import Decoder, TruthDecoder
from expertaug.models.mean import MeanModel
from expertaug.models.tensor_file import read_tensors, write_tensors
from expertaug.systems import System
from expertaug.systems.settings import ADAMS, EVENTS, SolverSettings
from expertaug.systems.solvers.solver import Solver

__all__ = ["StoredModel", "load", "make", "read_tensors", "restore", "save", "write_tensors"]

ACCURATE = Solver("dopri5", rtol=1e-6, atol=1e-6)
ACROSS_EVENTS = Solver(EVENTS, substeps=10)
KINDS = ("hybrid", "alternating", "mean", "least_squares")
COARSE = ("euler", "midpoint", "rk4", *ADAMS)  # steps of the data's own: good for training, not for a forecast


@dataclass(frozen=True)
class StoredModel:
    """A model for a group of seeds and what is known about it.

    Attributes:
        model: a hybrid network, the baseline of the mean, or a decoder: of kind alternating with F_a, of kind
            least_squares of the expert alone; stacked over the seeds of ``description["seeds"]``.
        description: system, method, model, choices, t (all times in s), observed (points), units and the training's
            record; all of it can be written to a file.
        classes: those of its parts that are not this package's, by the name that the description gives them.
    """

    model: Any
    description: Mapping
    classes: Mapping[str, Callable] = field(default_factory=dict)

    @property
    def seeds(self) -> list[int]:
        return list(self.description["seeds"])

    @property
    def failed(self) -> list[int]:
        """Those of the seeds that could not be trained."""
        return list(self.description.get("failed", ()))

    @property
    def device(self) -> torch.device:
        """Where its tensors live."""
        return next((value.device for value in self.model.state_dict().values()), torch.device("cpu"))

    @property
    def solver(self) -> Solver:
        """What forecasts are solved with."""
        return Solver.from_mapping(self.description.get("forecast_solver") or accurate(self.model.system))


def accurate(system: System) -> Solver:
    """The solver that forecasts of a system deserve."""
    return ACROSS_EVENTS if system.has_events else ACCURATE


def forecast_solver(training: SolverSettings | None, system: System) -> Solver:
    """The solver that forecasts deserve, from a training's: that, unless it is a coarse one."""
    solver = Solver(**dict(training or {}))
    if solver.method not in COARSE:
        return solver
    split = solver.method in ADAMS and type(system).linear_flow is not System.linear_flow
    return Solver("lawson4") if split else accurate(system)


def save(path: str | Path, model: Any, description: Mapping) -> None:
    """Write a model file atomically.

    Raises:
        InputError: the folder cannot be written, or a class of the model was given what a file cannot hold.
    """
    write_tensors(path, model.state_dict(), {**description, **_units(model.system)})


def load(path: str | Path, device: torch.device | str = "cpu", classes: Collection[str | Callable] = ()) -> StoredModel:
    """Read a model file.

    Arguments:
        classes: classes that are not this package's and may be used, or their names, ``module:Class`` (``module`` for a
            system): what a file names beyond them is not imported.

    Raises:
        InputError: the file is missing, damaged or no model file, names a class that ``classes`` does not, or its
            layers are no longer what its description says.
    """
    description, tensors = read_tensors(path)
    return restore(path, description, tensors, device, classes)


def restore(
    path: str | Path,
    description: Mapping,
    tensors: Mapping[str, Tensor],
    device: torch.device | str,
    classes: Collection[str | Callable] = (),
) -> StoredModel:
    """The model that a file's description and tensors make; see :func:`load`."""
    allowed, made = describe.trusted(classes)
    try:
        _check(description)
        own = list(describe.foreign(description))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(path, f"describes no model ({error})", "make it again with its stage") from error
    for name in own:
        if name not in allowed:
            raise InputError(
                path, f"needs {name}, which is not part of expertaug", f"if you trust it: classes=[{name!r}] (--class)"
            )
    used: dict[str, Callable] = {name: made[name] for name in own if name in made}
    try:
        system = describe.system_of(description, used)
        if description["kind"] == "mean":
            model: Any = MeanModel(system, tensors["mean"])
        elif description["kind"] == "least_squares":
            model = TruthDecoder(system) if description.get("truth") else Decoder(system)
        elif description["kind"] == "alternating":
            model = describe.decoder_of(system, description, used)
        else:
            model = make(system, description, used)
    except Exception as error:  # a class of the user's may raise anything
        raise InputError(path, f"describes no model ({error})", "train it again") from error
    for key, value in _units(system).items():
        if key in description and description[key] != value:
            raise InputError(
                path, f"was made with {key} {description[key]}", f"the system now has {value}: train again"
            )
    try:
        model.load_state_dict(dict(tensors))
    except RuntimeError as error:
        raise InputError(path, "holds other layers than it describes", "train it again") from error
    return StoredModel(model.to(device).eval(), description, used)


def make(system: System, description: Mapping, classes: Mapping[str, Callable] | None = None) -> Any:
    """The stacked hybrid model that a description describes, one initialisation a seed."""
    times = torch.tensor(description["t"][: description["observed"]], dtype=torch.float64)
    recipe = describe.recipe_of(system, description, classes)
    return recipe.build(
        times, list(description["seeds"]), description.get("likelihood", False), description.get("start")
    )


def _check(description: Mapping) -> None:
    """What every use of a model relies on."""
    t, observed, seeds = description["t"], description["observed"], description["seeds"]
    if description["kind"] not in KINDS:
        raise ValueError(f"kind {description['kind']!r}")
    if not all(isinstance(v, (int, float)) for v in t) or any(not a < b for a, b in pairwise(t)):
        raise ValueError("t does not increase")
    if not isinstance(observed, int) or not 1 <= observed <= len(t):
        raise ValueError(f"observed {observed!r}")
    if not seeds or not all(isinstance(seed, int) for seed in seeds):
        raise ValueError(f"seeds {seeds!r}")


def _units(system: System) -> dict[str, list[list[str]]]:
    """Names and units of the state, of z_e and of known inputs."""
    found = {
        "state": [[p.name, p.unit] for p in system.state],
        "expert_parameters": [[p.name, p.unit] for p in system.expert_parameters],
    }
    for name in ("inputs", "covariates"):
        if named := getattr(system, name):
            found[name] = [[p.name, p.unit] for p in named]
    return found

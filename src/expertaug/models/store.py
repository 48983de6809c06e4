"""Model files: safetensors with the card by which the model is made again in the header."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from expertaug.errors import InputError
from expertaug.models import describe
from expertaug.models.card import ModelCard
from expertaug.models.estimators import ESTIMATORS, EstimatorKind, estimator
from expertaug.models.tensor_file import read_tensors, write_tensors
from expertaug.systems import System
from expertaug.systems.settings import ADAMS, EVENTS, SolverSettings
from expertaug.systems.solvers.solver import Solver
from expertaug.wording import check_keys, show, suggest

__all__ = ["StoredModel", "load", "read_tensors", "restore", "save", "write_tensors"]

ACCURATE = Solver("dopri5", rtol=1e-6, atol=1e-6)
ACROSS_EVENTS = Solver(EVENTS, substeps=10)
COARSE = ("euler", "midpoint", "rk4", *ADAMS)  # steps of the data's own: good for training, not for a forecast


@dataclass(frozen=True)
class StoredModel:
    """A model for a group of seeds and what is known about it.

    Attributes:
        model: an estimator, or a decoder whose estimates are fits of each window; stacked over the card's seeds.
        card: what is known; all of it can be written to a file.
        classes: those of its parts that are not this package's, by the name that the card gives them.
        path: of the file that it is from; None in memory.
    """

    model: Any
    card: ModelCard
    classes: Mapping[str, Callable] = field(default_factory=dict)
    path: Path | None = field(default=None, compare=False)

    @property
    def where(self) -> str | Path:
        """What messages call it."""
        return self.path or f"model {self.card.label}"

    @property
    def kind(self) -> type[EstimatorKind]:
        """What it can do."""
        return estimator(self.card.kind, "card.kind", self.classes)

    @property
    def seeds(self) -> list[int]:
        return list(self.card.seeds)

    @property
    def failed(self) -> list[int]:
        """Those of the seeds that could not be trained."""
        return list(self.card.failed or ())

    @property
    def device(self) -> torch.device:
        """Where its tensors live."""
        return next((value.device for value in self.model.state_dict().values()), torch.device("cpu"))

    @property
    def solver(self) -> Solver:
        """What forecasts are solved with."""
        settings = self.card.forecast_solver
        return accurate(self.model.system) if settings is None else Solver(**dict(settings))


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


def save(path: str | Path, model: Any, card: ModelCard) -> None:
    """Write a model file atomically.

    Raises:
        InputError: the folder cannot be written, or a class of the model was given what a file cannot hold.
    """
    write_tensors(path, model.state_dict(), {**card.model_dump(), **_units(model.system)})


def load(path: str | Path, device: torch.device | str = "cpu", classes: Collection[str | Callable] = ()) -> StoredModel:
    """Read a model file.

    Arguments:
        classes: classes that are not this package's and may be used, or their names, ``module:Class`` (``module`` for a
            system): what a file names beyond them is not imported.

    Raises:
        InputError: the file is missing, damaged or no model file, names a class that ``classes`` does not, or its
            layers are no longer what its card says.
    """
    header, tensors = read_tensors(path)
    return restore(path, card_of(path, header), tensors, device, classes)


def read_card(path: str | Path) -> ModelCard:
    """What a model file says of its model.

    Raises:
        InputError: the file is missing, damaged or no model file.
    """
    return card_of(path, read_tensors(path)[0])


def card_of(path: str | Path, header: Mapping[str, Any]) -> ModelCard:
    """The card in a file's header.

    Raises:
        InputError: it is none.
    """
    try:
        card = ModelCard.from_mapping(header, "")
        kind = ESTIMATORS.get(card.kind, EstimatorKind)
        if missing := [key for key in kind.needs if getattr(card, key) is None]:
            raise InputError(missing[0], "missing", f"a {card.kind}'s card has {', '.join(kind.needs)}")
        trained = kind if card.base is None else ESTIMATORS.get(card.base.kind, EstimatorKind)
        if trained.training is not None:
            check_keys(card.training.model_extra or {}, trained.training.model_fields, "training", "setting of it")
    except InputError as error:
        raise InputError(path, f"describes no model ({error})", "make it again with its stage") from error
    return card


def restore(
    path: str | Path,
    card: ModelCard,
    tensors: Mapping[str, Tensor],
    device: torch.device | str,
    classes: Collection[str | Callable] = (),
) -> StoredModel:
    """The model that a file's card and tensors make; see :func:`load`."""
    allowed, made = describe.list_trusted(classes)
    if ":" not in card.kind and card.kind not in ESTIMATORS:
        problem = f"describes no model of these (kind: found '{card.kind}')"
        raise InputError(path, problem, "read it as expertaug.load does")
    own = list(describe.foreign(card, ":" in card.kind or ESTIMATORS[card.kind].trains()))
    for name in own:
        if name not in allowed:
            raise InputError(
                path, f"needs {name}, which is not part of expertaug", f"if you trust it: classes=[{name!r}] (--class)"
            )
    used: dict[str, Callable] = {name: made[name] for name in own if name in made}
    kind, base = estimator(card.kind, str(path), used), None
    if not kind.base:  # else those of the base are checked, with its own card
        _check_tensors(path, card, tensors, kind.trains())
    try:
        if kind.base:
            inner = {n.removeprefix(kind.base): value for n, value in tensors.items() if n.startswith(kind.base)}
            base = restore(path, card.base, inner, "cpu", classes)
            used |= base.classes
        system = describe.system_of(card, used) if base is None else base.model.system
        model = kind.network(system, card, tensors, used, None if base is None else base.model)
    except InputError as error:
        raise error if error.where == str(path) else _no_model(path, error) from error
    except Exception as error:  # a class of the user's may raise anything
        raise _no_model(path, error) from error
    for key, value in _units(system).items():
        before = getattr(card, key)
        if before is not None and before != value:
            raise InputError(path, f"was made with {key} {before}", f"the system now has {value}: train again")
    try:
        model.load_state_dict(dict(tensors))
    except RuntimeError as error:
        raise InputError(path, "holds other layers than it describes", "train it again") from error
    return StoredModel(model.to(device).eval(), card, used, Path(path))


def _no_model(path: str | Path, error: Exception) -> InputError:
    return InputError(path, f"describes no model ({error})", "train it again")


def _check_tensors(path: str | Path, card: ModelCard, tensors: Mapping[str, Tensor], stacked: bool) -> None:
    """Tensors must be numbers, and of as many seeds as the card says where they are stacked, before networks of these
    are made."""
    for name, value in tensors.items():
        if value.is_floating_point() and not torch.isfinite(value).all():
            raise InputError(path, f"the tensor {name} has values that are no numbers", "train it again")
        if stacked and (value.dim() == 0 or len(value) != len(card.seeds)):
            problem = f"the tensor {name} has shape {tuple(value.shape)}"
            raise InputError(path, problem, f"it describes {len(card.seeds)} seeds: train it again")


def _units(system: System) -> dict[str, list[list[str]]]:
    """Names and units of the state, of z_e and of known inputs."""
    units = {
        "state": [[p.name, p.unit] for p in system.state],
        "expert_parameters": [[p.name, p.unit] for p in system.expert_parameters],
    }
    for name in ("inputs", "covariates"):
        if named := getattr(system, name):
            units[name] = [[p.name, p.unit] for p in named]
    return units


def device_of(name: str) -> torch.device:
    """auto, cpu or cuda; on the CPU one thread, since two busy jobs of one thread beat two of two.

    Raises:
        InputError: torch knows no such device, or cuda is asked for and torch finds none.
    """
    torch.set_num_threads(1)
    if name == "auto":
        name = "cuda" if torch.cuda.is_available() else "cpu"
    if name.startswith("cuda") and not torch.cuda.is_available():
        raise InputError("device", f"'{name}', and torch finds none here", "give auto or cpu")
    try:
        return torch.device(name)
    except RuntimeError as error:
        raise InputError("device", f"found {show(name)}", suggest(name, ("auto", "cpu", "cuda"))) from error

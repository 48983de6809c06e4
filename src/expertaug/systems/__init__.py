"""Physical systems, one module each."""

from __future__ import annotations

import dataclasses
import importlib
import inspect
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from expertaug import registry
from expertaug.errors import InputError
from expertaug.measurements.names import Names
from expertaug.systems.settings import SYSTEMS, SystemSettings
from expertaug.wording import show, suggest

if TYPE_CHECKING:
    import torch

    from expertaug.systems.base import Parameter, System

__all__ = ["Outline", "Parameter", "System", "describe", "load", "names", "outline", "rates"]

PROBES = 16  # states at which the expert's rates are compared with the states themselves
TIMES = (0.0, 0.37, 5.9)  # at which they are compared with each other


def __getattr__(name: str) -> object:
    """The classes of :mod:`expertaug.systems.base`, which load torch, when they are asked for."""
    if name in ("Parameter", "System"):
        return getattr(importlib.import_module(f"{__name__}.base"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def load(settings: SystemSettings | Mapping[str, Any]) -> System:
    """Make the system that ``settings`` describes.

    Arguments:
        settings: ``name`` is one of :data:`~expertaug.systems.settings.SYSTEMS` or a dotted path of a module
            elsewhere, which defines one :class:`System`, or ``module:Class``; the other keys are its constructor's
            arguments.

    Raises:
        InputError: there is no such system or module, it defines none, or the constructor refuses an argument.
    """
    if isinstance(settings, SystemSettings):
        settings = settings.model_dump(exclude_unset=True) | {"name": settings.name}
    if not isinstance(settings, Mapping) or "name" not in settings:
        problem = f"found {show(settings)}"
        raise InputError("system", problem, f"give a mapping with a name; known: {', '.join(SYSTEMS)}")
    arguments = dict(settings)
    name = str(arguments.pop("name", ""))
    cls = _class(name)
    accepted = registry.arguments(cls)
    for key in arguments:
        if accepted is not None and key not in accepted:
            raise InputError(f"system.{key}", f"unknown to {name}", suggest(key, accepted))
    if inspect.isabstract(cls):
        missing = ", ".join(sorted(cls.__abstractmethods__))
        raise InputError("system.name", f"the class {cls.__name__} does not define {missing}", "a System needs it")
    try:
        return cls(**arguments)
    except InputError:
        raise
    except Exception as error:
        problem = f"{cls.__name__} refuses its arguments ({type(error).__name__}: {error})"
        raise InputError("system", problem, "correct them, or the class") from error


def _class(name: str) -> type[System]:
    """The class that ``name`` means."""
    from expertaug.systems.base import System

    path, _, wanted = name.partition(":")
    if name in SYSTEMS:
        path = f"{__name__}.{name}"
    elif not wanted and "." not in path:
        remedy = f"{suggest(name, SYSTEMS)}; or a dotted path, or module:Class"
        if Path(f"{name}.py").is_file():
            remedy = f"for {name}.py of this folder, write its class as well: {name}:CLASS"
        raise InputError("system.name", f"no system {name!r}", remedy)
    module = registry.import_named(path, "system.name")
    classes = {
        c.__name__: c
        for _, c in inspect.getmembers(module, inspect.isclass)
        if issubclass(c, System) and (wanted or c.__module__ == module.__name__)
    }
    if wanted:
        if wanted not in classes:
            raise InputError("system.name", f"no System '{wanted}' in {path}", "name a class whose base is System")
        return classes[wanted]
    if len(classes) != 1:
        raise InputError("system.name", f"{module.__name__} defines {len(classes)} systems", f"name one: {path}:Class")
    return next(iter(classes.values()))


def names(system: System) -> Names:
    """What a system calls its components, parameters and known inputs, with their units.

    Raises:
        InputError: its states are fields.
    """
    if len(system.state_shape) != 1:
        problem = f"states of {type(system).__name__} have the shape {system.state_shape}"
        raise InputError("data.files", problem, "only states of single numbers are read from tables")
    state, parameters, inputs = (
        {p.name: p.unit for p in part} for part in (system.state, system.expert_parameters, system.known)
    )
    constant = frozenset(p.name for p in system.covariates)
    held = bool(system.inputs) and system.interpolation != "linear"
    return Names(state, parameters, inputs, constant, held, rates(system), is_timed(system))


@dataclass(frozen=True)
class Outline:
    """What tables of measurements need to know of a system.

    Attributes:
        names: of its components, parameters and known inputs.
        priors: a first guess of the range of each expert parameter.
        constants: names of those that are constants of an apparatus.
    """

    names: Names
    priors: Mapping[str, tuple[float, float]]
    constants: tuple[str, ...]


def outline(settings: Mapping[str, Any]) -> Outline:
    """Of the system that ``settings`` describe, as :func:`load` takes them; of the package's own without loading torch,
    which takes more time and memory than a table of a million rows.

    Raises:
        InputError: as :func:`load` and :func:`names`.
    """
    own = _of_choices(settings)
    if own is None or own.TABLES is None:
        system = load(settings)
        priors = {p.name: _range(p.scale, p.positive) for p in system.expert_parameters}
        return Outline(names(system), priors, tuple(constants(system)))
    tables, units = own.TABLES, {**own.TABLES.units, **own.UNITS}
    state, parameters, inputs = (
        {name: units.get(name, "") for name in part} for part in (own.STATE, own.expert_names, own.inputs)
    )
    priors = {name: _range(tables.scales.get(name, 1.0)) for name in own.expert_names}
    of_own = Names(state, parameters, inputs, rates=tables.rates, timed=tables.timed and not inputs)
    return Outline(of_own, priors, own.expert_names if tables.constants else ())


def _of_choices(settings: Mapping[str, Any]) -> SystemSettings | None:
    """Settings of one of the package's systems; None of others, and where its class may refuse an argument."""
    name = settings.get("name")
    if not isinstance(name, str) or name not in SYSTEMS or any(isinstance(v, list | dict) for v in settings.values()):
        return None
    try:
        return SYSTEMS[name].from_mapping(settings)
    except InputError:
        return None


def _range(scale: float, positive: bool = True) -> tuple[float, float]:
    """A first guess of the range of a parameter of that size."""
    return (0.3 if positive else -3.0) * scale, 3.0 * scale


def rates(system: System) -> dict[str, str]:
    """Components that are the rate of change of another, by the expert's own rates at states drawn at random: of a
    pendulum the speed is the angle's."""
    import torch

    states, expert_rates = _probe(system, 0.0)
    if expert_rates is None:
        return {}
    same = torch.isclose(expert_rates.unsqueeze(-1), states.unsqueeze(-2), rtol=1e-9, atol=1e-12).all(0)
    names = [p.name for p in system.state]
    return {names[j]: names[i] for i, j in same.nonzero().tolist() if i != j}


def is_timed(system: System) -> bool:
    """Whether the expert's rates depend on t itself, at states drawn at random."""
    import torch

    first, *later = (_probe(system, t)[1] for t in TIMES)
    if first is None:
        return False
    return any(rates is None or not torch.allclose(rates, first, 0.0, 0.0, equal_nan=True) for rates in later)


def _probe(system: System, t: float) -> tuple[torch.Tensor, torch.Tensor | None]:
    """States drawn at random, always the same, and the expert's rates there at a time; None of an expert that fails."""
    import torch

    draw = torch.Generator().manual_seed(0)

    def uniform(*size: int) -> torch.Tensor:
        return 0.5 + torch.rand(*size, generator=draw, dtype=torch.float64)

    states, parameters = uniform(PROBES, len(system.state)), system.expert_parameters
    z_e = uniform(PROBES, len(parameters)) * torch.tensor([p.scale for p in parameters], dtype=torch.float64)
    more = [uniform(PROBES, len(system.known))] if system.known else []
    more += [torch.ones(PROBES, dtype=torch.float64)] if system.has_events else []
    try:
        return states, system.expert(torch.tensor(t, dtype=torch.float64), states, z_e, *more)
    except Exception:  # a class of the user's may raise anything; what is wrong with it is told where it is used
        return states, None


def constants(system: System) -> list[str]:
    """Names of the expert parameters that are constants of an apparatus: none where they say how a forecast starts."""
    from expertaug.systems.base import System

    started = type(system).initial_state is not System.initial_state
    return [] if started else [p.name for p in system.expert_parameters]


def describe(system: System) -> dict[str, object]:
    """What :func:`load` makes the system from again: ``name`` and what its constructor was given."""
    cls = type(system)
    short = cls.__module__.removeprefix(f"{__name__}.")
    name = f"{cls.__module__}:{cls.__qualname__}" if short == cls.__module__ else short
    if dataclasses.is_dataclass(system):
        arguments = {f.name: getattr(system, f.name) for f in dataclasses.fields(system) if f.init}
    else:
        positional, named = system._made_with
        arguments = inspect.signature(cls).bind(*positional, **named).arguments
    return {"name": name, **arguments}

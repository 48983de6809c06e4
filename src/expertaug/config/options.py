"""Options of what a configuration names: a system, an encoder, an interaction model, an objective.

The package's own kinds are typed models; a class of one's own is asked itself (:mod:`expertaug.config.signatures`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from expertaug import registry
from expertaug.config import signatures
from expertaug.errors import InputError
from expertaug.learning.settings import ALL_PARTS, OBJECTIVE, OBJECTIVES, ObjectiveSettings
from expertaug.models.settings import ENCODERS, INTERACTIONS, PartSettings
from expertaug.settings import check
from expertaug.systems.settings import SYSTEMS
from expertaug.wording import show, suggest

Arguments = dict[str, Any]  # of a class that a configuration names, in its words
PARTS: Mapping[str, Mapping[str, type[PartSettings]]] = {"encoder": ENCODERS, "interaction": INTERACTIONS}


@dataclass(frozen=True)
class KnownSystem:
    """What is known of a system before it is made; None where only its constructor knows.

    Attributes:
        known: names of its known inputs and covariates.
        drawn: names of what simulated ones are drawn from.
        events: whether it has events, at which only some solvers stop.
        jumps: whether what is observed jumps there; of a class from elsewhere its check tells.
    """

    state: Sequence[str] | None
    expert: Sequence[str] | None
    interaction: Sequence[str] | None
    fields: bool | None = None
    kind: type | None = None
    known: Sequence[str] | None = ()
    drawn: Sequence[str] | None = ()
    events: bool = False
    jumps: bool = False

    @property
    def seen(self) -> Sequence[str] | None:
        """What an encoder may see: the state and the known inputs."""
        return None if self.state is None or self.known is None else [*self.state, *self.known]


def describe_system(settings: Arguments, where: str) -> tuple[KnownSystem | None, list[InputError]]:
    """A system by its settings, and what is wrong with them."""
    name = settings.get("name")
    if not isinstance(name, str):
        problem = "missing" if "name" not in settings else f"found {show(name)}"
        return None, [
            InputError(f"{where}.name", problem, "give name (a module of expertaug.systems, or a dotted path)")
        ]
    if name in SYSTEMS:
        kind = SYSTEMS[name]
        made = kind.model_construct(**{k: v for k, v in settings.items() if k in kind.model_fields})  # unchecked yet
        system = KnownSystem(
            kind.STATE,
            made.expert_names,
            made.interaction_names,
            kind.FIELDS,
            events=kind.EVENTS,
            jumps=made.jumps,
            known=made.inputs,
            drawn=made.drawn,
        )
        return system, check(kind, settings, where)
    if "." not in name and ":" not in name:
        remedy = f"{suggest(name, SYSTEMS)}, or the dotted path of a module elsewhere"
        return None, [InputError(f"{where}.name", f"'{name}' is no system", remedy)]
    try:
        own = signatures.load_system(name, f"{where}.name")
    except InputError as error:
        return None, [error]
    arguments = {k: v for k, v in settings.items() if k != "name"}
    state, expert, interaction = (
        signatures.names_of(own, a) for a in ("state", "expert_parameters", "interaction_parameters")
    )
    inputs = [
        None if signatures.is_set_by_constructor(own, a) else signatures.names_of(own, a)
        for a in ("inputs", "covariates", "input_parameters")
    ]
    known_inputs, drawn = (
        None if part is None or inputs[1] is None else [*part, *inputs[1]] for part in (inputs[0], inputs[2])
    )
    wrong = list(signatures.wrong_options(own, "system", arguments, where))
    events = signatures.has_events(own)
    return KnownSystem(state, expert, interaction, kind=own, known=known_inputs, drawn=drawn, events=events), wrong


def check_simulated(name: str, system: KnownSystem, where: str) -> Iterator[InputError]:
    """A system that cannot be simulated."""
    if name in SYSTEMS and not SYSTEMS[name].SIMULATED:
        yield InputError(where, f"'{name}' has no simulation", "its data come from recordings: data.source")
    elif system.kind is not None:
        try:
            signatures.require_simulation(system.kind, where)
        except InputError as error:
            yield error


def is_of_another_kind(error: InputError) -> bool:
    """Whether an unknown key of a system, an encoder or an interaction model is one of another of their kinds."""
    block, _, name = error.where.rpartition(".")
    kinds = SYSTEMS if block.endswith(".system") else PARTS.get(block.rpartition(".model.")[2], {})
    return error.found == "unknown key" and any(name in kind.model_fields for kind in kinds.values())


def check_part(
    part: str, settings: Arguments, where: str, system: KnownSystem | None, t1_s: float
) -> Iterator[InputError]:
    """What is wrong with an encoder or an interaction model.

    Arguments:
        part: encoder or interaction.
        t1_s: end of the observed window.
    """
    kind = settings.get("kind")
    if not isinstance(kind, str):
        problem = "missing" if "kind" not in settings else f"found {show(kind)}"
        yield InputError(f"{where}.kind", problem, f"{suggest('', PARTS[part])}, or package.module:Class")
        return
    if ":" in kind:
        yield from _own(part, kind, settings, where)
        return
    if kind not in PARTS[part]:
        yield InputError(
            f"{where}.kind", f"'{kind}' is no {part}", f"{suggest(kind, PARTS[part])}, or package.module:Class"
        )
        return
    wrong = check(PARTS[part][kind], settings, where)
    yield from wrong
    if wrong or system is None:
        return
    if system.fields is False and PARTS[part][kind].FIELDS:
        fitting = [name for name, other in PARTS[part].items() if not other.FIELDS]
        yield InputError(f"{where}.kind", f"'{kind}' is for states that are fields", f"give {' or '.join(fitting)}")
    made = PARTS[part][kind].from_mapping(settings)
    yield from _components(made, where, system.seen if part == "encoder" else system.state, t1_s)
    if getattr(made, "inputs", False) and system.known is not None and not system.known:
        yield InputError(f"{where}.inputs", "the system has no known inputs", "leave it out")


def _own(part: str, kind: str, settings: Arguments, where: str) -> Iterator[InputError]:
    try:
        own = registry.find(ALL_PARTS[part], kind, f"{where}.kind")
    except InputError as error:
        yield error
        return
    yield from signatures.wrong_options(own, part, {k: v for k, v in settings.items() if k != "kind"}, where)


def _components(made: PartSettings, where: str, state: Sequence[str] | None, t1_s: float) -> Iterator[InputError]:
    """Components that the state has not, and windows that the encoder does not see."""
    for name in made.COMPONENTS:
        value = getattr(made, name, None) or ()
        for k, component in enumerate(value):
            if state is not None and component not in state:
                at = f"{where}.{name}.{component}" if isinstance(value, Mapping) else f"{where}.{name}[{k}]"
                yield InputError(at, f"'{component}' is no component of the state", suggest(component, state))
    for component, (first, last) in (getattr(made, "windows", None) or {}).items():
        if first < -1e-9 or last > t1_s + 1e-9:
            problem = f"found {show([first, last])} s"
            yield InputError(f"{where}.windows.{component}", problem, f"choose within the observed 0 to {t1_s:g} s")


def find_objective(kind: str, where: str) -> tuple[type | None, list[InputError]]:
    """The class of an objective, or the settings of a built-in one, and what is wrong with its name."""
    if kind in OBJECTIVES:
        return OBJECTIVES[kind], []
    if ":" not in kind:
        remedy = f"{suggest(kind, OBJECTIVES)}, or package.module:Class"
        return None, [InputError(where, f"'{kind}' is no objective", remedy)]
    try:
        return registry.find(OBJECTIVE, kind, where), []
    except InputError as error:
        return None, [error]


def needs_prior(kind: str, where: str) -> bool:
    """Whether an objective takes p⁺ as its argument ``prior``."""
    taker, _ = find_objective(kind, where)
    if taker is None:
        return False
    return "prior" in taker.NEEDS if issubclass(taker, ObjectiveSettings) else signatures.takes(taker, "prior")


def takes_option(kind: str, option: str) -> bool:
    """Whether an objective takes an option."""
    taker, _ = find_objective(kind, "objective")
    if taker is None:
        return False
    if issubclass(taker, ObjectiveSettings):
        return option in taker.model_fields
    return signatures.accepts(taker, "objective", option)


def check_options(kind: str, options: Arguments, where: str) -> Iterator[InputError]:
    """What is wrong with an objective's options; a name that is no objective is not said here."""
    taker, _ = find_objective(kind, where)
    if taker is None:
        return
    if issubclass(taker, ObjectiveSettings):
        yield from check(taker, options, where)
    else:
        yield from signatures.wrong_options(taker, "objective", options, where)

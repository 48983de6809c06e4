"""What was found: coefficients with their errors and their drift, the formula as text, LaTeX and Python."""

from __future__ import annotations

import ast
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from expertaug import systems
from expertaug.equation.selection import Tried
from expertaug.equation.shooting import Formula
from expertaug.errors import InputError
from expertaug.models.store import StoredModel
from expertaug.models.terms import Term, latex_name, round_to_error
from expertaug.systems import System

DECISIVE = 10.0  # by which the training windows' information criterion speaks for a formula (Kass & Raftery 1995)
MOVED = 3.0  # standard errors: a constant that moves by more is none
LAW, CORRECTION = "law", "correction, not law"


@dataclass(frozen=True)
class Coefficient:
    """Of one term.

    Attributes:
        term: in which rate, and what.
        shared: whether all windows have one; otherwise each window has its own, of which mean and spread are given.
        value: as the training windows say, in the unit of the rate per unit of the term.
        error: its standard error, by groups of windows that count as independent.
        spread: standard deviation over windows of their own; NaN of one that they share.
        validation: as the validation windows say.
        validation_error: its standard error.
        survival: share of the network's seeds whose F_a shows the term; NaN without a network.
    """

    term: Term
    shared: bool
    value: float
    error: float
    spread: float
    validation: float
    validation_error: float
    survival: float = math.nan

    @property
    def drift(self) -> float:
        """By how many standard errors of the difference it moves from training to validation windows."""
        return abs(self.value - self.validation) / max(math.hypot(self.error, self.validation_error), 1e-300)

    @property
    def verdict(self) -> str:
        """``law``, or ``correction, not law`` of one that moves by more than three standard errors."""
        return LAW if self.drift <= MOVED else CORRECTION

    def __str__(self) -> str:
        value, error = round_to_error(self.value, self.error), round_to_error(self.error, self.error)
        spread = "" if self.shared else f", of each window: spread {round_to_error(self.spread, self.error)}"
        return f"{self.term}: {value} ± {error}{spread} ({self.verdict})"


@dataclass(frozen=True)
class Row:
    """One of those that are compared on the validation windows.

    Attributes:
        name: expert alone, network, equation, or by hand.
        terms: its formula.
        log_mse: logarithm of the mean squared error of forecasts, summed over the dimensions.
        coefficients: how many numbers the terms have; None of a network.
    """

    name: str
    terms: str
    log_mse: float
    coefficients: int | None


@dataclass(frozen=True)
class Found:
    """What the expert lacks, in terms.

    Attributes:
        coefficients: of the terms, in the order in which they were found; none where no term is called for.
        constants: value and standard error of the expert parameters that all windows share, by name, in their units.
        rows: the expert alone, the network where there is one, the equation, and the terms by hand where given.
        tried: every formula that was refitted, the best first.
        ties: formulas that are as good as the chosen one within one standard error.
        explained: share of F_a's square that the terms explain at the states that the training windows visit, the mean
            of the network's seeds; NaN without a network.
        stored: expert and equation as a model, whose windows are fitted by least squares as its card says.
    """

    coefficients: tuple[Coefficient, ...]
    constants: Mapping[str, tuple[float, float]]
    rows: tuple[Row, ...]
    tried: tuple[Tried, ...]
    ties: tuple[str, ...]
    explained: float
    stored: StoredModel

    @property
    def system(self) -> System:
        """Whose expert it is."""
        return self.stored.model.system

    @property
    def terms(self) -> tuple[Term, ...]:
        """The terms alone."""
        return tuple(coefficient.term for coefficient in self.coefficients)

    @property
    def says(self) -> str:
        """The coefficients ± their standard errors, a line each, and whether they are laws."""
        return "\n".join(map(str, self.coefficients)) or f"no term: the expert alone is as good{self._called_for}"

    @property
    def _called_for(self) -> str:
        """What is said where the training windows clearly speak for a formula that few validation windows do not tell
        from the expert alone; else empty."""
        alone = next(candidate for candidate in self.tried if not candidate.formula.terms)
        near = [candidate for candidate in self.tried if str(candidate.formula) in self.ties]
        near = [candidate for candidate in near if candidate.fit.criterion < alone.fit.criterion - DECISIVE]
        if not near:
            return ""
        best = min(near, key=lambda candidate: candidate.fit.criterion)
        windows = f"in forecasts of {len(alone.errors)} validation windows, within one standard error"
        return f" {windows}; the training windows call for {best.formula}: give more for validation"

    @property
    def text(self) -> str:
        """The rates that have terms, a line each."""
        return text_of(self.system, self.coefficients)

    @property
    def latex(self) -> str:
        """The same for a formula; lines separated by ``\\\\``, as in ``aligned``."""
        return latex_of(self.system, self.coefficients)

    def source(self, name: str) -> str:
        """Python of a module with a :class:`System` called ``name`` whose expert has the terms; coefficients that each
        window has its own are further expert parameters of it.

        Raises:
            InputError: a term is a function, which has no text, or the system's class cannot be imported.
        """
        return source_of(self.system, self.coefficients, name)


def text_of(system: System, coefficients: Sequence[Coefficient]) -> str:
    """``d omega/dt = expert − 0.012 omega``, a line for each rate that has terms."""
    lines = []
    for parameter in system.state:
        own = [c for c in coefficients if c.term.rate == parameter.name]
        parts = [f"{_sign(c)} {c.term.text}" if c.term.text != "1" else _sign(c) for c in own]
        if own:
            lines.append(f"d {parameter.name}/dt = expert {' '.join(parts)}")
    return "\n".join(lines) or "no term"


def latex_of(system: System, coefficients: Sequence[Coefficient]) -> str:
    """The same for a formula, lines separated as in LaTeX's ``aligned``."""
    lines = []
    for _k, parameter in enumerate(system.state):
        own = [c for c in coefficients if c.term.rate == parameter.name]
        parts = [f"{_sign(c)} \\, {c.term.latex}".removesuffix(" \\, ") for c in own]
        if own:
            expert = rf"F_{{\mathrm{{e}},{latex_name(parameter.name)}}}"
            lines.append(rf"\dot{{{latex_name(parameter.name)}}} = {' '.join([expert, *parts])}")
    return r" \\ ".join(lines)


def _sign(coefficient: Coefficient) -> str:
    number = round_to_error(abs(coefficient.value), coefficient.error)
    return f"{'-' if coefficient.value < 0 else '+'} {number}"


def source_of(system: System, coefficients: Sequence[Coefficient], name: str) -> str:
    """Python of a :class:`System` whose expert has the terms: a module of its own, in which shared coefficients are
    constants, and those of each window are further expert parameters.

    Arguments:
        name: of the class.

    Raises:
        InputError: a term is a function, of which there is no text; or the system's class has no name to import.
    """
    if not name.isidentifier():
        raise InputError("name", f"found {name!r}", "give a name that a class can have")
    for coefficient in coefficients:
        if coefficient.term.function is not None:
            raise InputError(f"term '{coefficient.term}'", "is a function", "write it as arithmetic to export it")
    base = type(system)
    if "<" in base.__qualname__:
        raise InputError("system", f"{base.__qualname__} is defined inside a function", "define its class in a module")
    made = {key: value for key, value in systems.describe(system).items() if key != "name"}
    arguments = ", ".join(f"{key}={value!r}" for key, value in made.items())
    formula = Formula(tuple(c.term for c in coefficients), tuple(c.shared for c in coefficients))
    own = [c for c in coefficients if not c.shared]
    count = len(own)
    parameters = "".join(
        f"            Parameter({f'c{k}'!r}, positive=False, scale={max(abs(c.value), c.spread, 1e-12):.6g}),"
        f"  # {c.term}\n"
        for k, c in enumerate(own)
    )
    u = ", *u" if system.known or system.has_events else ""
    lines = [
        f'"""{base.__name__} with the terms that its data call for."""',
        "",
        "from __future__ import annotations",
        "",
        "import torch",
        "",
        "from expertaug import Parameter",
        f"from {base.__module__} import {base.__qualname__.partition('.')[0]}",
        "",
        "",
        f"class {name}({base.__qualname__}):",
        f'    """{base.__name__}, and {formula}."""',
        "",
        "    def __init__(self) -> None:",
        f"        super().__init__({arguments})",
    ]
    if own:
        lines += ["        self.expert_parameters = (", "            *self.expert_parameters,", parameters.rstrip("\n")]
        lines += ["        )"]
    before = f"z_e[..., :-{count}]" if count else "z_e"
    lines += _overrides(system, base, before, u, [*coefficients], own)
    return "\n".join(lines) + "\n"


def _overrides(
    system: System, base: type[System], before: str, u: str, coefficients: Sequence[Coefficient], own: Sequence
) -> list[str]:
    lines: list[str] = []
    rates = {"expert": f"t, y, {before}{u}"}
    if base.nonlinear is not System.nonlinear:
        rates["nonlinear"] = rates["expert"]
    for method, arguments in rates.items():
        lines += [
            "",
            f"    def {method}(self, t, y, z_e{u}):",
            f"        return super().{method}({arguments}) + self.added(y, z_e{u})",
        ]
    if own:
        passed = {"event": "y", "jump": "y", "energy": "y", "initial_state": "y", "linear_flow": None}
        for method, first in passed.items():
            if getattr(base, method) is System.__dict__[method]:
                continue
            if first is None:
                lines += ["", "    def linear_flow(self, z_e, h):", f"        return super().linear_flow({before}, h)"]
            else:
                lines += ["", f"    def {method}(self, {first}, z_e):"]
                lines += [f"        return super().{method}({first}, {before})"]
    return [*lines, "", *_add(system, coefficients, own, u)]


def _add(system: System, coefficients: Sequence[Coefficient], own: Sequence[Coefficient], u: str) -> list[str]:
    space = len(system.state_shape) - 1
    cells = "".join(", None" for _ in range(space))
    names = [p.name for p in system.state]
    used = {name for c in coefficients for name in c.term.names}
    lines = [
        f"    def added(self, y, z_e{u}):",
        '        """What the terms add to the rates, in the shape of y."""',
    ]
    lines += [f"        {n} = y.select({-1 - space}, {k})" for k, n in enumerate(names) if n in used]
    rest = used - set(names)
    parameters = [p.name for p in system.expert_parameters]
    shift = len(parameters) + len(own)
    lines += [f"        {n} = z_e[..., {k - shift}{cells}]" for k, n in enumerate(parameters) if n in rest]
    lines += [f"        {p.name} = u[0][..., {k}{cells}]" for k, p in enumerate(system.known) if p.name in rest]
    rates: dict[str, list[str]] = {}
    for c in coefficients:
        number = f"z_e[..., {own.index(c) - len(own)}{cells}]" if not c.shared else f"({c.value!r})"
        rates.setdefault(c.term.rate, []).append(f"{number} * ({_torch(c.term)})")
    lines.append("        added = torch.zeros_like(y)")
    for rate, parts in rates.items():
        lines.append(f"        added.select({-1 - space}, {names.index(rate)}).add_({' + '.join(parts)})")
    if system.has_events:
        side = "(..., " + ", ".join("None" for _ in range(space + 1)) + ")"
        lines.append(f"        return torch.where(u[-1][{side}] == 0, 0.0, added)")
    else:
        lines.append("        return added")
    return lines


def _torch(term: Term) -> str:
    """A term's text with torch's functions."""

    class Named(ast.NodeTransformer):
        def visit_Call(self, node: ast.Call) -> ast.AST:
            self.generic_visit(node)
            assert isinstance(node.func, ast.Name)
            node.func = ast.Attribute(ast.Name("torch"), node.func.id)
            return node

        def visit_Name(self, node: ast.Name) -> ast.AST:
            return ast.Constant(math.pi) if node.id == "pi" else node

    tree = ast.parse(term.text, mode="eval")
    return ast.unparse(ast.fix_missing_locations(Named().visit(tree)))

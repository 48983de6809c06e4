"""Terms of an equation: what is added to a rate, as a text that can be read, written into a file, and typeset."""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Callable, Collection, Mapping, MutableMapping
from dataclasses import dataclass, field
from functools import cached_property

import torch
from torch import Tensor

from expertaug.errors import InputError
from expertaug.measurements import expression
from expertaug.systems import System

Values = MutableMapping[str, Tensor]  # calls that terms have in common are kept there
FUNCTIONS: Mapping[str, Callable] = {name: getattr(torch, name) for name in expression.FUNCTIONS}
GREEK = frozenset(
    (
        *("alpha", "beta", "gamma", "delta", "epsilon", "zeta", "eta", "theta", "iota", "kappa", "lambda", "mu", "nu"),
        *("xi", "pi", "rho", "sigma", "tau", "phi", "chi", "psi", "omega"),
    )
)
LATEX_CALLS = {"abs": r"\left|%s\right|", "sqrt": r"\sqrt{%s}", "exp": r"e^{%s}"}
NAMED = {"log": r"\ln", "sin": r"\sin", "cos": r"\cos", "tan": r"\tan", "tanh": r"\tanh"}
PRECEDENCE: Mapping[type, int] = {ast.Add: 1, ast.Sub: 1, ast.Mult: 2, ast.Div: 3, ast.Pow: 4}


@dataclass(frozen=True)
class Term:
    """A term in the rate of one component of the state, but for its coefficient.

    Attributes:
        rate: the component whose rate it is added to.
        text: arithmetic with the state's components, the known inputs and the expert's parameters, by name, such as
            ``abs(omega) * omega``; with a ``function`` its name.
        function: its values (…) of all these quantities by name, (…) each, in their units, instead of the arithmetic;
            such a term cannot be written into a file.

    Raises:
        InputError: the text is no such arithmetic.
    """

    rate: str
    text: str
    function: Callable[[Values], Tensor] | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        if self.function is None:
            expression.names(self.text, "term")

    @classmethod
    def of(cls, term: Term | str) -> Term:
        """From ``rate: text``.

        Raises:
            InputError: it is not of this form.
        """
        if isinstance(term, Term):
            return term
        rate, colon, text = str(term).partition(":")
        if not colon or not text.strip():
            raise InputError("term", f"found {term!r}", "write it as 'rate: expression', such as 'omega: omega'")
        return cls(rate.strip(), text.strip())

    def __str__(self) -> str:
        return f"{self.rate}: {self.text}"

    @cached_property
    def names(self) -> list[str]:
        """Quantities that it uses; of a function none is known."""
        return [] if self.function is not None else expression.names(self.text, "term")

    @cached_property
    def length(self) -> int:
        """How many quantities, numbers, operations and functions its text has; of a function 1."""
        return 1 if self.function is not None else sum(isinstance(n, ast.expr) for n in ast.walk(self._tree))

    def check(self, system: System) -> Term:
        """The term itself, of a system that has what it names.

        Raises:
            InputError: it does not.
        """
        state = [p.name for p in system.state]
        if self.rate not in state:
            raise InputError(f"term '{self}'", f"'{self.rate}' has no rate", f"known: {', '.join(state)}")
        names = dict.fromkeys((*state, *(p.name for p in (*system.known, *system.expert_parameters))))
        for name in self.names:
            if name not in names:
                raise InputError(f"term '{self}'", f"names '{name}'", f"known: {', '.join(names)}")
        return self

    def value(self, values: Values) -> Tensor:
        """Its values (…) of quantities by name, (…) each."""
        if self.function is not None:
            return self.function(values)
        result = _value(self._tree, values)
        return result if isinstance(result, Tensor) else torch.full_like(next(iter(values.values())), result)

    @property
    def latex(self) -> str:
        """For a formula; empty of the constant."""
        if self.function is not None:
            return r"\mathrm{{{}}}".format(re.sub(r"([_#%&$])", r"\\\1", self.text).replace(" ", r"\ "))
        return "" if self.text == "1" else _latex(self._tree, 2)

    @cached_property
    def _tree(self) -> ast.AST:
        return ast.parse(self.text, mode="eval").body


def quantities(
    system: System,
    y: Tensor,
    z_e: Tensor | None = None,
    u: Tensor | None = None,
    chosen: Collection[str] | None = None,
) -> dict[str, Tensor]:
    """What terms may name, each in the shape (…, *cells) of a component of states y (…, *state).

    Arguments:
        z_e: expert parameters (…, P).
        u: known inputs (…, U).
        chosen: names that terms use; the state's first component comes in any case.
    """
    space = len(system.state_shape) - 1
    cells = (..., *[None] * space)
    values = {p.name: y.select(-1 - space, k) for k, p in enumerate(system.state) if k == 0 or _in(p.name, chosen)}
    for tensor, parameters in ((z_e, system.expert_parameters), (u, system.known)):
        if tensor is not None:
            for k, p in enumerate(parameters):
                if p.name not in values and _in(p.name, chosen):  # initial speeds may have the names of components
                    values[p.name] = tensor[..., k][cells]
    return values


def _in(name: str, chosen: Collection[str] | None) -> bool:
    return chosen is None or name in chosen


def latex_name(name: str) -> str:
    r"""A quantity's name for a formula: ``omega0`` → ``\omega_{0}``."""
    head, rest = re.fullmatch(r"([A-Za-z]+)_?(.*)", name).groups() if re.match(r"[A-Za-z]", name) else (name, "")
    symbol = "\\" + head if head.lower() in GREEK else head if len(head) == 1 else rf"\mathrm{{{head}}}"
    return symbol + ("_{{{}}}".format(rest.replace("_", ",")) if rest else "")


def _value(node: ast.AST, values: Values) -> Tensor | float:
    if isinstance(node, ast.Constant):
        return float(node.value)  # type: ignore[arg-type]
    if isinstance(node, ast.Name):
        return values[node.id] if node.id in values else float(expression.CONSTANTS[node.id])
    if isinstance(node, ast.BinOp):
        return expression.BINARY[type(node.op)](_value(node.left, values), _value(node.right, values))
    if isinstance(node, ast.UnaryOp):
        inside = _value(node.operand, values)
        return -inside if isinstance(node.op, ast.USub) else inside
    assert isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
    text = _text(node)
    if text not in values:
        like = next(iter(values.values()))
        inside = [
            torch.as_tensor(_value(argument, values), dtype=like.dtype, device=like.device) for argument in node.args
        ]
        values[text] = FUNCTIONS[node.func.id](*inside)
    return values[text]


def _text(node: ast.AST) -> str:
    """An expression's text, made once."""
    if "text" not in vars(node):
        vars(node)["text"] = ast.unparse(node)
    return vars(node)["text"]


def _latex(node: ast.AST, outer: int = 0) -> str:
    """LaTeX of an expression inside one that binds as tightly as ``outer``."""
    if isinstance(node, ast.Constant):
        return f"{node.value:g}"
    if isinstance(node, ast.Name):
        return r"\pi" if node.id == "pi" else latex_name(node.id)
    if isinstance(node, ast.UnaryOp):
        return ("-" if isinstance(node.op, ast.USub) else "") + _latex(node.operand, 3)
    if isinstance(node, ast.Call):
        assert isinstance(node.func, ast.Name)
        inside = ", ".join(_latex(argument) for argument in node.args)
        if node.func.id in LATEX_CALLS:
            return LATEX_CALLS[node.func.id] % inside
        return NAMED.get(node.func.id, rf"\mathrm{{{node.func.id}}}") + rf"\left({inside}\right)"
    assert isinstance(node, ast.BinOp)
    own = PRECEDENCE[type(node.op)]
    if isinstance(node.op, ast.Div):
        return rf"\frac{{{_latex(node.left)}}}{{{_latex(node.right)}}}"
    if isinstance(node.op, ast.Pow):
        text = f"{_latex(node.left, 5)}^{{{_latex(node.right)}}}"
    else:
        sign = {ast.Add: " + ", ast.Sub: " - ", ast.Mult: r" \, "}[type(node.op)]
        text = _latex(node.left, own) + sign + _latex(node.right, own + isinstance(node.op, ast.Sub))
    return rf"\left({text}\right)" if own < outer else text


def round_to_error(value: float, error: float = math.nan) -> str:
    """A number to two digits of its error, or to four of its own."""
    if not math.isfinite(value):
        return "nan"
    if not (math.isfinite(error) and error > 0):
        return f"{value:.4g}"
    return f"{value:.{min(max(1 - math.floor(math.log10(error)), 0), 12)}f}"

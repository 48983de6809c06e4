"""Arithmetic with columns that a configuration writes as a text, such as ``omega**2 / 2 - 1.4 * cos(theta)``."""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Mapping

import numpy as np

from expertaug.errors import InputError

LONGEST = 500  # characters
LARGEST = 1e300
FUNCTIONS: Mapping[str, np.ufunc] = {
    name: getattr(np, name)
    for name in (
        *("abs", "sqrt", "exp", "log", "sin", "cos", "tan", "tanh", "arcsin", "arccos", "arctan", "arctan2", "hypot"),
        *("sign", "minimum", "maximum"),
    )
}
CONSTANTS = {"pi": np.pi}
BINARY: Mapping[type, Callable] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}
UNARY: Mapping[type, Callable] = {ast.USub: operator.neg, ast.UAdd: operator.pos}


def names(text: str, where: object) -> list[str]:
    """Names of columns that an expression uses, in order.

    Raises:
        InputError: it is none, or does more than arithmetic with columns and the functions above.
    """
    if len(text) > LONGEST:
        raise InputError(where, f"an expression of {len(text)} characters", f"at most {LONGEST} are read")
    try:
        tree = ast.parse(text.strip(), mode="eval")
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise InputError(where, f"'{text}' is no expression", "write arithmetic, as theta**2 + omega**2") from error
    used_names: dict[str, None] = {}
    _check(tree.body, text, where, used_names)
    return [name for name in used_names if name not in CONSTANTS]


def value(text: str, columns: Mapping[str, np.ndarray], where: object) -> np.ndarray:
    """An expression's value in every row: (n,), NaN where a column has none or it is not defined.

    Raises:
        InputError: as :func:`names`, or a column that is not there.
    """
    for name in names(text, where):
        if name not in columns:
            raise InputError(where, f"'{text}' names '{name}'", f"known: {', '.join(columns)}")
    shape = next(iter(columns.values())).shape
    with np.errstate(all="ignore"):
        values = np.asarray(_value(ast.parse(text.strip(), mode="eval").body, columns), dtype=float)
    values = np.broadcast_to(values, shape)
    return np.where(np.isfinite(values), values, np.nan)


def _check(node: ast.AST, text: str, where: object, used_names: dict[str, None]) -> None:
    if isinstance(node, ast.Constant) and type(node.value) in (int, float):
        if abs(node.value) > LARGEST:
            raise InputError(where, f"'{text}' has a number beyond {LARGEST:g}", "write a smaller one")
        return
    if isinstance(node, ast.Name):
        used_names[node.id] = None
        return
    inside: list[ast.AST] | None = None
    if isinstance(node, ast.BinOp) and type(node.op) in BINARY:
        inside = [node.left, node.right]
    elif isinstance(node, ast.UnaryOp) and type(node.op) in UNARY:
        inside = [node.operand]
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
        if node.func.id not in FUNCTIONS:
            listed = ", ".join(FUNCTIONS)
            raise InputError(where, f"'{text}' calls '{node.func.id}'", f"functions: {listed}")
        wanted = FUNCTIONS[node.func.id].nin
        if len(node.args) != wanted:
            raise InputError(where, f"'{text}' gives {node.func.id} {len(node.args)} arguments", f"give {wanted}")
        inside = list(node.args)
    if inside is None:
        what = ast.unparse(node)[:60]
        raise InputError(where, f"'{text}' has '{what}'", f"only + - * / **, numbers, columns, {', '.join(FUNCTIONS)}")
    for child in inside:
        _check(child, text, where, used_names)


def _value(node: ast.AST, columns: Mapping[str, np.ndarray]) -> np.ndarray | float:
    if isinstance(node, ast.Constant):
        return float(node.value)  # type: ignore[arg-type]
    if isinstance(node, ast.Name):
        return CONSTANTS[node.id] if node.id in CONSTANTS else columns[node.id]
    if isinstance(node, ast.BinOp):
        return BINARY[type(node.op)](*(np.asarray(_value(n, columns)) for n in (node.left, node.right)))
    if isinstance(node, ast.UnaryOp):
        return UNARY[type(node.op)](_value(node.operand, columns))
    assert isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
    return FUNCTIONS[node.func.id](*(_value(n, columns) for n in node.args))

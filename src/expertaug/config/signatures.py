"""Arguments of the classes that a configuration names, read from their source: nothing is imported, so that checking a
configuration does not wait for torch."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

from expertaug import registry, source_files
from expertaug.errors import InputError

# What the package itself passes; the configuration gives the rest.
GIVEN = {
    "encoder": {"system", "times"},
    "interaction": {"system", "latent"},
    "objective": {"seeds", "choices", "prior"},
}
# What a class must define that has this class as its only base.
NEEDED = {"System": ("state", "expert_parameters", "expert"), "Objective": ("loss",)}
OF_SIMULATIONS = ("truth", "sample_initial_state")


def of_kind(part: str, kind: str, where: str) -> list[str]:
    """Arguments that a configuration may give to a kind: a built-in one or ``package.module:Class``.

    Raises:
        InputError: there is no such kind, module or class.
    """
    return [a for a in _all_of_kind(part, kind, where) if a not in GIVEN[part]]


def takes(part: str, kind: str, argument: str, where: str) -> bool:
    """Whether a kind's class has an argument, be it one that the package gives."""
    return argument in _all_of_kind(part, kind, where)


def _all_of_kind(part: str, kind: str, where: str) -> list[str]:
    module, _, name = registry.full_name(part, kind, where).partition(":")
    return _arguments(_class(source_files.find(where, module), name, where))


def of_system(name: str, where: str) -> list[str]:
    """Arguments of a system's class."""
    return _arguments(_system(name, where))


def require_simulation(name: str, where: str) -> None:
    """A system's class must say how it is simulated."""
    _require(_system(name, where), OF_SIMULATIONS, where)


def parameters(name: str, attribute: str, where: str) -> list[str] | None:
    """Names in one of a system's tuples of parameters; None where the class does not write them out."""
    value = _defined(_system(name, where)).get(attribute)
    items = value.elts if isinstance(value, ast.Tuple) else [None]
    names = [item.args[0] for item in items if isinstance(item, ast.Call) and item.args]
    texts = [n.value for n in names if isinstance(n, ast.Constant) and isinstance(n.value, str)]
    return texts if len(texts) == len(items) else None


def _system(name: str, where: str) -> ast.ClassDef:
    """The one class with ``System`` among its bases in a system's module."""
    body = _tree(source_files.find(where, name if "." in name else f"expertaug.systems.{name}")).body
    found = [n for n in body if isinstance(n, ast.ClassDef) and any("System" in ast.unparse(b) for b in n.bases)]
    if len(found) != 1:
        number = {0: "no System"}.get(len(found), f"{len(found)} systems")
        raise InputError(where, f"{name} defines {number}", "name a module with one class whose base is System")
    _require(found[0], (), where)
    return found[0]


def _defined(node: ast.ClassDef) -> dict[str, ast.AST | None]:
    """What a class body defines: functions, and values by name."""
    found: dict[str, ast.AST | None] = {}
    for item in node.body:
        if isinstance(item, ast.FunctionDef):
            found[item.name] = item
        elif isinstance(item, ast.Assign):
            found |= {name.id: item.value for t in item.targets for name in ast.walk(t) if isinstance(name, ast.Name)}
        elif isinstance(item, ast.AnnAssign) and isinstance(item.target, ast.Name) and item.value is not None:
            found[item.target.id] = item.value
    return found


def _require(node: ast.ClassDef, names: tuple[str, ...], where: str) -> None:
    """What a class must define, where it cannot inherit it from another base than this package's."""
    base = ast.unparse(node.bases[0]).rpartition(".")[2] if len(node.bases) == 1 else ""
    if base not in NEEDED:
        return
    # Attributes may also be set by the constructor.
    own = {n.attr for n in ast.walk(node) if isinstance(n, ast.Attribute) and isinstance(n.ctx, ast.Store)}
    for name in (*NEEDED[base], *names):
        if name not in own and name not in _defined(node):
            raise InputError(where, f"the class {node.name} does not define {name}", f"a {base} needs it")


def _class(path: Path, name: str, where: str) -> ast.ClassDef:
    for node in _tree(path).body:
        if isinstance(node, ast.ClassDef) and node.name == name:
            _require(node, (), where)
            return node
    raise InputError(where, f"no class '{name}' in {path.name}", "correct the name")


def _arguments(node: ast.ClassDef) -> list[str]:
    init = _defined(node).get("__init__")
    if not isinstance(init, ast.FunctionDef):
        return []
    return [a.arg for a in (*init.args.args, *init.args.kwonlyargs) if a.arg != "self"]


@cache
def _tree(path: Path) -> ast.Module:
    return source_files.parsed(path)

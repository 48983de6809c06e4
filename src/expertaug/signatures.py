"""Arguments of the classes that a configuration names, read from their source: nothing is imported, so that checking a
configuration does not wait for torch."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

from expertaug import kinds, sources
from expertaug.errors import InputError

# What the package itself passes; the configuration gives the rest.
GIVEN = {
    "encoder": {"system", "times"},
    "interaction": {"system", "latent"},
    "objective": {"seeds", "choices", "prior"},
}


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
    module, _, name = kinds.full_name(part, kind, where).partition(":")
    return _arguments(sources.find(where, module), name, where)


def of_system(name: str, where: str) -> list[str]:
    """Arguments of the one class with ``System`` among its bases in a system's module."""
    path = sources.find(where, name if "." in name else f"expertaug.systems.{name}")
    for node in _tree(path).body:
        if isinstance(node, ast.ClassDef) and any("System" in ast.unparse(base) for base in node.bases):
            return _arguments(path, node.name, where)
    raise InputError(where, f"{name} defines no System", "name a module with one System class")


def _arguments(path: Path, name: str, where: str) -> list[str]:
    for node in _tree(path).body:
        if isinstance(node, ast.ClassDef) and node.name == name:
            for item in node.body:
                if isinstance(item, ast.FunctionDef) and item.name == "__init__":
                    return [a.arg for a in (*item.args.args, *item.args.kwonlyargs) if a.arg != "self"]
            return []
    raise InputError(where, f"no class '{name}' in {path.name}", "correct the name")


@cache
def _tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))

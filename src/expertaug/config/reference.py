"""The reference of the configuration, made from its models.

``python -m expertaug.config.reference config/README.md`` writes it.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from expertaug import presets
from expertaug.config.models import Configuration
from expertaug.files import write_text
from expertaug.learning.settings import OBJECTIVES
from expertaug.models.settings import ENCODERS, INTERACTIONS
from expertaug.settings import ByName, is_left_out
from expertaug.systems.settings import SYSTEMS
from expertaug.wording import show

BEGIN = "<!-- From here on made from the models: python -m expertaug.config.reference config/README.md -->"
KINDS = {float: "number", int: "whole number", str: "text", bool: "true, false", Any: "any"}
SIGNS = {"gt": ">", "ge": "≥", "lt": "<", "le": "≤"}
# An experiment under a preset, and what a method has otherwise, have the keys that stand elsewhere.
AS_ELSEWHERE = ("experiments.<name>.presets", "experiments.<name>.overrides.<name>", "experiments.<name>.choices")


def reference() -> str:
    """Markdown: a section for each block of keys, a table row for each key."""
    shown: dict[type[BaseModel], str] = {}
    for path, kind in _blocks("", Configuration):
        shown.setdefault(kind, path)
    # Between backticks, since Markdown takes <name> for HTML.
    titles = {kind: f"`{path}`" if path else "Top level" for kind, path in shown.items()}
    sections = [_section(titles[kind], kind, _pointers(path, kind, shown)) for kind, path in shown.items()]
    for name, kinds in (("system", SYSTEMS), ("model.encoder", ENCODERS), ("model.interaction", INTERACTIONS)):
        key = "name" if name == "system" else "kind"
        sections += [_section(f"{name}, {key}: {kind}", model) for kind, model in kinds.items()]
    sections += [_section(f"training.objective, of the objective {kind}", model) for kind, model in OBJECTIVES.items()]
    return "\n\n".join([*sections, *_presets()]) + "\n"


def _presets() -> Iterator[str]:
    """What each preset chooses: the rows that ``choices`` may override, and what the shipped experiments simulate."""
    heads = [*presets.NAMES, "meaning"]
    rows = [_cells(f"`{name}`", row) for name, row in presets.ROWS.items()]
    yield "\n".join(["## choices, by preset", "", *_head("row", *heads), *rows])
    rows = [_cells(f"`{row.experiment}` | `{row.key}`", row) for row in presets.SIMULATED]
    title = "## What the shipped experiments simulate, by preset"
    yield "\n".join([title, "", *_head("experiment", "key", *heads), *rows])


def _cells(name: str, row: presets.Row | presets.Simulated) -> str:
    values = [f"`{show(getattr(row, preset))}`" for preset in presets.NAMES]
    meaning = row.meaning.replace("|", "\\|")
    return f"| {' | '.join([name, *values, meaning])} |"


def _head(*titles: str) -> list[str]:
    return [f"| {' | '.join(titles)} |", f"|{'---|' * len(titles)}"]


def _section(title: str, kind: type[BaseModel], pointers: Mapping[str, str] = MappingProxyType({})) -> str:
    rows = [_row(name, field, is_left_out(kind, name)) for name, field in kind.model_fields.items()]
    for k, name in enumerate(kind.model_fields):
        if name in pointers:
            rows[k] = rows[k].replace("keys", f"keys of `{pointers[name]}`", 1)
    return "\n".join([f"## {title}", "", "| key | value | default | meaning |", "|---|---|---|---|", *rows])


def _pointers(path: str, kind: type[BaseModel], shown: Mapping[type[BaseModel], str]) -> dict[str, str]:
    """Where the keys of a block's blocks stand, if not in a section of their own."""
    pointers = {}
    for name, field in kind.model_fields.items():
        own = f"{path}.{name}".lstrip(".")
        for model, _ in _models(field.annotation):
            if model in shown and shown[model] not in (own, f"{own}.<name>"):
                pointers[name] = shown[model]
    return pointers


def _blocks(path: str, kind: type[BaseModel]) -> Iterator[tuple[str, type[BaseModel]]]:
    """A block's path and model, then those of the blocks inside it."""
    yield path, kind
    for name, field in kind.model_fields.items():
        below = f"{path}.{name}".lstrip(".")
        for inside, named in _models(field.annotation):
            at = f"{below}.<name>" if named else below
            if below not in AS_ELSEWHERE and at not in AS_ELSEWHERE:
                yield from _blocks(at, inside)


def _models(annotation: Any) -> Iterator[tuple[type[BaseModel], bool]]:
    """Models in a type, and whether they stand below names."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation, False
    named = get_origin(annotation) is dict
    inside = get_args(annotation)
    for part in inside[1:] if named else inside[:1] if get_origin(annotation) is Annotated else inside:
        for model, below in _models(part):
            yield model, named or below


def _row(name: str, field: FieldInfo, left_out: bool) -> str:
    default = (
        "left out"
        if left_out
        else "–"
        if field.is_required()
        else _default(field.get_default(call_default_factory=True))
    )
    extra = field.json_schema_extra if isinstance(field.json_schema_extra, Mapping) else {}
    value = _value(field.annotation, field.metadata)
    unit = f" in {extra['unit']}" if extra.get("unit") else ""
    return f"| `{name}` | {value}{unit} | {default} | {field.description or ''} |".replace("\n", " ")


def _default(value: object) -> str:
    if isinstance(value, BaseModel) or value == {}:
        return ""
    return f"`{show(list(value) if isinstance(value, tuple) else value)}`"


def _value(annotation: Any, metadata: list[Any]) -> str:
    origin, inside = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _value(inside[0], [*inside[1:], *metadata])
    if by_name := next((m for m in metadata if isinstance(m, ByName)), None):
        return ", ".join(f"`{name}`" for name in by_name.names()) + ", or `package.module:Class`"
    if origin in (Union, UnionType):
        return " or ".join("null" if a is type(None) else _value(a, metadata) for a in inside)
    if origin is Literal:
        return ", ".join(f"`{'false' if value is False else value}`" for value in inside)
    if origin is dict or (isinstance(annotation, type) and issubclass(annotation, BaseModel)):
        return "keys"
    if origin is tuple and inside[-1] is not Ellipsis:
        ordered = any((getattr(m, "json_schema_extra", None) or {}).get("ordered") for m in metadata)
        return "[min, max]" if ordered else f"list: {len(inside)} of {_value(inside[0], [])}"
    if origin in (list, tuple):
        return f"list: {_value(inside[0], [])}"
    return KINDS.get(annotation, "text") + _limits(metadata)


def _limits(metadata: list[Any]) -> str:
    parts = [part for constraint in metadata for part in (constraint, *getattr(constraint, "metadata", ()))]
    limits = [f"{sign} {getattr(p, key)}" for key, sign in SIGNS.items() for p in parts if hasattr(p, key)]
    # A limit that only keeps a number within what machines count says nothing to a reader.
    limits = [text for text in limits if float(text.split()[1]) < 1e8]
    return f" {', '.join(limits)}" if limits else ""


def main() -> None:
    """Rewrite the part of a file that is made from the models."""
    path = Path(sys.argv[1])
    head = path.read_text(encoding="utf-8").partition("<!-- From here on made from")[0]
    write_text(path, f"{head}{BEGIN}\n\n{reference()}")


if __name__ == "__main__":
    main()

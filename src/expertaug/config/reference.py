"""The reference of the configuration, made from its schema: ``python -m expertaug.config.reference FILE``."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

from expertaug.config import load as config
from expertaug.files import write_text

BEGIN = "<!-- From here on made from the schema: python -m expertaug.config.reference config/README.md -->"
UNITS = {"number": "number", "integer": "whole number", "string": "text", "boolean": "true, false", "array": "list"}


def reference() -> str:
    """Markdown: a section for each block of keys, a table row for each key."""
    schema = config.read_schema()
    sections = []
    for title, rows in _blocks("", schema, schema):
        lines = [f"## {title or 'Top level'}", "", "| key | value | default | meaning |", "|---|---|---|---|"]
        sections.append("\n".join([*lines, *rows]))
    return "\n\n".join(sections) + "\n"


def _blocks(path: str, rule: Mapping, root: Mapping) -> Iterator[tuple[str, list[str]]]:
    """A block's path and rows, then those of the blocks inside it."""
    inside, rows = [], []
    keys = dict(rule.get("properties", {}))
    if isinstance(rule.get("additionalProperties"), Mapping):
        keys["<name>"] = rule["additionalProperties"]
    for key, value in keys.items():
        value = config.resolved(value, root)
        rows.append(_row(key, value, key in rule.get("required", ()), root))
        if "properties" in value or isinstance(value.get("additionalProperties"), Mapping):
            inside.append((f"{path}.{key}".lstrip("."), value))
    yield path, rows
    for name, value in inside:
        yield from _blocks(name, value, root)


def _row(key: str, rule: Mapping, required: bool, root: Mapping) -> str:
    default = "–" if required else f"`{config.show(rule['default'])}`" if "default" in rule else "left out"
    if rule.get("default") == {}:
        default = ""
    return f"| `{key}` | {_values(rule, root)} | {default} | {rule.get('description', '')} |".replace("\n", " ")


def _values(rule: Mapping, root: Mapping) -> str:
    if "enum" in rule:
        return ", ".join(f"`{value}`" for value in rule["enum"])
    kinds = rule.get("type", "object")
    kinds = [kinds] if isinstance(kinds, str) else kinds
    texts = []
    for kind in kinds:
        if kind == "array":
            item = config.resolved(rule.get("items", {}), root)
            count = (
                f"{rule['minItems']} of " if rule.get("maxItems") == rule.get("minItems") and "minItems" in rule else ""
            )
            texts.append("[min, max]" if rule.get("ordered") else f"list: {count}{_values(item, root)}")
        elif kind == "object":
            texts.append("keys")
        elif kind == "null":
            texts.append("null")
        else:
            texts.append(UNITS[kind] + _limits(rule))
    return " or ".join(texts)


def _limits(rule: Mapping) -> str:
    signs = {"exclusiveMinimum": ">", "minimum": "≥", "maximum": "≤"}
    found = [f"{sign} {rule[key]}" for key, sign in signs.items() if key in rule]
    return f" {', '.join(found)}" if found else ""


def main() -> None:
    """Rewrite the part of a file that is made from the schema."""
    path = Path(sys.argv[1])
    head = path.read_text(encoding="utf-8").partition(BEGIN)[0]
    write_text(path, f"{head}{BEGIN}\n\n{reference()}")


if __name__ == "__main__":
    main()

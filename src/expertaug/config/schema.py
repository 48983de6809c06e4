"""The JSON schema of configuration files, for editors: ``python -m expertaug.config.schema config/schema.json``.

It is made from the models; the workflow checks with the models themselves.  Files override each other key by key, so
that it requires nothing.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from expertaug.config.models import Configuration, Override
from expertaug.files import write_text
from expertaug.learning.settings import OBJECTIVES
from expertaug.models.settings import ENCODERS, INTERACTIONS
from expertaug.systems.settings import SYSTEMS

OWN = {"pattern": ":", "description": "a class of your own, as package.module:Class"}


def schema() -> dict[str, Any]:
    """The schema, draft 2020-12."""
    made = Configuration.model_json_schema(ref_template="#/$defs/{model}")
    definitions = made["$defs"]
    for kind in (Override, *OBJECTIVES.values(), *ENCODERS.values(), *INTERACTIONS.values(), *SYSTEMS.values()):
        _add(definitions, kind)
    definitions["encoder"] = _one_of_kinds(ENCODERS, "kind", OWN)
    definitions["interaction"] = _one_of_kinds(INTERACTIONS, "kind", OWN)
    elsewhere = {"pattern": r"\.", "description": "a module of your own, as package.module"}
    definitions["system"] = _one_of_kinds(SYSTEMS, "name", elsewhere)
    options = {k: v for kind in OBJECTIVES.values() for k, v in definitions[kind.__name__]["properties"].items()}
    definitions["objective"] = {"type": "object", "properties": options}
    for holder in ("Experiment", "Override"):
        _refer(definitions[holder]["properties"], "system", "system")
    _refer(definitions["Override"]["properties"], "model", "Model")
    for part in ("encoder", "interaction"):
        _refer(definitions["Model"]["properties"], part, part)
    _refer(definitions["TrainSettings"]["properties"], "objective", "objective")
    made["properties"]["include"] = {
        "description": "files, relative to this one, that it overrides",
        "type": "array",
        "items": {"type": "string"},
    }
    return {"$schema": "https://json-schema.org/draft/2020-12/schema"} | _tidy(made)


def _add(definitions: dict[str, Any], kind: type[BaseModel]) -> None:
    made = kind.model_json_schema(ref_template="#/$defs/{model}")
    definitions.update(made.pop("$defs", {}))
    definitions.setdefault(kind.__name__, made)


def _one_of_kinds(kinds: Mapping[str, type[BaseModel]], key: str, own: Mapping[str, str]) -> dict[str, Any]:
    """A block whose keys are those of the kind that it names; a part of one without its kind is left open."""
    cases = [
        {
            "if": {"properties": {key: {"const": name}}, "required": [key]},
            "then": {"$ref": f"#/$defs/{kind.__name__}"},
        }
        for name, kind in kinds.items()
    ]
    choices = {"enum": list(kinds)}
    return {"type": "object", "properties": {key: {"anyOf": [choices, dict(own)]}}, "allOf": cases}


def _refer(properties: dict[str, Any], key: str, definition: str) -> None:
    properties[key] = {"$ref": f"#/$defs/{definition}", "description": properties[key].get("description", "")}


def _tidy(value: Any, inside: str = "") -> Any:
    """Without titles and defaults of what is left out, and without requirements but those of conditions."""
    if isinstance(value, list):
        return [_tidy(item) for item in value]
    if not isinstance(value, dict):
        return value
    if inside in ("properties", "$defs"):
        return {k: _tidy(v, "") for k, v in value.items()}
    dropped = {"title", "left_out", *({"default"} if value.get("left_out") else ())}
    dropped |= set() if inside == "if" else {"required"}
    return {k: _tidy(v, k) for k, v in value.items() if k not in dropped}


def main() -> None:
    """Write the schema to a file."""
    write_text(Path(sys.argv[1]), json.dumps(schema(), indent=1, ensure_ascii=False) + "\n")


if __name__ == "__main__":
    main()

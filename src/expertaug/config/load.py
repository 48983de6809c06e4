"""Reading and checking the configuration: one clear line for whatever is wrong, before any job starts.

``workflow/schemas/config.schema.yaml`` says which keys there are; what a schema cannot say is checked in
:mod:`expertaug.config.checks`.
"""

from __future__ import annotations

import copy
import json
import math
import re
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path

import yaml
from jsonschema import Draft202012Validator, ValidationError, validators

from expertaug.config import checks, presets
from expertaug.errors import InputError

SCHEMA = Path("workflow", "schemas", "config.schema.yaml")
NAMES = {
    "number": "a number",
    "integer": "a whole number",
    "string": "a text",
    "boolean": "true or false",
    "array": "a list",
    "object": "a mapping of keys",
    "null": "null",
}


def load(paths: Iterable[str | Path]) -> dict:
    """Read YAML files and merge them, later ones winning, mappings key by key.

    Raises:
        InputError: a file is missing or not YAML, or does not hold a mapping.
    """
    merged: dict = {}
    for path in paths:
        try:
            content = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
        except OSError as error:
            raise InputError(path, f"cannot be read ({error.strerror})", "give a configuration file") from error
        except (yaml.YAMLError, UnicodeDecodeError) as error:
            mark = getattr(error, "problem_mark", None)
            where = f"{path}:{mark.line + 1}:{mark.column + 1}" if mark else path
            raise InputError(
                where, f"not YAML ({getattr(error, 'problem', None) or error})", "correct that line"
            ) from error
        if content is None:
            continue
        if not isinstance(content, dict):
            raise InputError(path, f"found {show(content)}", "a configuration is a mapping of keys")
        merged = merge(merged, content)
    return merged


def merge(base: Mapping, over: Mapping) -> dict:
    """``base`` overridden by ``over``: mappings are merged key by key, anything else is replaced.

    A mapping that names another ``kind`` is replaced too: the arguments of one class are none of another's.
    """
    merged = copy.deepcopy(dict(base))
    for key, value in over.items():
        old = merged.get(key)
        both = isinstance(old, Mapping) and isinstance(value, Mapping)
        both = both and value.get("kind", old.get("kind")) == old.get("kind")
        merged[key] = merge(old, value) if both else copy.deepcopy(value)
    return merged


def validate(config: Mapping, schema: str | Path | None = None) -> dict:
    """Check a configuration and complete it.

    Arguments:
        config: as read from YAML, all files merged.
        schema: file of the schema; None finds the one of this checkout or of the working directory.

    Returns:
        the same with ``based_on`` and the chosen preset's ``presets`` merged, defaults filled in, ``choices``
        complete and ``tracking.uri`` set.

    Raises:
        InputError: the first thing that is wrong.
    """
    rules = read_schema() if schema is None else read_schema(Path(schema))
    config = json.loads(json.dumps(_plain(config)))
    # What a file says is checked where it says it, before it is inherited; what is missing only afterwards.
    _check(config, rules, missing=False)
    if isinstance(config.get("experiments"), dict):
        config["experiments"] = {name: _inherit(name, config["experiments"]) for name in config["experiments"]}
        config["experiments"] = _choose_preset(config, rules)
    config = fill(config, rules, rules)
    _check(config, rules)
    _check_overrides(config, rules)
    checks.check(config)
    common = config["choices"]
    config["choices"] = presets.resolve(config["preset"], common)
    for one in config["experiments"].values():
        one["choices"] = presets.resolve(config["preset"], common | one["choices"])
    config["results"] = config["results"].rstrip("/") or "/"
    if config["tracking"]["uri"] is None:
        config["tracking"]["uri"] = f"sqlite:///{config['results']}/mlflow/mlflow.db"
    return config


def _check_during_training(name: str, config: Mapping, rules: Mapping) -> None:
    """What studies.during_training says of the fine-tuning must fit that block."""
    one = config["experiments"][name]
    over = one["studies"].get("during_training", {}).get("finetuning", {})
    try:
        _check({**config, "experiments": {name: merge(one, {"finetuning": over} if over else {})}}, rules)
    except InputError as error:
        raise InputError(f"experiments.{name}.studies.during_training.finetuning", str(error)) from error


def _choose_preset(config: Mapping, rules: Mapping) -> dict[str, dict]:
    """The experiments with what they override under the configuration's preset; the others are only checked.

    ``choices`` of an experiment's ``presets`` are defaults like the preset's own: those of the top level, and the
    experiment's, win over them.
    """
    chosen = config.get("preset", rules["properties"]["preset"]["default"])
    merged = {}
    for name, one in config["experiments"].items():
        one = dict(one)
        merged[name] = _without_null(one)
        for preset, over in one.pop("presets", {}).items():
            try:
                _check({"experiments": {name: merge(one, over)}}, rules, missing=False)
            except InputError as error:
                raise InputError(f"experiments.{name}.presets.{preset}", str(error)) from error
            if preset == chosen:
                stated = merge(config.get("choices") or {}, one.get("choices") or {})
                merged[name] = _without_null(merge(merge(one, over), {"choices": stated}))
    return merged


def _check_overrides(config: Mapping, rules: Mapping) -> None:
    """What experiments.*.overrides say must fit the blocks that they override."""
    for name, one in config["experiments"].items():
        _check_during_training(name, config, rules)
        for method, blocks in one["overrides"].items():
            where = f"experiments.{name}.overrides.{method}"
            if method not in config["methods"]:
                raise InputError(where, "no method", checks.suggest(method, config["methods"]))
            try:
                _check({**config, "experiments": {name: merge(one, blocks)}}, rules)
            except InputError as error:
                raise InputError(where, str(error)) from error


def show(value: object) -> str:
    """A value as a short text that looks like YAML."""
    if isinstance(value, str):
        text = f"'{value}'"
    elif isinstance(value, float) and not math.isfinite(value):
        text = {"nan": ".nan", "inf": ".inf", "-inf": "-.inf"}[str(value)]
    elif isinstance(value, float):
        text = checks.number_in(repr(value))
    else:
        text = json.dumps(value, ensure_ascii=False, default=str)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _plain(value: object) -> object:
    """Mappings, lists and scalars of JSON; keys as text."""
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    return value if isinstance(value, str | int | float | bool | None) else str(value)


def _find_schema() -> Path:
    for folder in (Path(__file__).resolve().parents[3], Path.cwd()):
        if (folder / SCHEMA).is_file():
            return folder / SCHEMA
    raise InputError(SCHEMA, "no such file", "start in the project's folder")


@cache
def read_schema(path: Path | None = None) -> dict:
    """The configuration's JSON schema; without a path that of this checkout or of the working directory."""
    return yaml.safe_load((path or _find_schema()).read_text(encoding="utf-8"))


def _inherit(name: str, experiments: Mapping, after: tuple[str, ...] = ()) -> dict:
    """An experiment with the keys of the one that it is based on."""
    experiment = dict(experiments[name])
    base = experiment.pop("based_on", None)
    if base is None:
        return experiment
    where = f"experiments.{name}.based_on"
    if base not in experiments:
        raise InputError(where, f"found '{base}', which is no experiment", checks.suggest(base, experiments))
    if base in (name, *after):
        raise InputError(
            where, f"'{base}' is based on '{name}' itself", "name an experiment that is not based on this one"
        )
    return merge(_inherit(base, experiments, (name, *after)), experiment)


def _without_null(experiment: Mapping) -> dict:
    """An experiment without the studies and priors that it takes away."""
    blocks = ("studies", "augmentations")
    kept = {key: {k: v for k, v in experiment[key].items() if v is not None} for key in blocks if key in experiment}
    return {**experiment, **kept}


def fill(value: object, schema: object, root: Mapping) -> object:
    """``value`` with the schema's defaults where keys are missing, whole numbers as floats where those are wanted."""
    if not isinstance(schema, Mapping):
        return value
    schema = resolved(schema, root)
    if isinstance(value, dict):
        known = schema.get("properties", {})
        filled = dict(value)
        for key, rule in known.items():
            rule = resolved(rule, root)
            if key not in filled and "default" in rule:
                filled[key] = copy.deepcopy(rule["default"])
        return {k: fill(v, known.get(k, schema.get("additionalProperties")), root) for k, v in filled.items()}
    if isinstance(value, list):
        return [fill(v, schema.get("items"), root) for v in value]
    kinds = schema.get("type", ())
    wants_float = "number" in ([kinds] if isinstance(kinds, str) else kinds)
    return float(value) if type(value) is int and wants_float else value


def resolved(schema: Mapping, root: Mapping) -> dict:
    """A schema with its reference replaced by what that points to; its own keys win."""
    schema = dict(schema)
    reference = schema.pop("$ref", None)
    if reference is None:
        return schema
    target = root
    for part in reference.removeprefix("#/").split("/"):
        target = target[part]
    return {**resolved(target, root), **schema}


def _is_number(checker: object, value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _is_integer(checker: object, value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _ordered(validator: object, wanted: bool, value: object, schema: object) -> Iterable[ValidationError]:
    if isinstance(value, list) and len(value) == 2 and all(_is_number(None, v) for v in value) and value[0] > value[1]:
        yield ValidationError("min exceeds max")


_TYPES = Draft202012Validator.TYPE_CHECKER.redefine("number", _is_number).redefine("integer", _is_integer)
_Validator = validators.extend(Draft202012Validator, {"ordered": _ordered}, type_checker=_TYPES)


def _check(config: object, schema: Mapping, missing: bool = True) -> None:
    found = [e for e in _Validator(schema).iter_errors(config) if missing or e.validator != "required"]
    if found:
        raise _explained(min(found, key=lambda e: [str(part) for part in e.absolute_path]), schema)


def _path(parts: Iterable[object]) -> str:
    text = "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in parts)
    return text.lstrip(".") or "configuration"


def _explained(error: ValidationError, root: Mapping) -> InputError:
    """A schema's complaint in words: the key, what was found, what would be right."""
    path, value, limit = list(error.absolute_path), error.instance, error.validator_value
    where, found = _path(path), f"found {show(value)}"
    rule = error.schema if isinstance(error.schema, Mapping) else {}
    if error.validator == "additionalProperties":
        known = list(rule.get("properties", {}))
        key = next(k for k in value if k not in known)
        return InputError(_path([*path, key]), "unknown key", checks.suggest(key, known))
    if error.validator == "required":
        key = next(k for k in limit if k not in value)
        meaning = resolved(rule.get("properties", {}).get(key, {}), root).get("description", "")
        return InputError(_path([*path, key]), "missing", f"give {key}" + (f" ({meaning})" if meaning else ""))
    if error.validator == "type":
        kinds = [limit] if isinstance(limit, str) else limit
        number = {"number", "integer"} & set(kinds) and isinstance(value, str) and checks.number_in(value)
        if number:
            return InputError(where, f"{found}, which YAML takes for a text", f"write {number}")
        return InputError(where, found, f"give {' or '.join(NAMES[k] for k in kinds)}")
    if error.validator == "enum":
        return InputError(where, found, checks.suggest(value, limit))
    if error.validator == "pattern" and "propertyNames" in error.absolute_schema_path:
        return InputError(where, f"found the name {show(value)}", "use letters, digits and _, a letter first")
    remedies = {
        "ordered": "min must not exceed max",
        "minimum": f"give {limit} or more",
        "maximum": f"give {limit} or less",
        "exclusiveMinimum": f"give more than {limit}",
        "multipleOf": f"give a multiple of {limit}",
        "minItems": f"give {limit} or more values",
        "maxItems": f"give {limit} values",
        "minProperties": "give at least one",
        "minLength": "give a text",
        "uniqueItems": "name each once",
        "pattern": f"it must match {limit}",
    }
    return InputError(where, found, remedies.get(error.validator, re.sub(r"\s+", " ", error.message)))

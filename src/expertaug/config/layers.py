"""Layers of a configuration: files over files, an experiment over the one that it is based on."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any, TypeVar

from expertaug.config.yaml_file import Located
from expertaug.errors import InputError
from expertaug.settings import Raw, Settings
from expertaug.wording import suggest

S = TypeVar("S", bound=Settings)
# As YAML reads one; long ones stay texts, which nothing takes for a number.
NUMBER = re.compile(r"[-+]?((0|[1-9]\d{0,30})(\.\d{0,30})?|\.\d{1,30})([eE][-+]?\d{1,3})?")
CHAIN = 100  # experiments of which one is based on the next, at most
# Keys of an experiment's data that say something of one source alone.
OF_SOURCE = {"simulation": ("step_s", "t2_s", "sets"), "recordings": ("split",), "files": ("files",)}


def merge(base: Raw, over: Raw) -> Located:
    """``base`` overridden by ``over``: mappings are merged key by key, anything else is replaced.

    A mapping that names another ``kind`` is replaced too: the arguments of one class are none of another's.
    """
    return _merge_into(_copy(base), over)


def _merge_into(merged: Located, over: Raw) -> Located:
    """Override a mapping that is nobody else's."""
    origins = getattr(over, "origin", {})
    for key, value in over.items():
        old = merged.get(key)
        if isinstance(old, Located) and isinstance(value, Mapping) and _of_one_kind(old, value):
            _merge_into(old, value)
        else:
            merged[key] = _copy(value)
        if value is None and old is not None:
            merged.removed |= {key}
        merged.origin.pop(key, None)
        if key in origins:
            merged.origin[key] = origins[key]
    return merged


def _of_one_kind(old: Raw, new: Raw) -> bool:
    """Whether a mapping that overrides another names its ``kind``, or none."""
    return new.get("kind", old.get("kind")) == old.get("kind")


def overridden(base: S, over: Settings) -> S:
    """Settings with what others of the same keys give: mappings and blocks key by key, anything else replaced.

    A block that the first do not have is taken as it stands: what reads it fills in its defaults.
    """
    changes = {name: _over(getattr(base, name), getattr(over, name)) for name in over.model_fields_set}
    return base.model_copy(update=changes)


def _over(old: Any, new: Any) -> Any:
    if isinstance(old, Settings) and isinstance(new, Settings):
        return overridden(old, new)
    if isinstance(old, Mapping) and isinstance(new, Mapping) and _of_one_kind(old, new):
        return {**old, **{key: _over(old.get(key), value) for key, value in new.items()}}
    return new


def of_command_line(values: Raw) -> Located:
    """What ``--config`` says; of its ``key=value`` Snakemake takes true, false and null for texts, and within braces
    and brackets numbers as well."""
    read = {k: _word(v) if isinstance(v, str) else _parse_inline(v) for k, v in values.items()}
    return Located(_copy(read), dict.fromkeys(read, "--config"))


def _parse_inline(value: Any) -> Any:
    """A value of braces or brackets, whose numbers are texts."""
    if isinstance(value, Mapping):
        return {k: _parse_inline(v) for k, v in value.items()}
    if isinstance(value, list):
        return [_parse_inline(v) for v in value]
    if not isinstance(value, str) or not NUMBER.fullmatch(value):
        return _word(value) if isinstance(value, str) else value
    return float(value) if set(value) & set(".eE") else int(value)


def _word(text: str) -> str | bool | None:
    return {"true": True, "false": False, "null": None}.get(text, text)


def _copy(value: Any) -> Any:
    if isinstance(value, Mapping):
        copy = Located({k: _copy(v) for k, v in value.items()}, getattr(value, "origin", {}))
        copy.removed = getattr(value, "removed", copy.removed)
        return copy
    return [_copy(v) for v in value] if isinstance(value, list | tuple) else value


def mark(value: Any, by: str) -> Any:
    """The same with ``by`` added to where each value was said."""
    if not isinstance(value, Mapping):
        return value
    origins = {k: f"{where}, {by}" for k, where in getattr(value, "origin", {}).items()}
    copy = Located({k: mark(v, by) for k, v in value.items()}, origins)
    copy.removed = getattr(value, "removed", copy.removed)
    return copy


def origin_of(value: Any, path: list[str]) -> str | None:
    """Where the value at a path was said; None where nobody did."""
    origin = None
    for part in path:
        if not isinstance(value, Mapping) or part not in value:
            return origin if not isinstance(value, Mapping) else None
        origin = getattr(value, "origin", {}).get(part, origin)
        value = value[part]
    return origin


def plain(value: Any) -> Any:
    """Mappings, lists and scalars of JSON, copied; keys as text."""
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    return value if isinstance(value, str | int | float | bool | None) else str(value)


def inherit(
    experiments: Mapping[str, Located], broken: Iterable[str] = ()
) -> tuple[dict[str, Located], list[InputError]]:
    """Experiments with the keys of what they are based on.

    Arguments:
        experiments: by name, as files say them.
        broken: names of experiments that cannot be used; those that are based on them are left out.

    Returns:
        the experiments, and what is wrong with their ``based_on``.
    """
    errors: list[InputError] = []
    made: dict[str, Located | None] = dict.fromkeys(broken)
    for name in experiments:
        _inherit(name, experiments, made, errors)
    return {name: block for name, block in made.items() if block is not None}, errors


def _inherit(
    name: str, experiments: Mapping[str, Located], made: dict[str, Located | None], errors: list[InputError]
) -> None:
    """Put an experiment with the keys of the one that it is based on into ``made``; None where it cannot be made."""
    chain = [name]
    while chain[-1] not in made and "based_on" in experiments[chain[-1]]:
        here = chain[-1]
        where, base = f"experiments.{here}.based_on", experiments[here]["based_on"]
        error = None
        if base not in experiments and base not in made:
            error = InputError(where, f"found '{base}', which is no experiment", suggest(base, experiments))
        elif base in chain:
            remedy = "name an experiment that is not based on this one"
            error = InputError(where, f"'{base}' is based on '{here}' itself", remedy)
        elif len(chain) > CHAIN:
            error = InputError(where, f"more than {CHAIN} experiments, one based on the next", "merge some of them")
        if error is not None:
            errors.append(error)
            made.update(dict.fromkeys(chain))
            return
        chain.append(base)
    for here in reversed(chain):
        if here in made:
            continue
        own = _copy(experiments[here])
        base = own.pop("based_on", None)
        if base is None:
            made[here] = own
        else:
            below = made[base]
            made[here] = None if below is None else merge(mark(below, f"{here} is based on {base}"), own)


def under(preset: str, experiment: Located, where: str, errors: list[InputError]) -> Located:
    """An experiment with what it overrides under a preset, and without the studies, priors and sets that it takes away
    and what it inherits of data from another source; what takes nothing away is among the errors.

    The preset's ``choices`` are defaults: the experiment's own win over them.
    """
    experiment = _copy(experiment)
    over = mark((experiment.pop("presets", None) or {}).get(preset) or {}, f"under the preset {preset}")
    merged = merge(experiment, over)
    choices = merge(over.get("choices") or {}, experiment.get("choices") or {})
    if choices:
        merged["choices"] = choices
    data = merged.get("data")
    sets = None
    if isinstance(data, Located):
        others = [keys for source, keys in OF_SOURCE.items() if source != data.get("source")]
        for key in (key for keys in others for key in keys if data.get("source") in OF_SOURCE):
            data.pop(key, None)
        sets = data.get("sets")
    blocks = {"studies": merged.get("studies"), "augmentations": merged.get("augmentations"), "data.sets": sets}
    for key, block in blocks.items():
        if isinstance(block, Located):
            for name in [name for name, value in block.items() if value is None]:
                del block[name]
                if name not in block.removed:
                    remedy = f"{suggest(name, block)}; null takes away what is inherited"
                    problem = "null, where there is nothing of that name"
                    errors.append(InputError(f"{where}.{key}.{name}", problem, remedy))
    return merged

"""The study ``grid``: one training for every combination of some keys' values, all on the same data.

Each point of the grid becomes a method of its own, ``method@1``, ``method@2``, …, which the point's values override.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping

from expertaug.config.names import unknown_one
from expertaug.errors import InputError

OF_METHOD, OF_EXPERIMENT = ("model", "training"), ("system", "choices")


def points(config: Mapping, experiment: str) -> dict[str, dict[str, object]]:
    """Values by dotted key of each point of an experiment's grid, by the name of the point's method."""
    study = config["experiments"][experiment]["studies"].get("grid")
    if not study:
        return {}
    combinations = itertools.product(*study["keys"].values())
    return {f"{study['method']}@{k}": dict(zip(study["keys"], v, strict=True)) for k, v in enumerate(combinations, 1)}


def expand(config: dict, complete: Callable[[Mapping], Mapping]) -> dict:
    """The completed configuration with a method for each point of the grids of its run.

    Arguments:
        complete: checks and completes the user's configuration with a change.

    Raises:
        InputError: the method is none of the experiment, a key cannot be varied, or a value is wrong.
    """
    for experiment in config["run"]:
        one = config["experiments"][experiment]
        found = points(config, experiment)
        if found:
            _check(f"experiments.{experiment}.studies.grid", one, config["methods"])
        for name, values in found.items():
            method, _, number = name.partition("@")
            point = complete({"experiments": {experiment: _change(method, values)}})["experiments"][experiment]
            own = point["overrides"].get(method, {})
            one["overrides"][name] = {
                **{block: point[block] for block in OF_EXPERIMENT},
                **{block: content for block, content in own.items() if block in OF_METHOD},
            }
            build = config["methods"][method]
            config["methods"][name] = build | {"label": f"{build['label']} @{number}"}
    return config


def _check(where: str, experiment: Mapping, methods: Mapping) -> None:
    study = experiment["studies"]["grid"]
    for error in unknown_one(study["method"], experiment["methods"], f"{where}.method", "method of this experiment"):
        raise error
    if methods[study["method"]]["kind"] != "hybrid":
        raise InputError(f"{where}.method", f"'{study['method']}' is not trained", "name a hybrid method")
    blocks = (*OF_METHOD, *OF_EXPERIMENT)
    for key in study["keys"]:
        block, dot, _ = key.partition(".")
        if block not in blocks or not dot:
            remedy = f"a dotted path below {', '.join(blocks)}: the points share the experiment's data"
            raise InputError(f"{where}.keys.{key}", "cannot be varied", remedy)


def _change(method: str, values: Mapping[str, object]) -> dict:
    """What a point overrides of its experiment."""
    change: dict = {}
    for key, value in values.items():
        path = key.split(".")
        if path[0] in OF_METHOD:
            path = ["overrides", method, *path]
        inner = change
        for part in path[:-1]:
            inner = inner.setdefault(part, {})
        inner[path[-1]] = value
    return change

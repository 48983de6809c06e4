"""The study ``grid``: one training for every combination of some keys' values, all on the same data.

Each point of the grid becomes a method of its own, ``method@1``, ``method@2``, …, which the point's values override.
"""

from __future__ import annotations

from collections.abc import Callable

from expertaug.config.layers import Located
from expertaug.config.models import Configuration, Experiment, Grid, Method, PointOverride
from expertaug.errors import InputError
from expertaug.wording import unknown_one

OF_METHOD, OF_EXPERIMENT = ("model", "training"), ("system", "choices")


def expand(config: Configuration, complete: Callable[[Located], Configuration]) -> Configuration:
    """The completed configuration with a method for each point of the grids of its run.

    Arguments:
        complete: checks and completes the user's configuration with a change.

    Raises:
        InputError: the method is none of the experiment, a key cannot be varied, or a value is wrong.
    """
    methods, experiments = dict(config.methods), dict(config.experiments)
    for experiment in config.run:
        settings = config.experiments[experiment]
        if settings.studies.grid is None:
            continue
        _check(f"experiments.{experiment}.studies.grid", settings, settings.studies.grid, config.methods)
        overrides = dict(settings.overrides)
        for name, values in settings.studies.grid.points.items():
            method, _, number = name.partition("@")
            change = Located({"experiments": {experiment: _change(method, values)}})
            overrides[name] = _override(complete(change).experiments[experiment], method)
            label = f"{config.methods[method].label} @{number}"
            methods[name] = config.methods[method].model_copy(update={"label": label})
        experiments[experiment] = settings.model_copy(update={"overrides": overrides})
    return config.model_copy(update={"methods": methods, "experiments": experiments})


def _override(point: Experiment, method: str) -> PointOverride:
    """What the experiment of a point says of its method, where the points may differ."""
    over = point.overrides.get(method)
    own = {} if over is None else {block: v for block in OF_METHOD if (v := getattr(over, block)) is not None}
    return PointOverride(**{block: getattr(point, block) for block in OF_EXPERIMENT}, **own)


def _check(where: str, experiment: Experiment, study: Grid, methods: dict[str, Method]) -> None:
    for error in unknown_one(study.method, experiment.methods, f"{where}.method", "method of this experiment"):
        raise error
    if not methods[study.method].estimator.has_objective:
        raise InputError(f"{where}.method", f"'{study.method}' is not trained", "name a hybrid method")
    blocks = (*OF_METHOD, *OF_EXPERIMENT)
    for key in study.keys:
        block, dot, _ = key.partition(".")
        if block not in blocks or not dot:
            remedy = f"a dotted path below {', '.join(blocks)}: the points share the experiment's data"
            raise InputError(f"{where}.keys.{key}", "cannot be varied", remedy)


def _change(method: str, values: dict[str, object]) -> dict[str, object]:
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

"""What a method is made of in an experiment: its system, its classes and what the experiment overrides for it."""

from __future__ import annotations

from typing import Any

from expertaug.config.layers import overridden
from expertaug.config.models import Configuration, Experiment
from expertaug.learning.settings import Build, named_modules

FITTED = ("alternating", "least_squares")  # kinds of methods whose estimates are fits of each window


def experiment_of(config: Configuration, experiment: str, method: str | None) -> Experiment:
    """An experiment with what it overrides for a method."""
    one = config.experiments[experiment]
    over = one.overrides.get(method) if method is not None else None
    return one if over is None else overridden(one, over)


def build_of(config: Configuration, experiment: str, method: str) -> Build:
    """How a method is built, with what the experiment's system is otherwise for it."""
    over = config.experiments[experiment].overrides.get(method)
    build = config.methods[method].given(but=("label",))
    return Build.of(**build, **({} if over is None or over.system is None else {"system": over.system}))


def modules(config: Configuration, experiment: str, method: str | None = None) -> list[str]:
    """What an experiment's configuration names: the module of its system, classes as ``package.module:Class``."""
    one = experiment_of(config, experiment, method)
    system, parts = one.system["name"], one.model.given()
    build = build_of(config, experiment, method) if method else None
    if build is None or build.kind in ("mean", "least_squares"):
        return named_modules(system, {}, None)
    if build.kind == "alternating":
        return named_modules(system, {"interaction": parts["interaction"]}, None)
    if not build.has_interaction:
        del parts["interaction"]
    return named_modules(system, parts, build.objective_kind)


def foreign(config: Configuration, experiment: str, method: str) -> dict[str, Any]:
    """Classes from elsewhere that a method's model file may name; nothing where there is none."""
    found = [name for name in modules(config, experiment, method) if not name.startswith("expertaug.")]
    return {"classes": found} if found else {}

"""What a method is made of in an experiment: its system, its classes and what the experiment overrides for it."""

from __future__ import annotations

from typing import Any

from expertaug.config.layers import overridden
from expertaug.config.models import Configuration, Experiment
from expertaug.learning.settings import Build, named_modules

FITTED = ("alternating", "least_squares")  # kinds of methods whose estimates are fits of each window


def experiment_of(config: Configuration, experiment: str, method: str | None) -> Experiment:
    """An experiment with what it overrides for a method."""
    settings = config.experiments[experiment]
    over = settings.overrides.get(method) if method is not None else None
    return settings if over is None else overridden(settings, over)


def build_of(config: Configuration, experiment: str, method: str) -> Build:
    """How a method is built, with what the experiment's system is otherwise for it."""
    over = config.experiments[experiment].overrides.get(method)
    build = config.methods[method].dump(exclude=("label",))
    return Build.of(**build, **({} if over is None or over.system is None else {"system": over.system}))


def modules(config: Configuration, experiment: str, method: str | None = None) -> list[str]:
    """What an experiment's configuration names: the module of its system, classes as ``package.module:Class``."""
    settings = experiment_of(config, experiment, method)
    system, parts = settings.system["name"], settings.model.dump()
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
    classes = [name for name in modules(config, experiment, method) if not name.startswith("expertaug.")]
    return {"classes": classes} if classes else {}

"""What a method is made of in an experiment: its system, its classes and what the experiment overrides for it."""

from __future__ import annotations

from collections.abc import Mapping

from expertaug.config.layers import merge, plain
from expertaug.learning import kinds

FITTED = ("alternating", "least_squares")  # kinds of methods whose estimates are fits of each window


def experiment_of(config: Mapping, experiment: str, method: str | None) -> dict:
    """An experiment with what it overrides for a method."""
    one = config["experiments"][experiment]
    return plain(merge(one, one["overrides"].get(method, {})))


def build_of(config: Mapping, experiment: str, method: str) -> dict:
    """How a method is built, with what the experiment's system is otherwise for it."""
    over = config["experiments"][experiment]["overrides"].get(method, {})
    return config["methods"][method] | ({"system": over["system"]} if "system" in over else {})


def objective_of(build: Mapping) -> str:
    """Kind of a method's objective."""
    return build.get("objective", "aphynity")


def modules(config: Mapping, experiment: str, method: str | None = None) -> list[str]:
    """What an experiment's configuration names: the module of its system, classes as ``package.module:Class``."""
    one = experiment_of(config, experiment, method)
    build = build_of(config, experiment, method) if method else {"kind": "none"}
    system = build.get("system", {}).get("name", one["system"]["name"])
    if build["kind"] == "alternating":
        return kinds.modules(system, {"interaction": one["model"]["interaction"]}, None)
    if build["kind"] != "hybrid":
        return kinds.modules(system, {}, None)
    parts = {part: settings for part, settings in one["model"].items() if build.get(part, True)}
    return kinds.modules(system, parts, objective_of(build))


def foreign(config: Mapping, experiment: str, method: str) -> dict:
    """Classes from elsewhere that a method's model file may name; nothing where there is none."""
    found = [name for name in modules(config, experiment, method) if not name.startswith("expertaug.")]
    return {"classes": found} if found else {}

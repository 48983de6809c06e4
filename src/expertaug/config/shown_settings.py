"""What tables, figures and studies are told of the configuration: it changes no number.

Every function returns the ``settings`` of the stage of its name (``windows``: of alarm and distance).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from expertaug.config.grid import points
from expertaug.config.jobs import horizons, label, studied, variants
from expertaug.config.methods import experiment_of
from expertaug.versions import Version, base

TRACED = 6  # lines of one figure
OPPONENTS = ("least_squares", "alternating")  # kinds that are never augmented, shown beside those that are
# Keys of an evaluation that say how its numbers are read.
READING = ("convention", "set_titles", "title")


def study(config: Mapping, experiment: str, name: str) -> dict:
    """What a study's table and figure say: order and labels of the variants, sets, ranges."""
    one = config["experiments"][experiment]
    settings = {
        "study": name,
        "labels": _labels(config, studied(config, experiment, name)),
        "all_methods": all_methods(config),
        "sets": one["data"].get("sets", {}),
        "classical": _classical(config, experiment),
        **reading(config, experiment),
    }
    if name == "prior_width":
        further = {k: v["prior"] for k, v in one["augmentations"].items()}
        methods = dict.fromkeys(base(variant) for variant in studied(config, experiment, name))
        own = {m: experiment_of(config, experiment, m)["augmentation"]["prior"] for m in methods}
        return settings | {"priors": {m: {"": own[m]} | further for m in methods}}
    if name == "horizons":
        return settings | {"options": _horizons(config, experiment)}
    options = one["studies"][name]
    if name == "out_of_expertise":
        options = {"distances": options["distances"], "panels": [[k, v] for k, v in options["panels"].items()]}
    return settings | {"options": options}


def _horizons(config: Mapping, experiment: str) -> dict:
    """As of out_of_expertise: the ends of the sets' times, and by split the sets in that order."""
    data = config["experiments"][experiment]["data"]
    long = horizons(config, experiment).items()
    panels = [[name, [name, *(other for other, (of, _) in long if of == name)]] for name in ("validation", "test")]
    if data["source"] == "files":
        step_s, cut = data["files"]["step_s"], data["files"]
    else:
        step_s, cut = 1 / data["split"]["rate_hz"], data["split"]
    # The rows' own step is known to the stage that reads them alone.
    first = f"{cut['length']} points" if step_s is None else f"{(cut['length'] - 1) * step_s:g} s"
    return {"distances": [first, *(f"{end:g} s" for end in cut["horizons_s"])], "panels": panels}


def grid(config: Mapping, experiment: str) -> dict:
    """What a sweep's table and figure say: the method, the varied keys and their values at each point."""
    method = config["experiments"][experiment]["studies"]["grid"]["method"]
    found = points(config, experiment)
    return {
        "experiment": experiment,
        "label": label(config, method),
        "keys": list(next(iter(found.values()))),
        "points": [[name, list(values.values())] for name, values in found.items()],
    }


def compare(config: Mapping, experiments: list[str]) -> dict:
    """Which published numbers each experiment is compared with."""
    return {"published": [[name, config["experiments"][name]["evaluation"]["published"]] for name in experiments]}


def overview(config: Mapping, experiments: list[str]) -> dict:
    """What the figures over several experiments show of each."""
    all_of = [config["experiments"][name] for name in experiments]
    shifted = [one["studies"].get("out_of_expertise", {}).get("overview") for one in all_of]
    return {
        "experiments": [
            {
                "name": name,
                "shown": one["evaluation"]["overview"],
                "shifted": far,
                "opponents": [m for m in one["methods"] if config["methods"][m]["kind"] in OPPONENTS],
                **reading(config, name),
            }
            for name, one, far in zip(experiments, all_of, shifted, strict=True)
            if one["evaluation"]["overview"] or far
        ],
        "all_methods": all_methods(config),
    }


def tabulate(config: Mapping, experiment: str) -> dict:
    """The order of the methods, and how metrics and sets are to be read."""
    named = variants(config, experiment)
    floors = [v for v in named if config["methods"][base(v)].get("truth")]
    known = [v for v in named if _knows_the_form(config, v)]
    return {"labels": _labels(config, named), "floors": floors, "known_form": known, **reading(config, experiment)}


def _traced(config: Mapping, experiment: str) -> list[str]:
    """As many versions as can be told apart in a figure of lines: the classical estimator, the hybrids with and without
    augmentation, then refined ones, then what is left, as hybrids of another expert than the experiment's."""
    named, builds = variants(config, experiment), config["methods"]
    classical = _classical(config, experiment)
    system = config["experiments"][experiment]["system"]

    def rank(variant: str) -> int:
        method, found = base(variant), Version.parse(variant)
        build = builds[method]
        if variant == classical:
            return 0
        if build.get("known_form") or build["kind"] in ("mean", "least_squares") or found.prior:
            return 4
        if build.get("expert") is False or build.get("interaction") is False:
            return 3
        if Version.parse(variant).is_control or experiment_of(config, experiment, method)["system"] != system:
            return 3
        return 2 if found.estimators else 0 if method in _augmented(config, experiment) else 1

    return sorted(sorted(named, key=rank)[:TRACED], key=named.index)


def _classical(config: Mapping, experiment: str) -> str | None:
    """Least squares with the experiment's expert."""
    builds = [(m, config["methods"][m]) for m in config["experiments"][experiment]["methods"]]
    return next((m for m, build in builds if build["kind"] == "least_squares" and not build.get("truth")), None)


def _augmented(config: Mapping, experiment: str) -> list[str]:
    return config["experiments"][experiment]["augmented"]


def plot(config: Mapping, experiment: str) -> dict:
    """The order of the methods, and the ranges of the expert parameters in training and in each one's augmentation."""
    one = config["experiments"][experiment]
    priors = {
        v: experiment_of(config, experiment, base(v))["augmentation"]["prior"] or {}
        for v in variants(config, experiment)
    }
    return {
        "labels": _labels(config, variants(config, experiment)),
        "all_methods": all_methods(config),
        "traced": _traced(config, experiment),
        "floor": next((m for m in one["methods"] if config["methods"][m].get("truth")), None),
        "measured": one["data"]["source"] != "simulation",
        **reading(config, experiment),
        "training_range": one["data"]["sets"]["train"]["z_e"] if one["data"]["source"] == "simulation" else {},
        "priors": priors,
    }


def report(config: Mapping) -> dict:
    """What the report's tables say of each experiment of the run, and what it tells of the run itself."""
    experiments = []
    for name in config["run"]:
        fitted = [v for v in variants(config, name) if config["methods"][base(v)]["kind"] == "least_squares"]
        experiments.append({"name": name, **tabulate(config, name), "least_squares": fitted})
    return {"experiments": experiments} | {key: config[key] for key in ("preset", "seeds", "device")}


def windows(config: Mapping, experiment: str) -> dict:
    """What the studies of single windows say: alarm and distance."""
    one = config["experiments"][experiment]
    simulated = one["data"]["source"] == "simulation"
    shown = [v for v in variants(config, experiment) if config["methods"][base(v)]["kind"] != "mean"]
    return {
        "labels": _labels(config, shown),
        "all_methods": all_methods(config),
        "training_range": one["data"]["sets"]["train"]["z_e"] if simulated else {},
        "interaction_range": one["data"]["sets"]["train"]["z_a"] if simulated else {},
        "floor": next((m for m in one["methods"] if config["methods"][m].get("truth")), None),
        "mean": next((m for m in one["methods"] if config["methods"][m]["kind"] == "mean"), None),
        "classical": _classical(config, experiment),
        "traced": _traced(config, experiment),
        **reading(config, experiment),
    }


def reading(config: Mapping, experiment: str) -> dict:
    """What tables and figures say of an experiment's metrics; it changes none of them."""
    evaluation = config["experiments"][experiment]["evaluation"]
    return {key: evaluation[key] for key in ("from_s", *READING)}


def all_methods(config: Mapping) -> list[str]:
    """Every method of the configuration, points of grids aside."""
    return [name for name in config["methods"] if "@" not in name]


def _labels(config: Mapping, named: Iterable[str]) -> list[list[str]]:
    """Pairs of a version of a method and what is printed for it, in order, those whose F_a is of known form last."""
    return [[variant, label(config, variant)] for variant in sorted(named, key=lambda v: _knows_the_form(config, v))]


def _knows_the_form(config: Mapping, variant: str) -> bool:
    """Whether F_a of a method has the form of the hidden term."""
    return config["methods"][base(variant)].get("known_form", False)

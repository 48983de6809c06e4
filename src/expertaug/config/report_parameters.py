"""What tables, figures and studies are told of the configuration: it changes no number.

Every function returns the ``settings`` of the stage of its name (``windows``: of the studies of single windows).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from expertaug.config.jobs import (
    estimating,
    label,
    list_found_priors,
    list_studied,
    place_on,
    seed_groups,
    starts,
    variants,
)
from expertaug.config.models import Augmentation, Configuration, Experiment, OutOfExpertise
from expertaug.hues import FLOOR, OWN, assign_hues
from expertaug.systems.settings import SYSTEMS
from expertaug.versions import Version, base

TRACED = 6  # lines of one figure
# Keys of an evaluation that say how its numbers are read.
READING = ("convention", "set_titles", "title")


def study(config: Configuration, experiment: str, name: str) -> dict[str, Any]:
    """What a study's table and figure say: order and labels of the variants, sets, ranges."""
    settings = config.experiments[experiment]
    job = {
        "study": name,
        "labels": _labels(config, list_studied(config, experiment, name)),
        "hues": hues(config, list_studied(config, experiment, name)),
        "sets": {k: simulated.dump() for k, simulated in settings.data.simulated.items()},
        "classical": _classical(config, experiment),
        "units": SYSTEMS[system].UNITS if (system := settings.system["name"]) in SYSTEMS else {},
        **reading(config, experiment),
    }
    if name == "prior_width":
        further = {k: prior_of(v) for k, v in settings.further_priors.items()}
        methods = dict.fromkeys(base(variant) for variant in list_studied(config, experiment, name))
        own = {m: prior_of(config.experiment_of(experiment, m).augmentation) for m in methods}
        return job | {"priors": {m: {"": own[m]} | further for m in methods}}
    if name == "horizons":
        return job | {"options": _horizons(config, experiment)}
    options = getattr(settings.studies, name)
    if isinstance(options, OutOfExpertise):
        panels = [[title, sets] for title, sets in options.panels.items()]
        return job | {"options": {"distances": options.distances, "panels": panels}}
    return job | {"options": options.dump()}


def _horizons(config: Configuration, experiment: str) -> dict[str, Any]:
    """As of out_of_expertise: the ends of the sets' times, and by split the sets in that order."""
    data = config.experiments[experiment].data
    long = data.horizons.items()
    panels = [[name, [name, *(other for other, (of, _) in long if of == name)]] for name in ("validation", "test")]
    if data.source == "files":
        step_s, cut = data.files.step_s, data.files
    else:
        assert data.split.rate_hz is not None  # completed
        step_s, cut = 1 / data.split.rate_hz, data.split
    # The rows' own step is known to the stage that reads them alone.
    first = f"{cut.length} points" if step_s is None else f"{(cut.length - 1) * step_s:g} s"
    return {"distances": [first, *(f"{end:g} s" for end in cut.horizons_s)], "panels": panels}


def grid(config: Configuration, experiment: str) -> dict[str, Any]:
    """What a sweep's table and figure say: the method, the varied keys and their values at each point."""
    study = config.experiments[experiment].studies.grid
    assert study is not None
    return {
        "experiment": experiment,
        "label": label(config, study.method),
        "keys": list(study.keys),
        "points": [[name, list(of_point.values())] for name, of_point in study.points.items()],
    }


def data_curves(config: Configuration, experiment: str) -> dict[str, Any]:
    """The experiments that are points of curves, and the value of each."""
    asked = config.experiments[experiment].studies.data_curves
    assert asked is not None
    axes = [
        (along, sorted((place_on(along, config.experiments[name]), name) for name in names))
        for along, names in asked.axes.items()
    ]
    named = variants(config, experiment)
    return {
        "experiment": experiment,
        "axes": axes,
        "labels": _labels(config, named),
        "hues": hues(config, named),
        "floor": _floor(config, experiment),
        **reading(config, experiment),
    }


def own_priors(config: Configuration, experiment: str) -> dict[str, Any]:
    """What the table of found ranges says: of which version and group of seeds each is."""
    versions = list_found_priors(config, experiment)
    priors = [["before training", "all"]] if "" in versions else []
    groups = [group.removeprefix("seeds_").replace("_", ", ") for group in seed_groups(config, experiment)]
    priors += [[label(config, variant), group] for variant in versions if variant for group in groups]
    return {"experiment": experiment, "priors": priors, **reading(config, experiment)}


def compare(config: Configuration, experiments: list[str]) -> dict[str, Any]:
    """Which published numbers each experiment is compared with."""
    return {"published": [[name, config.experiments[name].evaluation.published] for name in experiments]}


def overview(config: Configuration, experiments: list[str]) -> dict[str, Any]:
    """What the figures over several experiments show of each."""
    shown = []
    for name in experiments:
        settings = config.experiments[name]
        shifted = settings.studies.out_of_expertise.overview if settings.studies.out_of_expertise is not None else None
        if settings.evaluation.overview or shifted:
            opponents = [m for m in settings.methods if config.methods[m].estimator.fits_windows]
            shown.append(
                {
                    "name": name,
                    "shown": settings.evaluation.overview,
                    "shifted": shifted,
                    "opponents": opponents,
                    **reading(config, name),
                }
            )
    return {"experiments": shown, "hues": hues(config)}


def tabulate(config: Configuration, experiment: str) -> dict[str, Any]:
    """The order of the methods, and how metrics and sets are to be read."""
    named = variants(config, experiment)
    floors = [v for v in named if config.methods[base(v)].truth]
    of_known_form = [v for v in named if _knows_the_form(config, v)]
    return {
        "labels": _labels(config, named),
        "floors": floors,
        "known_form": of_known_form,
        "candidates": _candidates(config, [v for v in named if v not in (*floors, *of_known_form)]),
        **reading(config, experiment),
    }


def _candidates(config: Configuration, named: Sequence[str]) -> list[str]:
    """Versions of which validation chooses one, from the simplest on; controls are none, they are there to compare."""

    def complexity(variant: str) -> tuple[int, ...]:
        build, version = config.methods[base(variant)], Version.parse(variant)
        kind, parts = build.estimator, build.parts
        own = kind.has_expert, not kind.shares
        return bool(parts), *own, "encoder" in parts, len(parts), len(version.estimators), version.is_augmented

    return sorted((v for v in named if not Version.parse(v).is_control), key=complexity)


def _choose_traced(config: Configuration, experiment: str) -> list[str]:
    """As many versions as can be told apart in a figure of lines: the classical estimator, the hybrids with and without
    augmentation, then refined ones, then what is left, as hybrids of another expert than the experiment's."""
    named, builds = variants(config, experiment), config.methods
    classical = _classical(config, experiment)
    settings = config.experiments[experiment]

    def rank(variant: str) -> int:
        method, version = base(variant), Version.parse(variant)
        build = builds[method]
        if variant == classical or build.estimator.shares:
            return 0
        if build.known_form or not build.estimator.trains() or version.prior:
            return 4
        if build.expert is False or build.interaction is False:
            return 3
        if version.is_control or config.experiment_of(experiment, method).system != settings.system:
            return 3
        return 2 if version.estimators else 0 if method in settings.augmented else 1

    return sorted(sorted(named, key=rank)[:TRACED], key=named.index)


def _classical(config: Configuration, experiment: str) -> str | None:
    """Least squares with the experiment's expert."""
    builds = [(m, config.methods[m]) for m in config.experiments[experiment].methods]
    return next((m for m, build in builds if build.estimator.is_classical() and not build.truth), None)


def _floor(config: Configuration, experiment: str) -> str | None:
    """The method that has the equation which made the data."""
    return next((m for m in config.experiments[experiment].methods if config.methods[m].truth), None)


def plot(config: Configuration, experiment: str) -> dict[str, Any]:
    """The order of the methods, and the ranges of the expert parameters in training and in each one's augmentation."""
    settings = config.experiments[experiment]
    priors = {
        v: prior_of(config.experiment_of(experiment, base(v)).augmentation) or {} for v in variants(config, experiment)
    }
    return {
        "labels": _labels(config, variants(config, experiment)),
        "hues": hues(config, variants(config, experiment)),
        "traced": _choose_traced(config, experiment),
        "floor": _floor(config, experiment),
        "measured": settings.data.source != "simulation",
        **reading(config, experiment),
        "training_range": _training_ranges(settings)["z_e"],
        "priors": priors,
    }


def report(config: Configuration) -> dict[str, Any]:
    """What the report's tables say of each experiment of the run, and what it tells of the run itself."""
    experiments = []
    for name in config.run:
        fitted = [v for v in variants(config, name) if config.methods[base(v)].estimator.is_classical()]
        experiments.append({"name": name, **tabulate(config, name), "least_squares": fitted})
    return {"experiments": experiments, "preset": config.preset, "seeds": config.seeds, "device": config.device}


def windows(config: Configuration, experiment: str) -> dict[str, Any]:
    """What the studies of single windows say: alarm, coverage, seeds and distance."""
    settings = config.experiments[experiment]
    ranges = _training_ranges(settings)
    shown = [v for v in variants(config, experiment) if config.methods[base(v)].estimator.has_expert]
    return {
        "labels": _labels(config, shown),
        "hues": hues(config, shown),
        "training_range": ranges["z_e"],
        "interaction_range": ranges["z_a"],
        "floor": _floor(config, experiment),
        "mean": next((m for m in settings.methods if not config.methods[m].estimator.has_expert), None),
        "classical": _classical(config, experiment),
        "traced": _choose_traced(config, experiment),
        **reading(config, experiment),
    }


def estimates(config: Configuration, experiment: str) -> dict[str, Any]:
    """What estimates are shown: versions, the ranges in which their fits start, and what is no constant."""
    shown = estimating(config, experiment)
    priors = {v: prior_of(config.experiment_of(experiment, base(v)).augmentation) for v in shown}
    return {
        "labels": _labels(config, shown),
        "priors": {v: ranges for v, ranges in priors.items() if ranges is not None},
        "starts": starts(config.experiments[experiment]),
        "hues": hues(config, shown),
        **reading(config, experiment),
    }


def reading(config: Configuration, experiment: str) -> dict[str, Any]:
    """What tables and figures say of an experiment's metrics; it changes none of them."""
    return config.experiments[experiment].evaluation.dump(include=("from_s", *READING))


def hues(config: Configuration, versions: Iterable[str] | None = None) -> list[tuple[str, int]]:
    """The hue of each method, or of those of some versions, in the configuration's order, points of grids aside: of the
    default configuration's methods their own, of others one that is free in their experiments."""
    names = [name for name in config.methods if "@" not in name]
    by_experiment = [[base(name) for name in config.experiments[experiment].methods] for experiment in config.run]
    floors = {name: FLOOR for name in names if config.methods[name].truth}
    own = {name: hue for name, hue in OWN.items() if name in names and (hue != FLOOR or name in floors)}
    hue_of = assign_hues([*by_experiment, *([name] for name in names)], own | floors)
    shown = names if versions is None else set(map(base, versions))
    return [(name, hue_of[name]) for name in names if name in shown]


def prior_of(augmentation: Augmentation) -> dict[str, list[float]] | None:
    """Ranges of p⁺; None where they are to be found."""
    return augmentation.dump(include=("prior",)).get("prior")


def _training_ranges(experiment: Experiment) -> dict[str, dict[str, list[float]]]:
    """Ranges of the parameters in the training set by z_e and z_a, where it is simulated."""
    train = experiment.data.simulated.get("train")
    return {"z_e": {}, "z_a": {}} if train is None else train.dump(include=("z_e", "z_a"))


def _labels(config: Configuration, named: Iterable[str]) -> list[list[str]]:
    """Pairs of a version of a method and what is printed for it, in order, those whose F_a is of known form last."""
    return [[variant, label(config, variant)] for variant in sorted(named, key=lambda v: _knows_the_form(config, v))]


def _knows_the_form(config: Configuration, variant: str) -> bool:
    """Whether F_a of a method has the form of the hidden term."""
    return bool(config.methods[base(variant)].known_form)

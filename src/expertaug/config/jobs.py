"""Which jobs a configuration means: groups of seeds, versions of methods, studies, classes; only names."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from expertaug.config import options
from expertaug.config.models import Configuration, Experiment
from expertaug.learning.settings import named_modules
from expertaug.measurements.settings import label_of
from expertaug.systems.settings import CONSERVING, SYSTEMS
from expertaug.versions import AUGMENTED, CONTROL, FLOW, REFINED, Version

# What the drivers of cards put there: NVIDIA's, AMD's, and that of Linux within Windows.
DRIVERS = (Path("/proc/driver/nvidia"), Path("/dev/kfd"), Path("/dev/dxg"))


def cards(config: Configuration) -> int:
    """Cards that a job which learns or evaluates takes where the run is started: one, or none on the CPU.

    torch is asked, which takes seconds, only where ``device`` is auto and the machine has the driver of one.
    """
    if config.device != "auto" or not any(path.exists() for path in DRIVERS):
        return int(config.device == "cuda")
    from expertaug.models.store import device_of

    return int(device_of("auto").type == "cuda")


def seed_groups(config: Configuration, experiment: str | None = None) -> dict[str, list[int]]:
    """Seeds that one job of an experiment trains together, by the group's name; without one those of the top level."""
    own = config.experiments[experiment].seeds if experiment is not None else None
    seeds, size = own or config.seeds, config.seeds_per_job
    parts = [seeds[k : k + size] for k in range(0, len(seeds), size)]
    return {f"seeds_{'_'.join(map(str, part))}": part for part in parts}


def variants(config: Configuration, experiment: str) -> list[str]:
    """An experiment's methods, each followed by its control, its augmented version, its flow and their refined ones."""
    settings = config.experiments[experiment]
    each = []
    for name in list_trained_variants(settings):
        each += [name, f"{name}~{REFINED}"] if name in settings.refined else [name]
    return each


def list_trained_variants(experiment: Experiment) -> list[str]:
    """Versions of an experiment's methods that have a model file of their own."""
    each = []
    for method in experiment.methods:
        each.append(method)
        each += [f"{method}{CONTROL}"] if method in experiment.controls else []
        each += [f"{method}{AUGMENTED}"] if method in experiment.augmented else []
        each += [f"{method}{AUGMENTED}~{FLOW}"] if method in experiment.flows else []
    return each


def further_variants(config: Configuration, experiment: str) -> list[str]:
    """``method+name`` of every further prior: they are in the study of the prior's width alone."""
    settings = config.experiments[experiment]
    return [
        f"{m}+{name}" for name, prior in settings.further_priors.items() for m in prior.methods or settings.augmented
    ]


def finds_prior(config: Configuration, experiment: str, variant: str) -> str | None:
    """The augmented version (METHOD+, METHOD+NAME) whose p⁺ a version uses, where that is to find its own ranges from
    the trained METHOD; empty where they are found before anything is trained; None where ranges are given."""
    version = Version.parse(variant)
    settings = config.experiment_of(experiment, version.method)
    if settings.augmentation_of(version.prior).prior is not None:
        return None
    untrained = config.methods[version.method].estimator.fits_windows
    return "" if untrained and FLOW not in version.estimators else f"{version.method}+{version.prior or ''}"


def finds_prior_to_train(config: Configuration, experiment: str, method: str) -> bool:
    """Whether the training of a method needs ranges of p⁺, and they are to be found."""
    build = config.build_of(experiment, method)
    kind = build.estimator
    needed = kind.fits_windows or (kind.has_objective and options.needs_prior(build.objective_kind, "objective"))
    return needed and config.experiment_of(experiment, method).augmentation.prior is None


def list_found_priors(config: Configuration, experiment: str) -> list[str]:
    """Augmented versions whose p⁺ is found from a trained model; an empty one stands for that of the experiment."""
    versions = [*variants(config, experiment), *further_variants(config, experiment)]
    kinds = {v: config.methods[Version.parse(v).method].estimator for v in versions}
    priors = [finds_prior(config, experiment, v) for v in versions if kinds[v].has_expert]
    if any(finds_prior_to_train(config, experiment, m) for m in config.experiments[experiment].methods):
        priors.append("")
    return [v for v in dict.fromkeys(priors) if v is not None]


def starts(experiment: Experiment) -> list[str]:
    """Names of the expert parameters that say how a window begins, and are no constants of an apparatus."""
    system, data = SYSTEMS.get(experiment.system["name"]), experiment.data
    named = data.files.z_e if data.source == "files" else {}
    return [*(() if system is None else system.STARTS), *(n for n, label in named.items() if label_of(label).start)]


def estimating(config: Configuration, experiment: str) -> list[str]:
    """Versions that estimate constants of an apparatus."""
    settings = config.experiments[experiment]
    system, started = SYSTEMS.get(settings.system["name"]), starts(settings)
    if system is not None and set(system.EXPERT) <= set(started):
        return []
    builds = {m: config.build_of(experiment, m) for m in settings.methods}
    named = [(v, builds[Version.parse(v).method]) for v in variants(config, experiment)]
    return [v for v, build in named if build.estimator.has_expert and build.has_expert]


def with_interaction(config: Configuration, experiment: str) -> list[str]:
    """Methods of an experiment that learn an interaction model beside an expert; points of grids aside."""
    methods = []
    for method in config.experiments[experiment].methods:
        build = config.build_of(experiment, method)
        methods += [method] if "interaction" in build.parts and build.has_expert and "@" not in method else []
    return methods


def list_checked(config: Configuration, experiment: str) -> list[str]:
    """Methods of which an experiment checks whether F_a holds where z_e has moved."""
    if config.experiments[experiment].validity is None:
        return []
    # What windows share does not move.
    return [m for m in with_interaction(config, experiment) if not config.methods[m].estimator.shares]


def list_explained(config: Configuration, experiment: str) -> list[str]:
    """Methods of an experiment of which it asks what their expert lacks: a fit of the expert alone, by which windows
    themselves say it, and those that learn an interaction model."""
    settings = config.experiments[experiment]
    if settings.equation is None:
        return []
    builds = {method: config.build_of(experiment, method) for method in settings.methods}

    def plain(method: str) -> bool:  # terms and sensors are not sought together
        sensed = config.experiment_of(experiment, method).refinement.of_sensors
        return not (builds[method].estimator.shares and sensed)

    fitted = [m for m, build in builds.items() if build.estimator.is_classical() and not build.truth and plain(m)]
    shared = [m for m in fitted if builds[m].estimator.shares] or fitted  # of one apparatus, where that is known
    return [*shared[:1], *filter(plain, with_interaction(config, experiment))]


def studies(config: Configuration, experiment: str) -> list[str]:
    """Names of an experiment's studies."""
    named = config.experiments[experiment].studies.names
    named += ["prior_width"] if further_variants(config, experiment) else []
    return named + (["horizons"] if config.experiments[experiment].data.horizons else [])


def list_studied(config: Configuration, experiment: str, name: str) -> list[str]:
    """The variants that a study compares."""
    settings = config.experiments[experiment]
    if name == "prior_width":
        further = further_variants(config, experiment)
        methods = [m for m in settings.methods if any(Version.parse(v).method == m for v in further)]
        return [*methods, *(f"{m}+" for m in methods), *further]
    return variants(config, experiment)


def place_on(axis: str, experiment: Experiment) -> float:
    """Where a simulated experiment lies on an axis of the study data_curves."""
    value = experiment.data.simulated["train"].size if axis == "samples" else experiment.data.noise
    assert isinstance(value, int | float)  # as of simulated sets
    return float(value)


def dissipating(config: Configuration, experiment: str) -> list[str]:
    """Methods of an experiment on measured pendulums that have an expert and what makes it lose energy: F_a, or a
    friction that it knows; with their refined versions.  All other versions have their method's F_a."""
    settings = config.experiments[experiment]
    name, data = settings.system["name"], settings.data
    if name not in CONSERVING or data.source == "simulation":
        return []
    if data.source == "files" and len(data.files.columns) < CONSERVING[name]:
        return []
    own = [v for v in variants(config, experiment) if not Version.parse(v).step and not Version.parse(v).is_flow]
    return [v for v in own if _dissipates(config, experiment, Version.parse(v).method)]


def _dissipates(config: Configuration, experiment: str, method: str) -> bool:
    build = config.build_of(experiment, method)
    if not build.estimator.has_expert or not build.has_expert:
        return False
    rubs = (config.experiments[experiment].system | (build.system or {})).get("friction") is not None
    return rubs or "interaction" in build.parts


def label(config: Configuration, variant: str) -> str:
    """What tables and figures print for a version of a method."""
    return Version.parse(variant).label(config.methods[Version.parse(variant).method].label)


def snapshots(config: Configuration, experiment: str, method: str) -> list[int]:
    """Passes after which the training of a method keeps its state for the study along training."""
    study = config.experiments[experiment].studies.during_training
    return sorted(study.epochs) if study is not None and study.method == method else []


def modules(config: Configuration, experiment: str, method: str | None = None) -> list[str]:
    """What an experiment's configuration names: the module of its system, classes as ``package.module:Class``."""
    settings = config.experiment_of(experiment, method)
    system = settings.system["name"]
    if not method:
        return named_modules(system, {}, None)
    build = config.build_of(experiment, method)
    parts = settings.model.dump(include=build.parts)
    names = named_modules(system, parts, build.objective_kind if build.estimator.has_objective else None)
    return [*names, build.kind] if ":" in build.kind else names


def foreign(config: Configuration, experiment: str, method: str) -> dict[str, Any]:
    """Classes from elsewhere that a method's model file may name; nothing where there is none."""
    classes = [name for name in modules(config, experiment, method) if not name.startswith("expertaug.")]
    return {"classes": classes} if classes else {}

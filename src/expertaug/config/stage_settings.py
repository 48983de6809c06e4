"""What each job takes of the configuration, and nothing more: a changed key redoes only the jobs whose slice has it.

Every function takes the completed configuration (:func:`expertaug.config.load.validate`) and returns the ``settings``
of the stage of its name.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from expertaug.config import options
from expertaug.config.jobs import dissipating, foreign, label, list_checked, list_explained, seed_groups, snapshots
from expertaug.config.models import Augmentation, Configuration, Experiment
from expertaug.config.report_parameters import READING, hues, prior_of, reading
from expertaug.inference.settings import FlowJob
from expertaug.learning.settings import AugmentJob, Build, FinetuneJob, TrainJob, TrainSettings
from expertaug.models.estimators import Alternating
from expertaug.settings import OWN
from expertaug.versions import FLOW, Version

OF_EVALUATION = ("forecast_start",)  # row of the preset's table that an evaluation obeys
# Keys of an evaluation that change none of its numbers.
SHOWING = (*READING, "published", "overview")


def init_tracking(config: Configuration) -> dict[str, Any]:
    return config.tracking.dump() | {"experiments": list(config.run)}


def simulate(config: Configuration, experiment: str, name: str) -> dict[str, Any]:
    settings = config.experiments[experiment]
    data = settings.data.dump(include=("seed", "step_s", "t2_s"))
    data |= {"noise": _noise(settings), "sets": {name: settings.data.simulated[name].dump()}}
    return {"system": settings.system, "data": data}


def train(config: Configuration, experiment: str, method: str, group: str) -> dict[str, Any]:
    settings, build = config.experiment_of(experiment, method), config.build_of(experiment, method)
    model, training, prior, shared = {}, _solver(settings.training), {}, {}
    if build.parts:
        model = settings.model.dump(include=build.parts)
    if build.estimator.stage == Alternating.stage:
        training = settings.alternation.dump()
    elif build.estimator.has_objective:
        training = _with_own_options(settings.training, build)
        shared = {"shared": settings.refinement.shared} if build.estimator.shares else {}
        if options.needs_prior(build.objective_kind, "objective"):
            prior = {"prior": _prior(settings.augmentation)}
    return {
        **_identity(config, experiment, method),
        "system": config.experiments[experiment].system,
        "build": build.dump(),
        "model": model,
        "training": training,
        **shared,
        **prior,
        **_estimator(config, experiment, method),
        **({"snapshots": kept} if (kept := snapshots(config, experiment, method)) else {}),
        **_window(settings),
        "choices": _choices(settings, TrainJob.OBEYS),
        "seeds": seed_groups(config, experiment)[group],
        "device": config.device,
    }


def augment(config: Configuration, experiment: str, variant: str, group: str) -> dict[str, Any]:
    version = Version.parse(variant)
    settings = config.experiment_of(experiment, version.method)
    augmentation = settings.augmentation_of(version.prior)
    return {
        "experiment": experiment,
        "method": variant,
        "prior": _prior(augmentation),
        **({"worst": augmentation.worst} if augmentation.worst else {}),
        "noise": _noise(settings),
        "choices": _choices(settings, AugmentJob.OBEYS),
        "seeds": seed_groups(config, experiment)[group],
        "device": config.device,
        **foreign(config, experiment, version.method),
    }


def finetune(config: Configuration, experiment: str, variant: str, group: str) -> dict[str, Any]:
    version = Version.parse(variant)
    settings, build = config.experiment_of(experiment, version.method), config.build_of(experiment, version.method)
    return {
        **_identity(config, experiment, variant),
        "training": _with_own_options(settings.finetuning, build),
        **({"prior": _prior(settings.augmentation)} if version.is_control else {}),
        "choices": _choices(config.experiments[experiment], FinetuneJob.OBEYS),
        "seeds": seed_groups(config, experiment)[group],
        "device": config.device,
        **foreign(config, experiment, version.method),
    }


def flow(config: Configuration, experiment: str, variant: str, group: str) -> dict[str, Any]:
    settings = config.experiment_of(experiment, Version.parse(variant).method)
    augmented = augment(config, experiment, variant, group) | _identity(config, experiment, variant)
    return augmented | {"flow": settings.flow.dump(), "choices": _choices(settings, FlowJob.OBEYS), "worst": 0.0}


def own_prior(config: Configuration, experiment: str, variant: str, group: str | None) -> dict[str, Any]:
    """Of an augmented version whose p⁺ finds its own ranges; of none ("") before anything is trained."""
    version = Version.parse(variant)
    settings = config.experiment_of(experiment, version.method or None)
    search = settings.augmentation_of(version.prior).dump(include=("windows", "budget"))
    search |= {"noise": _noise(settings), "refinement": _fit(settings)}
    if version.method:
        return search | {"device": config.device, **foreign(config, experiment, version.method)}
    return search | {
        "experiment": experiment,
        "method": "least_squares",
        "label": "",
        "preset": config.preset,
        "system": settings.system,
        "build": {"kind": "least_squares", "interaction": False},
        "model": {},
        "training": _solver(settings.training),
        **_window(settings),
        "choices": _choices(settings, TrainJob.OBEYS),
        "seeds": [0],
    }


def evaluate(config: Configuration, experiment: str, variant: str, group: str) -> dict[str, Any]:
    return {
        **_identity(config, experiment, variant),
        "evaluation": config.experiments[experiment].evaluation.dump(exclude=SHOWING),
        **(_estimator(config, experiment, variant) if Version.parse(variant).is_refined else {}),
        **_describe_draws(config, experiment, variant),
        **_name_known(config, experiment, variant),
        "sets": config.experiments[experiment].data.set_names,
        "choices": _choices(config.experiments[experiment], OF_EVALUATION),
        "seeds": seed_groups(config, experiment)[group],
        "device": config.device,
        **foreign(config, experiment, Version.parse(variant).method),
    }


def during_training(config: Configuration, experiment: str, method: str, group: str) -> dict[str, Any]:
    """The settings of augmentation, of the fine-tunings and of their evaluation."""
    settings = config.experiments[experiment]
    study = settings.studies.during_training
    assert study is not None
    return {
        **_identity(config, experiment, method),
        "augment": augment(config, experiment, f"{method}+", group),
        "finetune": finetune(config, experiment, f"{method}+", group),
        "finetune_epochs": study.finetune_epochs,
        "evaluation": settings.evaluation.dump(include=("from_s", "solver")) | {"max_samples": study.max_samples},
        "choices": _choices(settings, OF_EVALUATION),
        "seeds": seed_groups(config, experiment)[group],
        "device": config.device,
    }


def dissipation(config: Configuration, experiment: str) -> dict[str, Any]:
    """Which versions are compared, and how the estimates of each are found."""
    versions = []
    for variant in dissipating(config, experiment):
        fit = _estimator(config, experiment, variant).get("refinement")
        kind = config.methods[Version.parse(variant).method].estimator
        if kind.shares and kind.fits_windows:
            fit = None  # its file has the constants
        elif fit is not None and fit["prior"] == OWN:
            # What a fitted method starts within its file says; refined versions start at their own estimates then.
            fit = {**fit, "prior": None} if Version.parse(variant).is_refined else None
        versions.append([variant, label(config, variant), fit])
    return {
        "experiment": experiment,
        "versions": versions,
        "hues": hues(config, [variant for variant, *_ in versions]),
        **reading(config, experiment),
        "device": config.device,
        **_classes(config, experiment, (Version.parse(variant).method for variant, _, _ in versions)),
    }


def validity(config: Configuration, experiment: str) -> dict[str, Any]:
    """Which trained methods are checked, and how the windows of each are fitted."""
    settings, methods = config.experiments[experiment], list_checked(config, experiment)
    assert settings.validity is not None
    versions = []
    for method in methods:
        own = config.experiment_of(experiment, method)
        fit = {"settings": _fit(own), "noise": _noise(own), "prior": prior_of(own.augmentation)}
        versions.append([method, label(config, method), fit])
    return {
        "experiment": experiment,
        "versions": versions,
        "validity": settings.validity.dump(),
        "device": config.device,
        "hues": hues(config, methods),
        **reading(config, experiment),
        **_classes(config, experiment, methods),
    }


def equation(config: Configuration, experiment: str) -> dict[str, Any]:
    """Of which methods it is asked what their expert lacks, and how the windows of each are fitted."""
    settings, methods = config.experiments[experiment], list_explained(config, experiment)
    assert settings.equation is not None
    versions = []
    for method in methods:
        own = config.experiment_of(experiment, method)
        fit = {"settings": own.refinement.dump(), "noise": _noise(own), "prior": prior_of(own.augmentation)}
        versions.append([method, label(config, method), fit])
    return {
        "experiment": experiment,
        "versions": versions,
        "equation": settings.equation.dump(),
        "device": config.device,
        "hues": hues(config, methods),
        **reading(config, experiment),
        **_classes(config, experiment, methods),
    }


def _identity(config: Configuration, experiment: str, variant: str) -> dict[str, Any]:
    return {"experiment": experiment, "method": variant, "label": label(config, variant), "preset": config.preset}


def _estimator(config: Configuration, experiment: str, variant: str) -> dict[str, Any]:
    """What least squares on each window needs, where a version's estimates come from it."""
    version = Version.parse(variant)
    kind = config.methods[version.method].estimator
    if not version.is_refined and not kind.fits_windows:
        return {}
    settings = config.experiment_of(experiment, version.method)
    return {
        "refinement": {
            "settings": _fit(settings, kind.shares and kind.fits_windows, version.is_refined),
            "noise": _noise(settings),
            "prior": _prior(settings.augmentation),
        }
    }


def _fit(experiment: Experiment, shares: bool = False, refined: bool = False) -> dict[str, Any]:
    """How windows are fitted; what they share is told only to what shares it."""
    of_windows = ("sensors",) if refined else ("units", "sensors", "population")
    return experiment.refinement.dump(exclude=() if shares else of_windows)


def _name_known(config: Configuration, experiment: str, variant: str) -> dict[str, Any]:
    """Names of the parameters that an experiment's sets have, of a version whose expert has others."""
    settings, own = config.experiments[experiment], config.experiment_of(experiment, Version.parse(variant).method)
    if own.system == settings.system:
        return {}
    theirs, ours = (options.describe_system(setup.system, "system")[0] for setup in (settings, own))
    if theirs is None or ours is None or theirs.expert is None or theirs.expert == ours.expert:
        return {}
    return {"known": {"z_e": list(theirs.expert), "z_a": list(theirs.interaction or ())}}


def _describe_draws(config: Configuration, experiment: str, variant: str) -> dict[str, Any]:
    """The data's noise, and what a version's own windows are made with, where the experiment has p⁺ and windows do not
    share what it would draw."""
    version = Version.parse(variant)
    settings = config.experiment_of(experiment, version.method)
    kind = config.methods[version.method].estimator
    if not kind.has_expert or kind.shares:
        return {"noise": _noise(settings)}
    anew = settings.choices.augmented_x == "resampled"
    if FLOW in version.estimators and settings.flow.resample_x is not None:
        anew = settings.flow.resample_x
    prior = _prior(settings.augmentation_of(version.prior))
    return {
        "noise": _noise(settings),
        "own": {"resample_x": anew, "z_a_from": settings.choices.augmented_z_a, "prior": prior},
    }


def _classes(config: Configuration, experiment: str, methods: Iterable[str]) -> dict[str, Any]:
    """Classes from elsewhere that the model files of some methods may name; nothing where there is none."""
    named = [name for method in methods for name in foreign(config, experiment, method).get("classes", [])]
    return {"classes": list(dict.fromkeys(named))} if named else {}


def _prior(augmentation: Augmentation) -> dict[str, list[float]] | str:
    """Ranges of p⁺, or that they are to be found (:mod:`expertaug.inference.adaptive_prior`)."""
    return prior_of(augmentation) or OWN


def _choices(experiment: Experiment, obeyed: Iterable[str]) -> dict[str, str]:
    return experiment.choices.dump(include=tuple(obeyed))


def _noise(experiment: Experiment) -> float | dict[str, float] | str:
    """Standard deviation of the noise of an experiment's data: one, one for each component, or that it is estimated."""
    return experiment.data.noise if experiment.choices.noise == "config" else 0.0


def _window(experiment: Experiment) -> dict[str, Any]:
    """What of a trajectory is observed."""
    return experiment.data.dump(include=("t1_s", "start") if experiment.data.start else ("t1_s",))


def _solver(training: TrainSettings) -> dict[str, Any]:
    """What is left of a training for what is fitted without one: its solver, where it names one."""
    return training.dump(include=("solver",))


def _with_own_options(training: TrainSettings, build: Build) -> dict[str, Any]:
    """A training with those of the objective's options that are the method's own objective's."""
    own = {k: v for k, v in (training.objective or {}).items() if options.takes_option(build.objective_kind, k)}
    return {**training.dump(), "objective": own}

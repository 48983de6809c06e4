"""What each job takes of the configuration, and nothing more: a changed key redoes only the jobs whose slice has it.

Every function takes the completed configuration (:func:`expertaug.config.load.validate`) and returns the ``settings``
of the stage of its name.
"""

from __future__ import annotations

from collections.abc import Mapping

from expertaug.config import options
from expertaug.config.jobs import checked, dissipating, label, seed_groups, sets, snapshots
from expertaug.config.methods import FITTED, build_of, experiment_of, foreign, objective_of
from expertaug.config.shown_settings import (
    READING,
    all_methods,
    reading,
)
from expertaug.config.training_blocks import solver_of, with_own_options
from expertaug.versions import FLOW, Version

# Rows of the preset's table (expertaug.presets) that each stage of learning obeys.
_TRAINING = ("loss_window", "multiplier", "penalty", "loss_normalisation", "supervision", "selection", "hvae_z_e")
CHOICES = {
    "train": (*_TRAINING, "observed_points"),
    "augment": ("loss_window", "augmentation_noise", "augmented_x", "augmented_z_a"),
    "finetune": (*_TRAINING, "frozen", "resample"),
    "flow": ("augmentation_noise", "augmented_x", "augmented_z_a"),
    "evaluate": ("forecast_start",),
}
# Keys of an evaluation that change none of its numbers.
SHOWING = (*READING, "published", "overview")


def init_tracking(config: Mapping) -> dict:
    return dict(config["tracking"])


def simulate(config: Mapping, experiment: str, name: str) -> dict:
    one = config["experiments"][experiment]
    data = {k: one["data"][k] for k in ("seed", "step_s", "t2_s")}
    data |= {"noise": _noise(one), "sets": {name: one["data"]["sets"][name]}}
    return {"system": one["system"], "data": data}


def train(config: Mapping, experiment: str, method: str, group: str) -> dict:
    one, build = experiment_of(config, experiment, method), build_of(config, experiment, method)
    model, training = dict(one["model"]), one["training"]
    if build.get("interaction") is False:
        del model["interaction"]
    given = {}
    if build["kind"] == "alternating":
        model, training = {"interaction": model["interaction"]}, one["alternation"]
    elif build["kind"] != "hybrid":
        model, training = {}, solver_of(training)
    else:
        training = with_own_options(training, build)
        if options.needs_prior(objective_of(build), "objective"):
            given = {"prior": _prior(one["augmentation"])}
    given |= _estimator(config, experiment, method)
    return {
        **_identity(config, experiment, method),
        "system": config["experiments"][experiment]["system"],
        "build": {k: v for k, v in build.items() if k != "label"},
        "model": model,
        "training": training,
        **given,
        **({"snapshots": kept} if (kept := snapshots(config, experiment, method)) else {}),
        "t1_s": one["data"]["t1_s"],
        **({"start": one["data"]["start"]} if one["data"]["start"] else {}),
        "choices": _choices(one, "train"),
        "seeds": seed_groups(config, experiment)[group],
        "device": config["device"],
    }


def augment(config: Mapping, experiment: str, variant: str, group: str) -> dict:
    version = Version.parse(variant)
    method, name = version.method, version.prior
    one = experiment_of(config, experiment, method)
    block = one["augmentations"][name] if name else one["augmentation"]
    return {
        "experiment": experiment,
        "method": variant,
        "prior": _prior(block),
        **({"worst": block["worst"]} if block["worst"] else {}),
        "noise": _noise(one),
        "choices": _choices(one, "augment"),
        "seeds": seed_groups(config, experiment)[group],
        "device": config["device"],
        **foreign(config, experiment, method),
    }


def finetune(config: Mapping, experiment: str, variant: str, group: str) -> dict:
    method = Version.parse(variant).method
    one = experiment_of(config, experiment, method)
    return {
        **_identity(config, experiment, variant),
        "training": with_own_options(one["finetuning"], config["methods"][method]),
        **({"prior": _prior(one["augmentation"])} if Version.parse(variant).is_control else {}),
        "choices": _choices(config["experiments"][experiment], "finetune"),
        "seeds": seed_groups(config, experiment)[group],
        "device": config["device"],
        **foreign(config, experiment, method),
    }


def flow(config: Mapping, experiment: str, variant: str, group: str) -> dict:
    one = experiment_of(config, experiment, Version.parse(variant).method)
    told = augment(config, experiment, variant, group) | _identity(config, experiment, variant)
    return told | {"flow": one["flow"], "choices": _choices(one, "flow"), "worst": 0.0}


def own_prior(config: Mapping, experiment: str, variant: str, group: str | None) -> dict:
    """Of an augmented version whose p⁺ finds its own ranges; of none ("") before anything is trained."""
    method = Version.parse(variant).method or None
    one, name = experiment_of(config, experiment, method), Version.parse(variant).prior
    block = one["augmentations"][name] if name else one["augmentation"]
    found = {k: block[k] for k in ("windows", "budget")} | {"noise": _noise(one), "refinement": one["refinement"]}
    if method is not None:
        return found | {"device": config["device"], **foreign(config, experiment, method)}
    identity = {"experiment": experiment, "method": "least_squares", "label": "", "preset": config["preset"]}
    build = {"kind": "least_squares", "interaction": False}
    told = {"system": one["system"], "build": build, "model": {}, "t1_s": one["data"]["t1_s"]}
    told |= {"training": solver_of(one["training"])}
    told |= {"start": one["data"]["start"]} if one["data"]["start"] else {}
    return found | identity | told | {"choices": _choices(one, "train"), "seeds": [0]}


def evaluate(config: Mapping, experiment: str, variant: str, group: str) -> dict:
    return {
        **_identity(config, experiment, variant),
        "evaluation": _evaluation(config, experiment),
        **(_estimator(config, experiment, variant) if Version.parse(variant).is_refined else {}),
        **_drawn(config, experiment, variant),
        "sets": sets(config, experiment),
        "choices": _choices(config["experiments"][experiment], "evaluate"),
        "seeds": seed_groups(config, experiment)[group],
        "device": config["device"],
        **foreign(config, experiment, Version.parse(variant).method),
    }


def during_training(config: Mapping, experiment: str, method: str, group: str) -> dict:
    """The settings of augmentation, of the fine-tunings and of their evaluation."""
    study = config["experiments"][experiment]["studies"]["during_training"]
    evaluation = {k: v for k, v in _evaluation(config, experiment).items() if k in ("from_s", "solver")}
    return {
        **_identity(config, experiment, method),
        "augment": augment(config, experiment, f"{method}+", group),
        "finetune": finetune(config, experiment, f"{method}+", group),
        "finetune_epochs": study["finetune_epochs"],
        "evaluation": evaluation | {"max_samples": study["max_samples"]},
        "choices": _choices(config["experiments"][experiment], "evaluate"),
        "seeds": seed_groups(config, experiment)[group],
        "device": config["device"],
    }


def dissipation(config: Mapping, experiment: str) -> dict:
    """Which versions are compared, and how the estimates of each are found."""
    versions = dissipating(config, experiment)
    fits = [_estimator(config, experiment, v).get("refinement") for v in versions]
    # What a fitted method starts within its file says; refined versions start at their own estimates then.
    pairs = zip(fits, versions, strict=True)
    fits = [_without_search(fit, v) if fit and fit["prior"] == "own" else fit for fit, v in pairs]
    own = [foreign(config, experiment, Version.parse(v).method).get("classes", []) for v in versions]
    classes = list(dict.fromkeys(name for names in own for name in names))
    return {
        "experiment": experiment,
        "versions": [[v, label(config, v), fit] for v, fit in zip(versions, fits, strict=True)],
        "all_methods": all_methods(config),
        **reading(config, experiment),
        "device": config["device"],
        **({"classes": classes} if classes else {}),
    }


def validity(config: Mapping, experiment: str) -> dict:
    """Which trained methods are checked, and how the windows of each are fitted."""
    one, versions, classes = config["experiments"][experiment], [], []
    for method in checked(config, experiment):
        own = experiment_of(config, experiment, method)
        fit = {"settings": own["refinement"], "noise": _noise(own), "prior": own["augmentation"]["prior"]}
        versions.append([method, label(config, method), fit])
        classes += foreign(config, experiment, method).get("classes", [])
    told = {"experiment": experiment, "versions": versions, "validity": one["validity"], "device": config["device"]}
    told |= {"all_methods": all_methods(config), **reading(config, experiment)}
    return told | ({"classes": list(dict.fromkeys(classes))} if classes else {})


def _identity(config: Mapping, experiment: str, variant: str) -> dict:
    return {"experiment": experiment, "method": variant, "label": label(config, variant), "preset": config["preset"]}


def _estimator(config: Mapping, experiment: str, variant: str) -> dict:
    """What least squares on each window needs, where a version's estimates come from it."""
    method = Version.parse(variant).method
    if not Version.parse(variant).is_refined and config["methods"][method]["kind"] not in FITTED:
        return {}
    one = experiment_of(config, experiment, method)
    return {"refinement": {"settings": one["refinement"], "noise": _noise(one), "prior": _prior(one["augmentation"])}}


def _without_search(fit: Mapping, variant: str) -> dict | None:
    return {**fit, "prior": None} if Version.parse(variant).is_refined else None


def _drawn(config: Mapping, experiment: str, variant: str) -> dict:
    """The data's noise, and what a version's own windows are made with, where the experiment has p⁺."""
    version = Version.parse(variant)
    one = experiment_of(config, experiment, version.method)
    if config["methods"][version.method]["kind"] == "mean":
        return {"noise": _noise(one)}
    anew = one["choices"]["augmented_x"] == "resampled"
    anew = one["flow"].get("resample_x", anew) if FLOW in version.estimators else anew
    own = {"resample_x": anew, "z_a_from": one["choices"]["augmented_z_a"]}
    own["prior"] = _prior(one["augmentations"][version.prior] if version.prior else one["augmentation"])
    return {"noise": _noise(one), "own": own}


def _prior(augmentation: Mapping) -> dict | str:
    """Ranges of p⁺, or that they are to be found (:mod:`expertaug.inference.adaptive_prior`)."""
    return augmentation["prior"] or "own"


def _evaluation(config: Mapping, experiment: str) -> dict:
    return {k: v for k, v in config["experiments"][experiment]["evaluation"].items() if k not in SHOWING}


def _choices(experiment: Mapping, stage: str) -> dict:
    return {row: experiment["choices"][row] for row in CHOICES[stage]}


def _noise(experiment: Mapping) -> float | dict | str:
    """Standard deviation of the noise of an experiment's data: one, one for each component, or that it is estimated."""
    return experiment["data"]["noise"] if experiment["choices"]["noise"] == "config" else 0.0

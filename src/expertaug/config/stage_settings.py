"""What each job takes of the configuration, and nothing more: a changed key redoes only the jobs whose slice has it.

Every function takes the completed configuration (:func:`expertaug.config.load.validate`) and returns the ``settings``
of the stage of its name.
"""

from __future__ import annotations

from collections.abc import Mapping

from expertaug import labels as naming
from expertaug.config import signatures
from expertaug.config.jobs import label, seed_groups, sets, snapshots, studied, variants
from expertaug.config.load import merge
from expertaug.registry import full_name

# Rows of the preset's table (expertaug.config.presets) that each stage of learning obeys.
_TRAINING = ("loss_window", "multiplier", "penalty", "loss_normalisation", "supervision", "selection", "hvae_z_e")
CHOICES = {
    "train": (*_TRAINING, "observed_points"),
    "augment": ("loss_window", "augmentation_noise", "augmented_x", "augmented_z_a"),
    "finetune": (*_TRAINING, "frozen", "resample"),
    "evaluate": ("forecast_start",),
}


# Keys of an evaluation that say how its numbers are read and shown; they change none of them.
READING = ("convention", "set_titles", "title")
SHOWING = (*READING, "published", "overview")


def init_tracking(config: Mapping) -> dict:
    return dict(config["tracking"])


def render_video(config: Mapping) -> dict:
    """All but the number of recordings, on which no recording depends."""
    return {k: v for k, v in config["recordings"]["rendered"].items() if k != "count"}


def extract_frames(config: Mapping) -> dict:
    recordings = config["recordings"]
    rate = {"analysis_rate_hz": recordings["analysis_rate_hz"]}
    if recordings["source"] == "videos":
        return rate | {k: recordings["videos"][k] for k in ("rate_hz", "rate_provenance", "image_size_px")}
    rendered = recordings["rendered"]
    return rate | {
        "rate_hz": rendered["rate_hz"],
        "rate_provenance": "rendered at this rate",
        "expected_frames": max(1, round(rendered["duration_s"] * rendered["rate_hz"])),
        "image_size_px": rendered["image_size_px"],
    }


def track_markers(config: Mapping) -> dict:
    return dict(config["recordings"]["tracking"])


def unpack_markers(config: Mapping) -> dict:
    return {"sha256": config["recordings"]["markers"]["sha256"]}


def import_markers(config: Mapping) -> dict:
    return {k: v for k, v in config["recordings"]["markers"].items() if k not in ("path", "sha256")}


def measure_angles(config: Mapping) -> dict:
    recordings = config["recordings"]
    own = {"arm1_m": _arms(recordings)[0], "rate_provenance": _rate(recordings)[1]}
    return recordings["angles"] | own


def overlay(config: Mapping) -> dict:
    """What is shown, and the rate by which the video's frames are told."""
    shown = {k: v for k, v in config["recordings"]["overlay"].items() if k not in ("experiment", "variants")}
    rates = extract_frames(config)
    return shown | {k: rates[k] for k in ("rate_hz", "rate_provenance")}


def overlaid(config: Mapping) -> tuple[str, list[str]] | None:
    """The experiment and the variants of its methods whose forecasts are drawn over the videos."""
    chosen = config["recordings"]["overlay"]
    known = [e for e in config["run"] if config["experiments"][e]["data"]["source"] == "recordings"]
    experiment = chosen["experiment"] or next(iter(known), None)
    if experiment is None:
        return None
    return experiment, chosen["variants"] or variants(config, experiment)[-1:]


def split_chunks(config: Mapping, experiment: str) -> dict:
    return dict(config["experiments"][experiment]["data"]["split"])


def calibrate(config: Mapping, experiment: str) -> dict:
    recordings = config["recordings"]
    rate, provenance = _rate(recordings)
    return config["experiments"][experiment]["data"]["calibration"] | {
        "arm1_m": _arms(recordings)[0],
        "arm2_m": _arms(recordings)[1],
        "nominal_rate_hz": rate,
        "rate_provenance": provenance,
    }


def simulate(config: Mapping, experiment: str, name: str) -> dict:
    one = config["experiments"][experiment]
    data = {k: one["data"][k] for k in ("seed", "step_s", "t2_s")}
    data |= {"noise": _noise(one), "sets": {name: one["data"]["sets"][name]}}
    return {"system": one["system"], "data": data}


def train(config: Mapping, experiment: str, method: str, group: str) -> dict:
    one, build = _experiment(config, experiment, method), config["methods"][method]
    model, training = dict(one["model"]), one["training"]
    if build.get("interaction") is False:
        del model["interaction"]
    given = {}
    if build["kind"] == "mean":
        model, training = {}, {}
    else:
        training = _with_own_options(training, build)
        if signatures.takes("objective", _objective(build), "prior", "objective"):
            given = {"prior": one["augmentation"]["prior"]}
    return {
        **_identity(config, experiment, method),
        "system": one["system"],
        "build": {k: v for k, v in build.items() if k != "label"},
        "model": model,
        "training": training,
        **given,
        **({"snapshots": kept} if (kept := snapshots(config, experiment, method)) else {}),
        "t1_s": one["data"]["t1_s"],
        "choices": _choices(config, experiment, "train"),
        "seeds": seed_groups(config)[group],
        "device": config["device"],
    }


def augment(config: Mapping, experiment: str, variant: str, group: str) -> dict:
    method, name = naming.split(variant)
    one = _experiment(config, experiment, method)
    return {
        "experiment": experiment,
        "method": variant,
        "prior": (one["augmentations"][name] if name else one["augmentation"])["prior"],
        "noise": _noise(one),
        "choices": _choices(config, experiment, "augment"),
        "seeds": seed_groups(config)[group],
        "device": config["device"],
        **_foreign(config, experiment, method),
    }


def finetune(config: Mapping, experiment: str, variant: str, group: str) -> dict:
    method = naming.split(variant)[0]
    return {
        **_identity(config, experiment, variant),
        "training": _with_own_options(_experiment(config, experiment, method)["finetuning"], config["methods"][method]),
        "choices": _choices(config, experiment, "finetune"),
        "seeds": seed_groups(config)[group],
        "device": config["device"],
        **_foreign(config, experiment, method),
    }


def evaluate(config: Mapping, experiment: str, variant: str, group: str) -> dict:
    return {
        **_identity(config, experiment, variant),
        "evaluation": _evaluation(config, experiment),
        "sets": sets(config, experiment),
        "choices": _choices(config, experiment, "evaluate"),
        "seeds": seed_groups(config)[group],
        "device": config["device"],
        **_foreign(config, experiment, naming.split(variant)[0]),
    }


def during_training(config: Mapping, experiment: str, method: str, group: str) -> dict:
    """The settings of augmentation, of the fine-tunings and of their evaluation."""
    study = config["experiments"][experiment]["studies"]["during_training"]
    tuned = finetune(config, experiment, f"{method}+", group)
    evaluation = {k: v for k, v in _evaluation(config, experiment).items() if k in ("from_s", "solver")}
    return {
        **_identity(config, experiment, method),
        "augment": augment(config, experiment, f"{method}+", group),
        "finetune": tuned | {"training": merge(tuned["training"], study["finetuning"])},
        "finetune_epochs": study["finetune_epochs"],
        "evaluation": evaluation | {"max_samples": study["max_samples"]},
        "choices": _choices(config, experiment, "evaluate"),
        "seeds": seed_groups(config)[group],
        "device": config["device"],
    }


def study(config: Mapping, experiment: str, name: str) -> dict:
    """What a study's table and figure say: order and labels of the variants, sets, ranges."""
    one = config["experiments"][experiment]
    settings = {
        "study": name,
        "labels": [[variant, label(config, variant)] for variant in studied(config, experiment, name)],
        "all_labels": _all_labels(config),
        "sets": one["data"].get("sets", {}),
        **_reading(config, experiment),
    }
    if name == "prior_width":
        further = {k: v["prior"] for k, v in one["augmentations"].items()}
        methods = dict.fromkeys(naming.split(variant)[0] for variant in studied(config, experiment, name))
        own = {m: _experiment(config, experiment, m)["augmentation"]["prior"] for m in methods}
        return settings | {"priors": {m: {"": own[m]} | further for m in methods}}
    options = one["studies"][name]
    if name == "out_of_expertise":
        options = {"distances": options["distances"], "panels": [[k, v] for k, v in options["panels"].items()]}
    return settings | {"options": options}


def compare(config: Mapping, experiments: list[str]) -> dict:
    """Which published numbers each experiment is compared with."""
    return {"published": [[name, config["experiments"][name]["evaluation"]["published"]] for name in experiments]}


def overview(config: Mapping, experiments: list[str]) -> dict:
    """What the figures over several experiments show of each."""
    all_of = [config["experiments"][name] for name in experiments]
    shifted = [one["studies"].get("out_of_expertise", {}).get("overview") for one in all_of]
    return {
        "experiments": [
            {"name": name, "shown": one["evaluation"]["overview"], "shifted": far, **_reading(config, name)}
            for name, one, far in zip(experiments, all_of, shifted, strict=True)
            if one["evaluation"]["overview"] or far
        ],
        "all_labels": _all_labels(config),
    }


def tabulate(config: Mapping, experiment: str) -> dict:
    """The order of the methods, and how metrics and sets are to be read."""
    return {"labels": _labels(config, experiment), **_reading(config, experiment)}


def plot(config: Mapping, experiment: str) -> dict:
    """The order of the methods, and the ranges of the expert parameters in training and in each one's augmentation."""
    one = config["experiments"][experiment]
    priors = {
        label(config, v): _experiment(config, experiment, naming.split(v)[0]).get("augmentation", {}).get("prior", {})
        for v in variants(config, experiment)
    }
    return {
        "labels": _labels(config, experiment),
        "all_labels": _all_labels(config),
        **_reading(config, experiment),
        "training_range": one["data"]["sets"]["train"]["z_e"] if one["data"]["source"] == "simulation" else {},
        "priors": priors,
    }


def modules(config: Mapping, experiment: str, method: str | None = None) -> list[str]:
    """What an experiment's configuration names: the module of its system, classes as ``package.module:Class``."""
    one = config["experiments"][experiment]
    build = config["methods"][method] if method else {}
    name = build.get("system", {}).get("name", one["system"]["name"])
    named = [name if "." in name else f"expertaug.systems.{name}"]
    if method:
        named += _classes(build, _experiment(config, experiment, method)["model"])
    return named


def _foreign(config: Mapping, experiment: str, method: str) -> dict:
    """Classes from elsewhere that a method's model file may name; nothing where there is none."""
    found = [name for name in modules(config, experiment, method) if not name.startswith("expertaug.")]
    return {"classes": found} if found else {}


def _classes(build: Mapping, model: Mapping) -> list[str]:
    """Classes that a hybrid method is made of."""
    if build["kind"] != "hybrid":
        return []
    parts = [part for part in ("encoder", "interaction") if build.get(part, True)]
    objective = full_name("objective", _objective(build), "objective")
    return [*(full_name(part, model[part]["kind"], part) for part in parts), objective]


def _identity(config: Mapping, experiment: str, variant: str) -> dict:
    return {"experiment": experiment, "method": variant, "label": label(config, variant), "preset": config["preset"]}


def _experiment(config: Mapping, experiment: str, method: str) -> dict:
    """An experiment with what it overrides for a method."""
    one = config["experiments"][experiment]
    return merge(one, one["overrides"].get(method, {}))


def _objective(build: Mapping) -> str:
    """Kind of a method's objective."""
    return build.get("objective", "aphynity")


def _with_own_options(training: Mapping, build: Mapping) -> dict:
    """A block of training with those of the objective's options that are the method's own objective's."""
    known = signatures.of_kind("objective", _objective(build), "objective")
    return {**training, "objective": {k: v for k, v in training.get("objective", {}).items() if k in known}}


def _reading(config: Mapping, experiment: str) -> dict:
    """What tables and figures say of an experiment's metrics; it changes none of them."""
    evaluation = config["experiments"][experiment]["evaluation"]
    return {key: evaluation[key] for key in ("from_s", *READING)}


def _evaluation(config: Mapping, experiment: str) -> dict:
    """What an evaluation computes."""
    return {k: v for k, v in config["experiments"][experiment]["evaluation"].items() if k not in SHOWING}


def _all_labels(config: Mapping) -> list[str]:
    return [build["label"] for build in config["methods"].values()]


def _labels(config: Mapping, experiment: str) -> list[str]:
    return [label(config, variant) for variant in variants(config, experiment)]


def _choices(config: Mapping, experiment: str, stage: str) -> dict:
    return {row: config["experiments"][experiment]["choices"][row] for row in CHOICES[stage]}


def _noise(experiment: Mapping) -> float:
    """Standard deviation of the noise of an experiment's data."""
    return experiment["data"]["noise"] if experiment["choices"]["noise"] == "config" else 0.0


def _arms(recordings: Mapping) -> list[float | None]:
    """Lengths of the two arms in m, None where they are not known."""
    return recordings["arms_m"] or [None, None]


def _rate(recordings: Mapping) -> tuple[float, str]:
    """Rate of the analysed frames in Hz, and where it is known from."""
    source = recordings["source"]
    if source == "markers":
        return recordings["markers"]["rate_hz"], recordings["markers"]["rate_provenance"]
    if source == "rendered":
        return recordings["analysis_rate_hz"], "rendered at this rate"
    videos = recordings["videos"]
    default = "the video's metadata" if videos["rate_hz"] is None else "recordings.videos.rate_hz"
    return recordings["analysis_rate_hz"], videos["rate_provenance"] or default

"""What each job takes of the configuration, and nothing more: a changed key redoes only the jobs whose slice has it.

Every function takes the completed configuration (:func:`expertaug.config.validate`) and returns the ``settings`` of the
stage of its name.
"""

from __future__ import annotations

from collections.abc import Mapping

from expertaug.config import merge
from expertaug.kinds import full_name

# Rows of the preset's table (expertaug.presets) that each stage of learning obeys.
_TRAINING = ("loss_window", "multiplier", "penalty", "loss_normalisation", "supervision", "selection")
CHOICES = {
    "train": (*_TRAINING, "observed_points"),
    "augment": ("loss_window", "augmentation_noise", "augmented_x"),
    "finetune": (*_TRAINING, "frozen", "resample"),
    "evaluate": ("forecast_start",),
}


READING = ("convention", "set_titles")


def blocks(config: Mapping) -> dict[str, list[int]]:
    """Seeds that one job trains together, by the block's name."""
    seeds, size = config["seeds"], config["seeds_per_job"]
    parts = [seeds[k : k + size] for k in range(0, len(seeds), size)]
    return {f"seeds_{'_'.join(map(str, part))}": part for part in parts}


def variants(config: Mapping, experiment: str) -> list[str]:
    """An experiment's methods, each followed by its augmented version ``method+`` where there is one."""
    one = config["experiments"][experiment]
    names = [[m, f"{m}+"] if m in one["augmented"] else [m] for m in one["methods"]]
    return [name for pair in names for name in pair]


def label(config: Mapping, variant: str) -> str:
    """What tables and figures print for ``method`` or ``method+``."""
    method = variant.removesuffix("+")
    return config["methods"][method]["label"] + variant[len(method) :]


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
    own = {"arm1_m": recordings["arms_m"][0], "rate_provenance": _rate(recordings)[1]}
    return recordings["angles"] | own


def split_chunks(config: Mapping, experiment: str) -> dict:
    return dict(config["experiments"][experiment]["data"]["split"])


def calibrate(config: Mapping, experiment: str) -> dict:
    recordings = config["recordings"]
    rate, provenance = _rate(recordings)
    return config["experiments"][experiment]["data"]["calibration"] | {
        "arm1_m": recordings["arms_m"][0],
        "arm2_m": recordings["arms_m"][1],
        "nominal_rate_hz": rate,
        "rate_provenance": provenance,
    }


def simulate(config: Mapping, experiment: str, name: str) -> dict:
    one = config["experiments"][experiment]
    data = {k: one["data"][k] for k in ("seed", "step_s", "t2_s")}
    data |= {"noise": _noise(one), "sets": {name: one["data"]["sets"][name]}}
    return {"system": one["system"], "data": data}


def train(config: Mapping, experiment: str, method: str, block: str) -> dict:
    one, build = _experiment(config, experiment, method), config["methods"][method]
    model, training = dict(one["model"]), one["training"]
    if build.get("interaction") is False:
        del model["interaction"]
    if build["kind"] == "mean":
        model, training = {}, {}
    return {
        **_identity(config, experiment, method),
        "system": one["system"],
        "build": {k: v for k, v in build.items() if k != "label"},
        "model": model,
        "training": training,
        "t1_s": one["data"]["t1_s"],
        "choices": _choices(config, experiment, "train"),
        "seeds": blocks(config)[block],
        "device": config["device"],
    }


def augment(config: Mapping, experiment: str, method: str, block: str) -> dict:
    one = _experiment(config, experiment, method)
    return {
        "experiment": experiment,
        "method": f"{method}+",
        "prior": one["augmentation"]["prior"],
        "noise": _noise(one),
        "choices": _choices(config, experiment, "augment"),
        "seeds": blocks(config)[block],
        "device": config["device"],
    }


def finetune(config: Mapping, experiment: str, method: str, block: str) -> dict:
    return {
        **_identity(config, experiment, f"{method}+"),
        "training": _experiment(config, experiment, method)["finetuning"],
        "choices": _choices(config, experiment, "finetune"),
        "seeds": blocks(config)[block],
        "device": config["device"],
    }


def evaluate(config: Mapping, experiment: str, variant: str, block: str) -> dict:
    return {
        **_identity(config, experiment, variant),
        "evaluation": {k: v for k, v in config["experiments"][experiment]["evaluation"].items() if k not in READING},
        "choices": _choices(config, experiment, "evaluate"),
        "seeds": blocks(config)[block],
        "device": config["device"],
    }


def tabulate(config: Mapping, experiment: str) -> dict:
    """The order of the methods, and how metrics and sets are to be read."""
    return {"labels": _labels(config, experiment), **_reading(config, experiment)}


def plot(config: Mapping, experiment: str) -> dict:
    """The order of the methods, and the ranges of the expert parameters in training and in augmentation."""
    one = config["experiments"][experiment]
    return {
        "labels": _labels(config, experiment),
        "all_labels": [build["label"] for build in config["methods"].values()],
        **_reading(config, experiment),
        "training_range": one["data"]["sets"]["train"]["z_e"] if one["data"]["source"] == "simulation" else {},
        "prior": one.get("augmentation", {}).get("prior", {}),
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


def _classes(build: Mapping, model: Mapping) -> list[str]:
    """Classes that a hybrid method is made of."""
    if build["kind"] != "hybrid":
        return []
    parts = [part for part in ("encoder", "interaction") if build.get(part, True)]
    objective = full_name("objective", build.get("objective", "aphynity"), "objective")
    return [*(full_name(part, model[part]["kind"], part) for part in parts), objective]


def _identity(config: Mapping, experiment: str, variant: str) -> dict:
    return {"experiment": experiment, "method": variant, "label": label(config, variant), "preset": config["preset"]}


def _experiment(config: Mapping, experiment: str, method: str) -> dict:
    """An experiment with what it overrides for a method."""
    one = config["experiments"][experiment]
    return merge(one, one["overrides"].get(method, {}))


def _reading(config: Mapping, experiment: str) -> dict:
    """What tables and figures say of an experiment's metrics; it changes none of them."""
    evaluation = config["experiments"][experiment]["evaluation"]
    return {key: evaluation[key] for key in ("from_s", *READING)}


def _labels(config: Mapping, experiment: str) -> list[str]:
    return [label(config, variant) for variant in variants(config, experiment)]


def _choices(config: Mapping, experiment: str, stage: str) -> dict:
    return {row: config["experiments"][experiment]["choices"][row] for row in CHOICES[stage]}


def _noise(experiment: Mapping) -> float:
    """Standard deviation of the noise of an experiment's data."""
    return experiment["data"]["noise"] if experiment["choices"]["noise"] == "config" else 0.0


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

"""What each job of a method gets, every value with where it comes from: ``expertaug config show``."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from expertaug.config import jobs, recording_settings, stage_settings
from expertaug.config.layers import inherit, origin_of, under
from expertaug.config.load import validate
from expertaug.config.models import Configuration
from expertaug.config.yaml_file import Located
from expertaug.errors import InputError, InputErrors
from expertaug.versions import AUGMENTED, FLOW, Version
from expertaug.wording import show as written
from expertaug.wording import unknown_one

WIDTH = 58  # columns of a key and its value
# Where in an experiment a stage's settings stand, where it is not the key of the same name.
ELSEWHERE = {"prior": ("augmentation", "prior"), "t1_s": ("data", "t1_s"), "noise": ("data", "noise")}
NAMES = ("experiment", "method", "sets")


def show(config: Located, experiment: str, method: str, words: Sequence[str] = ()) -> Iterator[str]:
    """Lines of text: the jobs of an experiment's method, and below each its settings.

    Arguments:
        config: files merged, not completed.
        words: of which one is in the job or in the key of each setting shown; empty: all are shown.

    Raises:
        InputErrors: the configuration is wrong, or has no such experiment or method.
        InputError: no job and no key has one of the words.
    """
    complete = validate({**config, "run": [experiment]} if experiment in config.get("experiments", {}) else config)
    errors = list(unknown_one(experiment, complete.experiments, "EXPERIMENT", "experiment"))
    if not errors:
        methods = complete.experiments[experiment].methods
        errors = list(unknown_one(method.rstrip("+"), methods, "METHOD", "method of this experiment"))
    if errors:
        raise InputErrors(errors)
    origins = _Origins(config, complete.preset, experiment, method.rstrip("+"))
    empty = True
    for title, settings, own in _jobs(complete, experiment, method.rstrip("+")):
        lines = []
        for path, value in _leaves(settings):
            key = ".".join(path)
            if path[0] not in NAMES and (not words or any(word in title or word in key for word in words)):
                lines.append(f"{f'  {key}: {written(value)}':<{WIDTH}} # {origins.of(path, own)}")
        if lines:
            yield from (title, *lines)
            empty = False
    if empty:
        raise InputError("WORD", f"{', '.join(words)}: in no job and no key", "leave the words out to see all")


def _jobs(
    config: Configuration, experiment: str, method: str
) -> Iterator[tuple[str, dict[str, Any], dict[str, tuple[str, ...]]]]:
    """Title and settings of each job, and where its keys stand in the experiment if not where most do."""
    data = config.experiments[experiment].data
    if data.source == "simulation":
        for name in data.simulated:
            yield f"simulate {name}", stage_settings.simulate(config, experiment, name), {}
    elif data.source == "files":
        files = {"files": ("data", "files")}
        yield "cut_measurements", recording_settings.cut_measurements(config, experiment), files
    else:
        split = recording_settings.split_chunks(config, experiment).dump()
        yield "split_chunks", split, {"": ("data", "split")}
    for group in jobs.seed_groups(config, experiment):
        title = f"{method} {group}"
        yield f"train {title}", stage_settings.train(config, experiment, method, group), {}
        own = [v for v in _variants(config, experiment) if Version.parse(v).method == method and v != method]
        for variant in own:
            version = Version.parse(variant)
            if version.estimators == (FLOW,):
                yield f"flow {variant} {group}", stage_settings.flow(config, experiment, variant, group), {}
            if version.estimators or version.step != AUGMENTED:
                continue
            prior: dict[str, tuple[str, ...]] = {}
            if version.prior:
                prior = {"prior": ("augmentations", version.prior, "prior")}
            here = f"{variant} {group}"
            yield f"augment {here}", stage_settings.augment(config, experiment, variant, group), prior
            settings = stage_settings.finetune(config, experiment, variant, group)
            yield f"finetune {here}", settings, {"training": ("finetuning",)}
        for variant in (method, *own):
            yield f"evaluate {variant} {group}", stage_settings.evaluate(config, experiment, variant, group), {}


def _variants(config: Configuration, experiment: str) -> list[str]:
    return [*jobs.variants(config, experiment), *jobs.further_variants(config, experiment)]


def _leaves(value: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    if isinstance(value, Mapping) and value:
        for key, item in value.items():
            yield from _leaves(item, (*path, key))
    else:
        yield path, value


class _Origins:
    """Where the values of an experiment's method were said."""

    def __init__(self, config: Located, preset: str, experiment: str, method: str) -> None:
        self.config, self.preset, self.method = config, preset, method
        block = inherit(config["experiments"])[0][experiment]
        self.experiment = under(self.preset, block, f"experiments.{experiment}", [])
        self.over = self.experiment.get("overrides", {}).get(method, {})

    def of(self, path: tuple[str, ...], elsewhere: dict[str, tuple[str, ...]]) -> str:
        """Of a value at a path of a stage's settings."""
        first, *rest = path
        if first in ("seeds", "device", "preset"):
            said = origin_of(self.experiment, ["seeds"]) if first == "seeds" else None
            return said or origin_of(self.config, [first]) or "default"
        if first in ("build", "label"):
            own = rest if first == "build" else ["label"]
            if own[:1] == ["system"]:
                return f"{origin_of(self.over, own)}, overrides of {self.method}"
            return origin_of(self.config, ["methods", self.method, *own]) or "default"
        if first == "snapshots":
            return origin_of(self.experiment, ["studies", "during_training", "epochs"]) or "default"
        if first == "choices":
            return origin_of(self.experiment, list(path)) or f"preset {self.preset}"
        if "" in elsewhere:
            where = [*elsewhere[""], *path]
        else:
            where = [*elsewhere.get(first, ELSEWHERE.get(first, (first,))), *rest]
        over = origin_of(self.over, where)
        if over is not None:
            return f"{over}, overrides of {self.method}"
        return origin_of(self.experiment, where) or "default"

"""Checks of what a configuration says of an experiment's studies and of its comparison with the paper."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping
from pathlib import Path

from expertaug.config.names import other_parameters, unknown, unknown_keys, unknown_one
from expertaug.errors import InputError
from expertaug.measurements.settings import MeasurementSettings
from expertaug.versions import MAIN_SETS
from expertaug_recordings.settings import SplitChunksJob

PUBLISHED = Path(__file__).parents[1] / "evaluation" / "paper.csv"


def check(where: str, experiment: Mapping, methods: Mapping) -> Iterator[InputError]:
    """What is wrong with the blocks augmentations, studies and evaluation of an experiment."""
    yield from _augmentations(where, experiment)
    yield from _out_of_expertise(where, experiment)
    yield from _during_training(where, experiment, methods)
    evaluation = experiment["evaluation"]
    yield from unknown_keys(evaluation["set_titles"], sets_of(experiment), f"{where}.evaluation.set_titles")
    if evaluation["published"] is not None:
        what = "system with published numbers"
        yield from unknown_one(evaluation["published"], published_systems(), f"{where}.evaluation.published", what)


def sets_of(experiment: Mapping) -> list[str]:
    """Names of an experiment's sets."""
    return [*experiment["data"].get("sets", MAIN_SETS), *horizons_of(experiment)]


def horizons_of(experiment: Mapping) -> dict[str, tuple[str, float]]:
    """Sets of long chunks of an experiment on measurements by name: the split that each is of, and its length in s."""
    data = experiment["data"]
    if data["source"] == "files":
        return MeasurementSettings.from_mapping(data["files"]).horizons
    return SplitChunksJob.from_mapping(data["split"]).horizons if data["source"] == "recordings" else {}


def published_systems() -> list[str]:
    """Systems whose published numbers this package knows."""
    with PUBLISHED.open(encoding="utf-8", newline="") as stream:
        return list(dict.fromkeys(row["system"] for row in csv.DictReader(stream)))


def _augmentations(where: str, experiment: Mapping) -> Iterator[InputError]:
    expected, of = experiment["augmentation"]["prior"] or {}, "augmentation.prior"
    sets_known = sets_of(experiment)
    yield from unknown(experiment["augmentation"]["windows"], sets_known, f"{where}.augmentation.windows", "set")
    if sets := experiment["data"].get("sets"):
        expected, of = next(iter(sets.values()))["z_e"], "the sets' z_e"
    for name, one in experiment["augmentations"].items():
        if not experiment["augmented"]:
            yield InputError(f"{where}.augmentations", "no method is under augmented", "name one there")
            return
        here = f"{where}.augmentations.{name}"
        yield from unknown(one.get("methods", []), experiment["augmented"], f"{here}.methods", "method under augmented")
        yield from unknown(one["windows"], sets_known, f"{here}.windows", "set")
        if one["prior"] is not None and expected:
            yield from other_parameters(one["prior"], expected, f"{here}.prior", of)


def _out_of_expertise(where: str, experiment: Mapping) -> Iterator[InputError]:
    shifted = experiment["studies"].get("out_of_expertise")
    if shifted is None:
        return
    here, known, what = f"{where}.studies.out_of_expertise", sets_of(experiment), "set of this experiment"
    yield from unknown(shifted["distances"], shifted["distances"], f"{here}.distances", "distance")
    for title, names in shifted["panels"].items():
        yield from unknown(names, known, f"{here}.panels.{title}", what)
        if len(names) != len(shifted["distances"]):
            found = f"{len(names)} sets for {len(shifted['distances'])} distances"
            yield InputError(f"{here}.panels.{title}", found, "give one set for each distance")
    if shifted["overview"] is not None:
        yield from unknown_one(shifted["overview"], known, f"{here}.overview", what)


def _during_training(where: str, experiment: Mapping, methods: Mapping) -> Iterator[InputError]:
    study = experiment["studies"].get("during_training")
    if study is None:
        return
    here, method = f"{where}.studies.during_training", study["method"]
    wrong = list(unknown_one(method, experiment["methods"], f"{here}.method", "method of this experiment"))
    yield from wrong
    if wrong:
        return
    if methods[method]["kind"] != "hybrid":
        yield InputError(
            f"{here}.method", f"'{method}' is of kind {methods[method]['kind']}", "only hybrid methods can be augmented"
        )
    if "finetuning" not in experiment:
        yield InputError(f"{where}.finetuning", "missing", "studies.during_training needs it")
    last = {**experiment["training"], **experiment["overrides"].get(method, {}).get("training", {})}["epochs"]
    for key in ("epochs", "finetune_epochs"):
        for k, epoch in enumerate(study[key]):
            if epoch in study[key][:k]:
                yield InputError(f"{here}.{key}[{k}]", f"{epoch} is there twice", "name each once")
    for k, epoch in enumerate(study["epochs"]):
        if epoch > last:
            yield InputError(f"{here}.epochs[{k}]", f"found {epoch}", f"the training ends after {last} passes")

"""Checks of what a configuration says of an experiment's studies and of its comparison with the paper."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path

from expertaug.config.names import require, require_all, require_keys, require_parameters
from expertaug.errors import InputError
from expertaug.labels import MAIN_SETS

PUBLISHED = Path(__file__).parents[1] / "evaluation" / "paper.csv"


def check(where: str, experiment: Mapping, methods: Mapping) -> None:
    """Check the blocks augmentations, studies and evaluation of an experiment.

    Raises:
        InputError: the first thing that is wrong.
    """
    _augmentations(where, experiment)
    _out_of_expertise(where, experiment)
    _during_training(where, experiment, methods)
    require_keys(f"{where}.evaluation.set_titles", experiment["evaluation"]["set_titles"], sets_of(experiment))
    published = experiment["evaluation"]["published"]
    if published is not None:
        require(published, published_systems(), f"{where}.evaluation.published", "system with published numbers")


def sets_of(experiment: Mapping) -> list[str]:
    """Names of an experiment's sets."""
    return list(experiment["data"].get("sets", MAIN_SETS))


def published_systems() -> list[str]:
    """Systems whose published numbers this package knows."""
    with PUBLISHED.open(encoding="utf-8", newline="") as stream:
        return list(dict.fromkeys(row["system"] for row in csv.DictReader(stream)))


def _augmentations(where: str, experiment: Mapping) -> None:
    expected = experiment.get("augmentation", {}).get("prior", {})
    for name, one in experiment["augmentations"].items():
        if not experiment["augmented"]:
            raise InputError(f"{where}.augmentations", "no method is under augmented", "name one there")
        what = "method under augmented"
        require_all(one.get("methods", []), experiment["augmented"], f"{where}.augmentations.{name}.methods", what)
        require_parameters(f"{where}.augmentations.{name}.prior", one["prior"], expected, "augmentation.prior")


def _out_of_expertise(where: str, experiment: Mapping) -> None:
    shifted = experiment["studies"].get("out_of_expertise")
    if shifted is not None:
        here, known = f"{where}.studies.out_of_expertise", sets_of(experiment)
        for title, names in shifted["panels"].items():
            require_all(names, known, f"{here}.panels.{title}", "set of this experiment")
            if len(names) != len(shifted["distances"]):
                found = f"{len(names)} sets for {len(shifted['distances'])} distances"
                raise InputError(f"{here}.panels.{title}", found, "give one set for each distance")
        if shifted["overview"] is not None:
            require(shifted["overview"], known, f"{here}.overview", "set of this experiment")


def _during_training(where: str, experiment: Mapping, methods: Mapping) -> None:
    along = experiment["studies"].get("during_training")
    if along is not None:
        here, method = f"{where}.studies.during_training", along["method"]
        require(method, experiment["methods"], f"{here}.method", "method of this experiment")
        if methods[method]["kind"] == "mean":
            raise InputError(f"{here}.method", f"'{method}' is of kind mean", "only hybrid methods can be augmented")
        for key in ("augmentation", "finetuning"):
            if key not in experiment:
                raise InputError(f"{where}.{key}", "missing", "studies.during_training needs it")
        last = {**experiment["training"], **experiment["overrides"].get(method, {}).get("training", {})}["epochs"]
        for k, epoch in enumerate(along["epochs"]):
            if epoch > last:
                raise InputError(f"{here}.epochs[{k}]", f"found {epoch}", f"the training ends after {last} passes")

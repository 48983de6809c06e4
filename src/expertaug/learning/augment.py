"""The stage augment: D⁺ for every seed of a trained model."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from expertaug.errors import InputError
from expertaug.learning import augmentation
from expertaug.learning.sets import StackedSet
from expertaug.learning.task import task_of
from expertaug.models import store
from expertaug.models.device import device_of
from expertaug.trajectories import Trajectories


def augment(model: Path, data: Path, output: Path, settings: Mapping) -> None:
    """Stage: draw D⁺ for every seed of a trained model, and an augmented validation set that selects in fine-tuning.

    Arguments:
        model: file of the trained model.
        settings: {prior, noise, choices, device, …}; ``noise`` is the standard deviation of the data's noise.
    """
    device = device_of(settings["device"])
    stored = store.load(model, device)
    if stored.description["kind"] != "hybrid":
        raise InputError(model, f"a {stored.description['kind']} model", "only hybrid models can be augmented")
    choices = settings["choices"]
    task = task_of(stored.description["training"], stored.description, device)
    task = task.shortened(task.points(choices))
    noise = float(settings["noise"]) if choices["augmentation_noise"] == "as_data" else 0.0
    sets = [StackedSet.of(Trajectories.load(Path(data) / f"{name}.npz"), device) for name in ("train", "validation")]
    options = {"resample_x": choices["augmented_x"] == "resampled", "z_a_from": choices["augmented_z_a"]}
    drawn = [
        augmentation.generate(stored.model, part, task, stored.seeds, settings["prior"], noise, draw, **options)
        for draw, part in enumerate(sets)
    ]
    header = {"prior": settings["prior"], "noise": noise, "seeds": stored.seeds, "options": options}
    augmentation.save(output, *drawn, header)

"""D⁺ for every seed of a trained model, and the stage augment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from expertaug.errors import InputError
from expertaug.learning import augmentation
from expertaug.learning.settings import AugmentJob
from expertaug.learning.training_data import StackedSet, task_of
from expertaug.models import store
from expertaug.models.observation_noise import GivenNoise, NoiseLike, noise_of
from expertaug.models.store import device_of
from expertaug.presets import Choices
from expertaug.settings import given_ranges
from expertaug.trajectories import Trajectories


@dataclass(frozen=True)
class Augmented:
    """Augmented samples of every seed.

    Attributes:
        train, validation: y (T, S, N, *state), z_e (S, N, P); the second selects in fine-tuning.
        header: {prior, noise, seeds, options}: how they were drawn.
    """

    train: StackedSet
    validation: StackedSet
    header: Mapping


def augment(model: Path, data: Path, output: Path, settings: AugmentJob) -> None:
    """Stage: draw D⁺ for every seed of a trained model, and an augmented validation set that selects in fine-tuning.

    Arguments:
        model: file of the trained model.
        data: folder of the sets.
        output: file of D⁺.
        settings: of the job.
    """
    stored = store.load(model, device_of(settings.device), settings.classes or ())
    train, validation = (Trajectories.load(Path(data) / f"{name}.npz") for name in ("train", "validation"))
    prior, noise, choices = given_ranges(settings.prior), settings.noise, settings.choices
    plus = draw(stored, train, validation, prior, noise, choices, settings.worst, model)
    augmentation.save(output, plus.train, plus.validation, plus.header)


def draw(
    stored: store.StoredModel,
    train: Trajectories,
    validation: Trajectories,
    prior: Mapping[str, Sequence[float]],
    noise: GivenNoise,
    choices: Choices,
    worst: float = 0.0,
    where: object = "augmentation",
) -> Augmented:
    """Draw D⁺ in memory (paper, Algorithm 1).

    Arguments:
        stored: a trained hybrid model.
        train, validation: whose x and observed windows are used.
        prior: ranges of p⁺.
        noise: standard deviation of the data's noise.
        choices: rows of the preset.
        worst: as of :func:`expertaug.learning.augmentation.generate`.
        where: for messages.

    Raises:
        InputError: the model is a baseline, or the prior does not name its expert parameters.
        SolveError: samples are not finite for any z_e drawn.
    """
    device = stored.device
    if stored.card.kind != "hybrid":
        raise InputError(where, f"a {stored.card.kind} model", "only hybrid models can be augmented")
    task = task_of(stored.card.training, stored.card, device)
    task = task.shortened(task.points(choices))
    added: NoiseLike = 0.0
    if choices.augmentation_noise == "as_data":
        added = noise_of(noise, stored.model.system, stored.card)
    options = {"resample_x": choices.augmented_x == "resampled", "z_a_from": choices.augmented_z_a}
    options |= {"worst": float(worst)} if worst else {}
    plus, plus_validation = (
        augmentation.generate(
            stored.model, StackedSet.of(part, device), task, stored.seeds, prior, added, number, **options
        )
        for number, part in enumerate((train, validation))
    )
    header = {
        "prior": {name: list(ends) for name, ends in prior.items()},
        "noise": added,
        "seeds": stored.seeds,
        "options": options,
    }
    return Augmented(plus, plus_validation, header)

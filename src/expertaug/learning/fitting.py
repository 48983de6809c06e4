"""A training that is ready to run, in memory; :mod:`expertaug.learning.job` runs it as a job of the workflow."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import torch
from torch import Tensor

from expertaug.errors import InputError
from expertaug.learning.objectives import Objective
from expertaug.learning.residuals import record_residuals
from expertaug.learning.settings import FinetuneJob, TrainOptions, objective_of
from expertaug.learning.trainer import Trainer
from expertaug.learning.training_data import StackedSet, Task
from expertaug.models.card import LatentRecord, ModelCard
from expertaug.models.hybrid import HybridNet
from expertaug.models.posterior import principal_axes
from expertaug.models.settings import AXES
from expertaug.models.store import StoredModel

LATENT_PART = 1000  # windows that are encoded at a time


class Record:
    """Log and checkpoint of a training that keeps both in memory alone.

    Attributes:
        lines: (step, values by metric, one a seed), in order.
    """

    def __init__(self) -> None:
        self.lines: list[tuple[int, dict[str, list[float]]]] = []

    def metrics(self, step: int, values: Mapping[str, list[float]]) -> None:
        """Add one step."""
        self.lines.append((step, dict(values)))

    def event(self, name: str, **values: object) -> None:
        """Nothing to tell: what failed is warned of, and stands on the model's card."""

    def flush(self) -> None:
        """Nothing to bring to a disk."""

    def state(self) -> dict:
        """Nothing to go on from."""
        return {}

    def save(self, state: Mapping) -> None:
        """Nothing to resume."""


@dataclass(frozen=True)
class Training:
    """A trainer and what will be known about the model that it gives.

    Attributes:
        trainer: with model, sets, objective and settings.
        card: of the model, apart from the record of its training.
        classes: see :class:`StoredModel`.
        unchanged: tensors of the model, by name, that the training must leave as they are.
        windows: observed windows (T1, 1, N, *observed) of the data: where their z_a lie is kept for refinement.
        checked: observed windows of the validation set: their misfits are kept, for alarms.
    """

    trainer: Trainer
    card: ModelCard
    classes: Mapping[str, Callable] = field(default_factory=dict)
    unchanged: Mapping[str, Tensor] = field(default_factory=dict)
    windows: Tensor | None = None
    checked: Tensor | None = None

    def run(self, log: Any = None, checkpoint: Any = None) -> StoredModel:
        """Train to the end; the best state of each seed, by validation.

        Arguments:
            log: a RunLog, or None: nothing is written.
            checkpoint: a Checkpoint, or None: nothing is written.

        Raises:
            SolveError: a seed cannot be trained.
        """
        trainer, memory = self.trainer, Record()
        trainer.run(log or memory, checkpoint or memory)  # type: ignore[arg-type]
        model = trainer.model
        model.load_state_dict(trainer.best)
        for key, value in self.unchanged.items():
            if not torch.equal(model.state_dict()[key], value):
                raise RuntimeError(f"{trainer.name}: fine-tuning changed {key}, which is frozen")
        record = {
            "wall_s": trainer.seconds,
            "best_score": [s if math.isfinite(s) else None for s in trainer.best_score.tolist()],
            "best_epoch": trainer.best_epoch.tolist(),
            "carried": trainer.objective.carried(),
            "failed": sorted(trainer.failed),
        }
        if self.windows is not None:
            record["latent"] = latent_of(model, self.windows, len(trainer.seeds))
        stored = StoredModel(model, self.card.but(**record), self.classes)
        if self.checked is not None:
            record["misfit"] = record_residuals(stored, self.checked)
        return replace(stored, card=self.card.but(**record))


def prepare(
    model: HybridNet,
    sets: Callable[[int], tuple[StackedSet | Callable[[int], StackedSet], list]],
    task: Task,
    card: ModelCard,
    options: TrainOptions | FinetuneJob,
    classes: Mapping[str, Callable],
    unchanged: Mapping[str, Tensor] | None = None,
    windows: Tensor | None = None,
    checked: Tensor | None = None,
) -> Training:
    """Make the training of a described model.

    Arguments:
        sets: number of points needed → training set (or a function from the pass to one) and validation sets.
        options: how to train.
        windows, checked: see :class:`Training`.

    Raises:
        InputError: an unknown option, or an objective without the prior that it needs.
    """
    seeds, keep = options.seeds, options.snapshots if isinstance(options, TrainOptions) else ()
    train_set, validation = sets(task.points(options.choices))
    objective = make_objective(objective_of(card.objective, classes), seeds, options)
    name = f"{card.experiment}/{card.label} seeds {','.join(map(str, seeds))}"
    failed = dict.fromkeys(card.failed or (), "it failed in the training before")
    trainer = Trainer(model, objective, task, train_set, validation, seeds, options.training, name, keep, failed)
    return Training(trainer, card, classes, unchanged or {}, windows, checked)


@torch.no_grad()
def latent_of(model: HybridNet, windows: Tensor, seeds: int) -> LatentRecord:
    """Mean and standard deviation of z_a (S, Q) over the windows (T1, 1, N, *observed), and the first principal axes
    (S, C, Q) of a z_a of several components."""
    parts = [
        model.encode(part.expand(-1, seeds, *part.shape[2:])).z_a.mean for part in windows.split(LATENT_PART, dim=2)
    ]
    z_a = torch.cat(parts, dim=1).double().nan_to_num(0.0, 0.0, 0.0)
    mean, std = moments(z_a)
    axes = [principal_axes(one, AXES).tolist() for one in z_a] if z_a.shape[-1] > 1 else None
    known = {"mean": mean.tolist(), "std": std.tolist()}
    return LatentRecord.of(**known if axes is None else known | {"axes": axes})


def moments(z_a: Tensor) -> tuple[Tensor, Tensor]:
    """Mean and standard deviation of z_a (S, N, Q) over samples."""
    mean = z_a.mean(1)
    return mean, z_a.std(1, correction=0) if mean.numel() else mean  # torch warns of the spread of nothing


def make_objective(kind: type[Objective], seeds: Sequence[int], options: TrainOptions | FinetuneJob) -> Objective:
    """The objective of a training of these seeds.

    Raises:
        InputError: the prior that it needs is missing, or an option is unknown.
    """
    arguments, named = dict(options.training.objective or {}), inspect.signature(kind).parameters
    given = {"prior": options.prior} if "prior" in named else {}
    if given and not isinstance(options.prior, Mapping):
        raise InputError("prior", f"missing, {kind.__name__} needs it", "give a range [low, high] by parameter")
    try:
        inspect.signature(kind).bind(seeds, options.choices, **given, **arguments)
    except TypeError as error:
        raise InputError("training.objective", f"{kind.__name__}: {error}", "give what its constructor needs") from None
    return kind(seeds, options.choices, **given, **arguments)

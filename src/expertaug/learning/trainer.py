"""Training a group of seeds as one batched computation."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, fields, replace

import torch
from torch import Tensor

from expertaug.errors import InputError, SolveError
from expertaug.learning.checkpoint import Checkpoint
from expertaug.learning.objectives import Objective, mean_squared_error
from expertaug.learning.sets import Batch, StackedSet
from expertaug.learning.task import Task
from expertaug.models.hybrid import HybridModel
from expertaug.tracking.runlog import RunLog

logger = logging.getLogger(__name__)
PROGRESS_S = 10.0
FLUSH_S = 5.0
SKIPPED_LIMIT = 50


@dataclass(frozen=True)
class TrainSettings:
    """How to train; one block for training and one for fine-tuning.

    Attributes:
        epochs: passes over the training set.
        batch_size: samples of each seed in a step.
        learning_rate: its peak; ``schedule`` one_cycle warms up linearly over the share ``warmup`` of all steps and
            decays by a cosine to zero, constant stays.
        clip_norm: largest norm of a seed's gradient; null for none.
        validate_every: passes between validations.
        validation_samples: at most so many validation samples, evenly spread; null for all.
        checkpoint_s: least seconds between two checkpoints.
        supervision_weight: of the z_e term in fine-tuning.
        horizon_warmup: share of all steps over which the loss window grows from its first points to its full length;
            a long window from the start has minima at wrong frequencies.
    """

    epochs: int = 50
    batch_size: int = 100
    learning_rate: float = 5e-4
    schedule: str = "one_cycle"
    warmup: float = 0.1
    clip_norm: float | None = 1.0
    validate_every: int = 1
    validation_samples: int | None = None
    checkpoint_s: float = 30.0
    supervision_weight: float = 1.0
    horizon_warmup: float = 0.0

    @classmethod
    def from_mapping(cls, settings: Mapping) -> TrainSettings:
        """Take the trainer's keys out of a training block and refuse what nobody knows."""
        known = {f.name for f in fields(cls)} | {"objective", "solver", "horizon_s"}
        for key in settings:
            if key not in known:
                raise InputError(f"training.{key}", "unknown", f"known: {', '.join(sorted(known))}")
        return cls(**{k: v for k, v in settings.items() if k in cls.__dataclass_fields__})

    def rate(self, step: int, steps: int) -> float:
        """Learning rate of step ``step`` of ``steps``."""
        if self.schedule == "constant":
            return self.learning_rate
        warm = max(self.warmup * steps, 1)
        if step < warm:
            return self.learning_rate * (step + 1) / warm
        return self.learning_rate * 0.5 * (1 + math.cos(math.pi * (step - warm) / max(steps - warm, 1)))

    def points(self, horizon: int, step: int, steps: int) -> int:
        """Points of the loss window in step ``step`` of ``steps``, ``horizon`` at the end."""
        growing = self.horizon_warmup * steps
        return horizon if step + 1 >= growing else max(2, math.ceil(horizon * (step + 1) / growing))


class Trainer:
    """Adam over stacked parameters: every seed has its own data order, optimiser state, loss and best model.

    A seed sees the same batches alone and in any group; its numbers agree to float rounding only, since how many seeds
    are multiplied at a time changes the order of sums.

    Arguments:
        model: stacked (:func:`expertaug.models.hybrid.stack`); parameters that need no gradient stay as they are.
        objective: its loss is summed over seeds, which share nothing else.
        task: of training.
        train: the training set, or a function from the pass's number to that pass's set of the same size.
        validation: sets and point ranges (first, last + 1) whose mean log-MSE selects each seed's best model.
        seeds: in the group's order.
        settings: how to train.
        name: for messages.
        keep: passes after which the model's state is kept in ``snapshots``.
    """

    def __init__(
        self,
        model: HybridModel,
        objective: Objective,
        task: Task,
        train: StackedSet | Callable[[int], StackedSet],
        validation: Iterable[tuple[StackedSet, range]],
        seeds: list[int],
        settings: TrainSettings,
        name: str,
        keep: Collection[int] = (),
    ) -> None:
        self.model, self.objective, self.task = model, objective, task
        self.sets = train if callable(train) else lambda epoch: train
        self.validation = [
            (s.subset(settings.validation_samples).whole(len(seeds)), points) for s, points in validation
        ]
        self.seeds, self.settings, self.name = list(seeds), settings, name
        self.parameters = [p for p in model.parameters() if p.requires_grad]
        self.optimiser = torch.optim.Adam(self.parameters, lr=settings.learning_rate)
        self.best = {k: v.detach().clone() for k, v in model.state_dict().items()}
        self.best_score = torch.full((len(seeds),), math.inf)
        self.best_epoch = torch.zeros(len(seeds), dtype=torch.long)
        self.epoch, self.seconds = 0, 0.0
        self.keep, self.snapshots = keep, {}
        self.skipped = torch.zeros(len(seeds), dtype=torch.long)

    def step(self, batch: Batch, step: int, steps: int) -> dict[str, Tensor]:
        """Update number ``step`` of ``steps``, of every seed; returns the loss's parts, each (S,)."""
        window = self.objective.window(self.task)
        if step == 0:
            self.objective.begin(self.model, batch, replace(self.task, horizon=window))
        points = self.settings.points(window, step, steps)
        loss, parts = self.objective.loss(self.model, batch, replace(self.task, horizon=points))
        self.optimiser.zero_grad(set_to_none=True)
        loss.sum().backward()
        self._tame()
        for group in self.optimiser.param_groups:
            group["lr"] = self.settings.rate(step, steps)
        self.optimiser.step()
        return parts

    def _tame(self) -> None:
        """Clip each seed's gradient by its own norm; a seed whose gradient is not finite sits this step out."""
        gradients = [p.grad for p in self.parameters if p.grad is not None]
        norm = torch.stack([g.flatten(1).square().sum(1) for g in gradients]).sum(0).sqrt()
        good = torch.isfinite(norm)
        limit = self.settings.clip_norm or math.inf
        factor = torch.where(good, (limit / norm.clamp_min(1e-12)).clamp_max(1.0), torch.zeros_like(norm))
        for g in gradients:
            if not good.all():
                g.nan_to_num_(0.0, 0.0, 0.0)
            g.mul_(factor.view(-1, *[1] * (g.dim() - 1)))
        self.skipped = torch.where(good.cpu(), 0, self.skipped + 1)
        if (self.skipped > SKIPPED_LIMIT).any():
            seed = self.seeds[int(self.skipped.argmax())]
            raise SolveError(
                f"{self.name}, seed {seed}: the gradient was not finite in {SKIPPED_LIMIT} steps in a row; "
                "lower training.learning_rate or clip_norm"
            )

    @torch.no_grad()
    def score(self) -> Tensor:
        """Validation score (S,): mean over the sets of the log mean squared error; infinite where not finite."""
        scores = []
        for batch, points in self.validation:
            z_e, z_a = self.model.encode(batch.y[: self.task.observed]).mean
            prediction = self.model.forecast(batch.y[0], z_e, z_a, self.task.t[: points.stop], self.task.solver)
            error = mean_squared_error(
                self.model.system, prediction[points.start :], batch.y[points.start : points.stop]
            )
            scores.append(torch.log(error))
        return torch.stack(scores).mean(0).nan_to_num(math.inf, math.inf).cpu()

    def run(self, log: RunLog, checkpoint: Checkpoint) -> None:
        """Train to the end, from the checkpoint's state if it has one; the best models are then in ``best``."""
        settings, per_pass = self.settings, self.sets(self.epoch).steps(self.settings.batch_size)
        steps, told = settings.epochs * per_pass, 0.0
        saved = flushed = time.monotonic()
        while self.epoch < settings.epochs:
            begun = time.monotonic()
            for number, batch in enumerate(self.sets(self.epoch).batches(self.seeds, self.epoch, settings.batch_size)):
                step = self.epoch * per_pass + number
                parts = self.step(batch, step, steps)
                if time.monotonic() - told > PROGRESS_S:
                    told = time.monotonic()
                    self._progress(step + 1, steps, parts, told - begun)
            self.objective.end_of_pass()
            self.epoch += 1
            record = {k: v.tolist() for k, v in parts.items()} | {
                "learning_rate": [settings.rate(step, steps)] * len(self.seeds)
            }
            if self.epoch % settings.validate_every == 0 or self.epoch == settings.epochs:
                record["validation_score"] = self._select().tolist()
            log.metrics(step + 1, record)
            self.seconds += time.monotonic() - begun
            if self.epoch in self.keep:
                kept = {k: v.detach().clone() for k, v in self.model.state_dict().items()}
                record = {"carried": self.objective.carried(), "wall_s": self.seconds}
                self.snapshots[self.epoch] = record | {"model": kept}
            if time.monotonic() - flushed > FLUSH_S:
                log.flush()
                flushed = time.monotonic()
            if time.monotonic() - saved > settings.checkpoint_s and self.epoch < settings.epochs:
                checkpoint.save(self.state() | {"log": log.state()})
                saved = time.monotonic()
        self._progress(steps, steps, parts, 0.0)
        if not torch.isfinite(self.best_score).all():
            bad = [s for s, b in zip(self.seeds, self.best_score.tolist(), strict=True) if not math.isfinite(b)]
            raise SolveError(
                f"{self.name}: no validation forecast was finite for seeds {bad}; lower training.learning_rate"
            )

    def _select(self) -> Tensor:
        score = self.score()
        better = score < self.best_score
        self.best_score = torch.where(better, score, self.best_score)
        self.best_epoch = torch.where(better, self.epoch, self.best_epoch)
        for key, value in self.model.state_dict().items():
            mask = better.to(value.device).view(-1, *[1] * (value.dim() - 1))
            self.best[key] = torch.where(mask, value, self.best[key])
        return score

    def _progress(self, step: int, steps: int, parts: Mapping[str, Tensor], running: float) -> None:
        seconds = self.seconds + running
        left = seconds / step * (steps - step)
        best = "–" if not torch.isfinite(self.best_score).any() else f"{self.best_score.mean():.2f}"
        logger.info(
            "%s: step %d/%d, loss %.4g, best validation log-MSE %s, %d s gone, %d s left",
            self.name, step, steps, parts["loss"].mean(), best, seconds, left,
        )  # fmt: skip

    def state(self) -> dict:
        """Everything that a resumed run needs to reach the same bits; data orders follow from seed and epoch."""
        return {
            "model": self.model.state_dict(),
            "optimiser": self.optimiser.state_dict(),
            "objective": self.objective.state(),
            "best": self.best,
            "best_score": self.best_score,
            "best_epoch": self.best_epoch,
            "epoch": self.epoch,
            "seconds": self.seconds,
            "skipped": self.skipped,
            "snapshots": self.snapshots,
        }

    def restore(self, state: Mapping) -> None:
        """Take up what :meth:`state` gave."""
        self.model.load_state_dict(state["model"])
        self.optimiser.load_state_dict(state["optimiser"])
        self.objective.restore(state["objective"])
        for name in ("best", "best_score", "best_epoch", "epoch", "seconds", "skipped", "snapshots"):
            setattr(self, name, state[name])

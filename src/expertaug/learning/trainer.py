"""Training a group of seeds as one batched computation, in memory."""

from __future__ import annotations

import copy
import inspect
import logging
import math
import time
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

import torch
from torch import Tensor

from expertaug import registry
from expertaug.errors import InputError, SolveError
from expertaug.learning.check_parts import check_loss
from expertaug.learning.divergence import clamp_to_bound, forecast_or_fallback, within_bound
from expertaug.learning.objectives import Objective
from expertaug.learning.optimiser import Adam, clip_each_seed
from expertaug.learning.residuals import mean_squared_error, record_residuals
from expertaug.learning.settings import OBJECTIVE, FinetuneOptions, TrainOptions, TrainSettings, objective_of
from expertaug.learning.snapshots import Snapshot
from expertaug.learning.training_data import Batch, StackedSet, Task
from expertaug.models.card import LatentRecord, ModelCard
from expertaug.models.hybrid import HybridNet
from expertaug.models.posterior import principal_axes
from expertaug.models.settings import AXES
from expertaug.models.store import StoredModel
from expertaug.models.support import support_of
from expertaug.windows import Windows
from expertaug.wording import check_keys

logger = logging.getLogger(__name__)
PROGRESS_S = 10.0
FLUSH_S = 5.0
SKIPPED_LIMIT = 50
DIVERGED = 0.2  # share of training samples above which a warning tells that they diverge
LATENT_PART, LATENT_BYTES = 1000, 2**24  # windows that are encoded at a time, and bytes of those of fields
# Of a running training: tensors, numbers, text, and lists and dicts of them.
State: TypeAlias = dict[str, Any]


class Progress:
    """What a training tells while it runs, and whence it goes on; this one listens to nothing and begins afresh."""

    def begin(self, card: ModelCard) -> State | None:
        """The state of a killed run of the training of a card, to go on from; None to begin afresh."""
        return None

    def metrics(self, step: int, values: Mapping[str, list[float]]) -> None:
        """A step: values by metric, one a seed."""

    def event(self, name: str, **values: object) -> None:
        """What happened, and to what; what failed is warned of too, and stands on the model's card."""

    def flush(self) -> None:
        """Bring to a disk what was told."""

    def save(self, state: State) -> None:
        """A state to go on from."""

    def snapshots(self, snapshots: Mapping[int, Snapshot]) -> None:
        """States of the passes after which they were asked for, once all passes are done."""


class History(Progress):
    """Keeps the metrics in memory.

    Attributes:
        lines: (step, values by metric, one a seed), in order.
    """

    def __init__(self) -> None:
        self.lines: list[tuple[int, dict[str, list[float]]]] = []

    def metrics(self, step: int, values: Mapping[str, list[float]]) -> None:
        self.lines.append((step, dict(values)))


class Trainer:
    """Adam over stacked parameters: every seed has its own data order, optimiser state, loss and best model.

    A seed sees the same batches alone and in any group; its numbers agree to float rounding only, for how many seeds
    are multiplied at a time changes the order of sums.

    Arguments:
        model: stacked (:func:`expertaug.models.stacking.stack`); parameters that need no gradient stay as they are.
        objective: its loss is summed over seeds, which share nothing else.
        task: of training.
        train: the training set, or a function from the pass's number to that pass's set of the same size.
        validation: sets and point ranges (first, last + 1) whose mean log-MSE selects each seed's best model.
        seeds: in the group's order.
        settings: how to train.
        name: for messages.
        keep: passes after which the model's state is kept in ``snapshots``.
        failed: seeds that could not be trained before, with the reasons.

    Attributes:
        SCORE: what :meth:`score` gives, for messages.
        failed: seeds that cannot be trained, with the reasons; the others go on without them.
    """

    SCORE = "selection score"

    def __init__(
        self,
        model: HybridNet,
        objective: Objective,
        task: Task,
        train: StackedSet | Callable[[int], StackedSet],
        validation: Iterable[tuple[StackedSet, range]],
        seeds: list[int],
        settings: TrainSettings,
        name: str,
        keep: Collection[int] = (),
        failed: Mapping[int, str] | None = None,
    ) -> None:
        self.model, self.objective, self.task = model.train(), objective, task
        self.sets = train if callable(train) else lambda epoch: train
        self.validation = [
            (s.subset(settings.validation_samples).whole(len(seeds)), points) for s, points in validation
        ]
        self.seeds, self.settings, self.name = list(seeds), settings, name
        self.parameters = [p for p in model.parameters() if p.requires_grad]
        self.optimiser = Adam(self.parameters, lr=settings.learning_rate)
        self.best = {k: v.detach().clone() for k, v in model.state_dict().items()}
        self.best_score = torch.full((len(seeds),), math.inf)
        self.best_epoch = torch.zeros(len(seeds), dtype=torch.long)
        self.epoch, self.seconds = 0, 0.0
        self.keep: Collection[int] = keep
        self.snapshots: dict[int, Snapshot] = {}
        self.skipped = torch.zeros(len(seeds), dtype=torch.long)
        self.failed = dict(failed or {})

    def step(self, batch: Batch, step: int, steps: int) -> dict[str, Tensor]:
        """Update number ``step`` of ``steps``, of every seed; returns the loss's parts, each (S,)."""
        window = self.objective.window(self.task)
        if step == 0:
            self.objective.begin(self.model, batch, replace(self.task, horizon=window))
        task = replace(self.task, horizon=self.settings.points(window, step, steps))
        with self.model.decoder.expert_alone() if self.settings.alone(step, steps) else nullcontext():
            parts, good = self._gradients(batch, task)
        self._count_skipped(good)
        for group in self.optimiser.param_groups:
            group["lr"] = self.settings.rate(step, steps)
        self.optimiser.step()
        return parts

    def _gradients(self, batch: Batch, task: Task) -> tuple[dict[str, Tensor], Tensor]:
        """The loss's parts, and which seeds (S,) have gradients, clipped, that can be used.

        Elsewhere than on the CPU nothing waits for the device before the last gradient: forecasts are taken to stay
        within the bound, and where one did not, all is done again from what was before.
        """
        if self.parameters[0].device.type != "cpu":
            kept = copy.deepcopy(self.objective.state())
            buffers = {name: value.clone() for name, value in self.model.named_buffers()}
            doubts: list[Tensor] = []
            parts, good = self._backward(batch, replace(task, doubts=doubts))
            if good is not None:
                return parts, good
            self.objective.restore(kept)
            for name, value in self.model.named_buffers():
                value.copy_(buffers[name])
        parts, good = self._backward(batch, task)
        assert good is not None, "no doubts"
        return parts, good

    def _backward(self, batch: Batch, task: Task) -> tuple[dict[str, Tensor], Tensor | None]:
        """The loss's parts and gradients; of the latter what :func:`clip_each_seed` says."""
        loss, parts = self.objective.loss(self.model, batch, task)
        self.optimiser.zero_grad(set_to_none=True)
        check_loss(self.objective, loss, len(self.seeds)).sum().backward()
        return parts, clip_each_seed(self.parameters, self.settings.clip_norm, self._alive(), task.doubts or ())

    def _count_skipped(self, good: Tensor) -> None:
        """A seed that is not ``good`` (S,), its gradient not being finite, sits this step out."""
        self.skipped = torch.where(good, 0, self.skipped + 1)
        reason = f"the gradient was not finite in {SKIPPED_LIMIT} steps in a row"
        self._fail(self.skipped > SKIPPED_LIMIT, f"{reason}; lower training.learning_rate or clip_norm")

    def _alive(self) -> Tensor:
        """Which seeds (S,) have not failed."""
        return torch.tensor([seed not in self.failed for seed in self.seeds])

    def _fail(self, which: Tensor, reason: str) -> None:
        """Leave out the seeds ``which`` (S,): they keep their best state, and the others go on.

        Raises:
            SolveError: no seed is left.
        """
        which = which & self._alive()
        if not which.any():
            return
        new = [seed for seed, bad in zip(self.seeds, which.tolist(), strict=True) if bad]
        self.failed |= dict.fromkeys(new, reason)
        if len(self.failed) == len(self.seeds):
            listed = f"seed{'s' if len(self.seeds) > 1 else ''} {', '.join(map(str, self.seeds))}"
            raise SolveError(f"{self.name}, {listed}: {reason}")
        for seed in new:
            logger.warning("%s: seed %d cannot be trained and is left out: %s", self.name, seed, reason)
        with torch.no_grad():
            for key, value in self.model.state_dict().items():
                value.copy_(_choose(which, self.best[key], value))

    @torch.no_grad()
    def score(self) -> Tensor:
        """Validation score (S,): mean over the sets of the log mean squared error; infinite where not finite.

        A forecast that leaves the task's bound has the error that it would have there.
        """
        scores = []
        for batch, points in self.validation:
            window = batch.windows(self.task.observed)
            z_e, z_a = self.model.encode(window).mean
            t, u = self.task.t[: points.stop], batch.inputs(points.stop)
            prediction = forecast_or_fallback(self.model, self.model.start(window), z_e, z_a, t, self.task.solver, u)
            if not within_bound(prediction, self.task.bound).all():
                prediction = clamp_to_bound(prediction, self.task.bound)
            error = mean_squared_error(
                self.model.system, prediction[points.start :], batch.y[points.start : points.stop]
            )
            scores.append(torch.log(error))
        return torch.stack(scores).mean(0).nan_to_num(math.inf, math.inf).cpu()

    def run(self, progress: Progress) -> None:
        """Train to the end; the best models are then in ``best``."""
        settings, per_pass = self.settings, self.sets(self.epoch).steps(self.settings.batch_size)
        steps, progress_told = settings.epochs * per_pass, 0.0
        saved = flushed = time.monotonic()
        told_of = set(self.failed) if self.epoch else set()  # a resumed log has them
        while self.epoch < settings.epochs:
            begun = time.monotonic()
            for number, batch in enumerate(self.sets(self.epoch).batches(self.seeds, self.epoch, settings.batch_size)):
                step = self.epoch * per_pass + number
                parts = self.step(batch, step, steps)
                told_of = self._tell_failures(progress, told_of)
                if time.monotonic() - progress_told > PROGRESS_S:
                    progress_told = time.monotonic()
                    self._progress(step + 1, steps, parts, progress_told - begun)
            self.objective.end_of_pass()
            self.epoch += 1
            record = {k: v.tolist() for k, v in parts.items()} | {
                "learning_rate": [settings.rate(step, steps)] * len(self.seeds)
            }
            if self.epoch % settings.validate_every == 0 or self.epoch == settings.epochs:
                record["validation_score"] = self._select().tolist()
            progress.metrics(step + 1, record)
            self.seconds += time.monotonic() - begun
            if self.epoch in self.keep:
                kept = {k: v.detach().clone() for k, v in self.model.state_dict().items()}
                carried = self.objective.carried()
                self.snapshots[self.epoch] = {"carried": carried, "wall_s": self.seconds, "model": kept}
            if time.monotonic() - flushed > FLUSH_S:
                progress.flush()
                flushed = time.monotonic()
            if time.monotonic() - saved > settings.checkpoint_s and self.epoch < settings.epochs:
                progress.save(self.state())
                saved = time.monotonic()
        self._progress(steps, steps, parts, 0.0)
        self._warn_of_divergence(parts.get("runaway_share"))
        reason = "no validation forecast had a finite error; lower training.learning_rate"
        self._fail(~torch.isfinite(self.best_score), reason)
        self._tell_failures(progress, told_of)

    def _warn_of_divergence(self, share: Tensor | None) -> None:
        """Of what a last step left out of its loss: what is learned of the others says little."""
        for seed, diverged in zip(self.seeds, [] if share is None else share.tolist(), strict=False):
            if diverged > DIVERGED and seed not in self.failed:
                text = "%s: seed %d: %.0f %% of the last training samples diverge: give first values of what nobody "
                text += "measured (data.start), a shorter horizon_s, or a lower learning rate"
                logger.warning(text, self.name, seed, 100 * diverged)

    def _tell_failures(self, progress: Progress, told_of: set[int]) -> set[int]:
        for seed in sorted(self.failed.keys() - told_of):
            progress.event("seed_failed", seed=seed, reason=self.failed[seed])
        return set(self.failed)

    def _select(self) -> Tensor:
        score = self.score()
        better = (score < self.best_score) & self._alive()
        self.best_score = torch.where(better, score, self.best_score)
        self.best_epoch = torch.where(better, self.epoch, self.best_epoch)
        for key, value in self.model.state_dict().items():
            self.best[key] = _choose(better, value, self.best[key])
        return score

    def _progress(self, step: int, steps: int, parts: Mapping[str, Tensor], running: float) -> None:
        seconds = self.seconds + running
        left = seconds / step * (steps - step)
        scores = self.best_score[torch.isfinite(self.best_score)]
        best = f"{scores.mean():.2f}" if len(scores) else "–"
        logger.info(
            "%s: step %d/%d, loss %.4g, best %s %s, %d s gone, %d s left",
            self.name, step, steps, parts["loss"].mean(), self.SCORE, best, seconds, left,
        )  # fmt: skip

    def state(self) -> State:
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
            "failed": self.failed,
            "snapshots": self.snapshots,
        }

    def restore(self, state: State) -> None:
        """Take up what :meth:`state` gave."""
        self.model.load_state_dict(state["model"])
        self.optimiser.load_state_dict(state["optimiser"])
        self.objective.restore(state["objective"])
        for name in ("best", "best_score", "best_epoch", "epoch", "seconds", "skipped", "failed", "snapshots"):
            setattr(self, name, state[name])

    def late_seeds(self) -> list[int]:
        """Places of the seeds whose best state is more than ``restart_gap`` behind the best of the group's."""
        behind = self.best_score - self.best_score.min()
        return [place for place, gap in enumerate(behind.tolist()) if not gap <= self.settings.restart_gap]

    def adopt(self, places: Sequence[int], other: Trainer) -> list[int]:
        """Of another trainer, which has begun some of the seeds anew, the best states where they are better; at which
        places these are."""
        adopted = []
        for number, place in enumerate(places):
            if not other.best_score[number] < self.best_score[place]:
                continue
            for name, value in self.best.items():
                value[place] = other.best[name][number]
            self.best_score[place], self.best_epoch[place] = other.best_score[number], other.best_epoch[number]
            self.failed.pop(self.seeds[place], None)
            adopted.append(place)
        return adopted


def _choose(which: Tensor, first: Tensor, second: Tensor) -> Tensor:
    """For each seed ``which`` (S,) its part of the first stacked tensor, for the others of the second."""
    return torch.where(which.to(first.device).view(-1, *[1] * (first.dim() - 1)), first, second)


@dataclass
class Restarts:
    """Seeds whose training has failed are begun anew: from other first weights, in another order of the data.

    Some first weights lead to minima that are told from good ones only beside other seeds.  A seed is begun anew where
    it is more than ``restart_gap`` behind the best of its group, and its better state is kept.

    Attributes:
        trainer: of the group; its best states become those of the restarts, where they are better.
        counts: how often each seed has been begun anew.
        carried: what the objectives of the best states carry.
        seconds: of all trainings together.
        running: state of a restart that was killed.
    """

    trainer: Trainer
    counts: list[int]
    carried: dict[str, Any]
    seconds: float
    running: State | None = None

    @classmethod
    def of(cls, trainer: Trainer, state: State | None) -> Restarts:
        """Of a group whose training has ended; ``state`` is that of restarts that were killed."""
        if state is not None:
            return cls(trainer, **state)
        return cls(trainer, [0] * len(trainer.seeds), trainer.objective.carried(), trainer.seconds)

    def run(self, again: Callable[[Sequence[int], int], Training], progress: Progress) -> None:
        """Begin anew what is behind, at most ``restarts`` times."""
        trainer, most = self.trainer, self.trainer.settings.restarts
        while (late := trainer.late_seeds()) and max(self.counts) < most:
            number = max(self.counts) + 1
            other = again(late, number).trainer
            if self.running is None:
                for place in late:
                    seed, gap = trainer.seeds[place], float(trainer.best_score[place] - trainer.best_score.min())
                    text = "%s: seed %d is %.2f behind the best seed and is begun anew (%d of at most %d times)"
                    logger.info(text, trainer.name, seed, gap, number, most)
                progress.save(self.state(None))
            else:
                other.restore(self.running)
                self.running = None
            try:
                other.run(_Restarting(self, progress))
            except SolveError as error:
                logger.warning("%s", error)
            before, adopted = trainer.best_score.tolist(), trainer.adopt(late, other)
            carried = other.objective.carried()
            for number_there, place in enumerate(late):
                self.counts[place] = number
                scores = {"before": before[place], "after": float(other.best_score[number_there])}
                finite = {name: score if math.isfinite(score) else None for name, score in scores.items()}
                progress.event("seed_restarted", seed=trainer.seeds[place], kept=place in adopted, **finite)
                for name in self.carried if place in adopted else ():
                    if isinstance(self.carried[name], list) and len(self.carried[name]) == len(trainer.seeds):
                        self.carried[name][place] = carried[name][number_there]
            self.seconds += other.seconds
        steps = trainer.sets(0).steps(trainer.settings.batch_size) * trainer.settings.epochs
        progress.metrics(steps, {"restarts": [float(count) for count in self.counts]})

    def state(self, running: State | None) -> State:
        """What a killed run goes on from, at a restart's beginning or at a state of it."""
        restarting = {"counts": self.counts, "carried": self.carried, "seconds": self.seconds, "running": running}
        return self.trainer.state() | {"restarting": restarting}


class _Restarting(Progress):
    """Of a restart: only its state is kept, within that of the group."""

    def __init__(self, restarts: Restarts, progress: Progress) -> None:
        self.restarts, self.progress = restarts, progress

    def save(self, state: State) -> None:
        self.progress.save(self.restarts.state(state))


@dataclass(frozen=True)
class Training:
    """A trainer and what will be known about the model that it gives.

    Attributes:
        trainer: with model, sets, objective and settings.
        card: of the model, apart from the record of its training.
        classes: see :class:`StoredModel`.
        unchanged: tensors of the model, by name, that the training must leave as they are.
        windows: observed windows of the data, y (T1, 1, N, *state): where their z_a lie is kept for refinement.
        checked: observed windows of the validation set: their misfits are kept, for alarms.
        again: places of seeds and a number → the same training of these seeds from other first weights, in another
            order of the data; None where seeds are not begun anew.
    """

    trainer: Trainer
    card: ModelCard
    classes: Mapping[str, Callable] = field(default_factory=dict)
    unchanged: Mapping[str, Tensor] = field(default_factory=dict)
    windows: Windows | None = None
    checked: Windows | None = None
    again: Callable[[Sequence[int], int], Training] | None = None

    def run(self, progress: Progress | None = None) -> StoredModel:
        """Train to the end, from the state at which a killed run stopped where ``progress`` has one; the best state of
        each seed, by validation.

        Raises:
            SolveError: no seed can be trained.
        """
        trainer, progress = self.trainer, progress or Progress()
        state = progress.begin(self.card)
        restarting = None if state is None else state.pop("restarting", None)
        if state is not None:
            trainer.restore(state)
        if restarting is None:
            trainer.run(progress)
        restarts = Restarts.of(trainer, restarting)
        if self.again is not None and trainer.settings.restarts:
            restarts.run(self.again, progress)
        if trainer.keep:
            progress.snapshots(trainer.snapshots)
        model = trainer.model
        model.load_state_dict(trainer.best)
        for key, value in self.unchanged.items():
            if not torch.equal(model.state_dict()[key], value):
                raise RuntimeError(f"{trainer.name}: fine-tuning changed {key}, which is frozen")
        record = {
            "wall_s": restarts.seconds,
            "best_score": [s if math.isfinite(s) else None for s in trainer.best_score.tolist()],
            "best_epoch": trainer.best_epoch.tolist(),
            "carried": restarts.carried,
            "failed": sorted(trainer.failed),
        }
        if self.again is not None and trainer.settings.restarts:
            record["restarts"] = restarts.counts
        if self.windows is not None:
            z_e, z_a = encode_all(model, self.windows, len(trainer.seeds))
            record["latent"], record["support"] = latent_of(z_a), support_of(z_e if model.knows_z_e else None, z_a)
        stored = StoredModel(model, self.card.but(**record), self.classes)
        if self.checked is not None:
            record["misfit"] = record_residuals(stored, self.checked)
        return replace(stored, card=self.card.but(**record))


def prepare_training(
    model: HybridNet,
    sets: Callable[[int], tuple[StackedSet | Callable[[int], StackedSet], list]],
    task: Task,
    card: ModelCard,
    options: TrainOptions | FinetuneOptions,
    classes: Mapping[str, Callable],
    unchanged: Mapping[str, Tensor] | None = None,
    windows: Windows | None = None,
    checked: Windows | None = None,
    again: Callable[[Sequence[int], int], Training] | None = None,
) -> Training:
    """Make the training of a described model.

    Arguments:
        sets: number of points needed → training set (or a function from the pass to one) and validation sets.
        options: how to train.
        windows, checked, again: see :class:`Training`.

    Raises:
        InputError: an unknown option, or an objective without the prior that it needs.
    """
    seeds, keep = options.seeds, options.snapshots if isinstance(options, TrainOptions) else ()
    train_set, validation = sets(task.points(options.choices))
    objective = make_objective(objective_of(card.objective, classes), seeds, options)
    name = f"{card.experiment}/{card.label} seeds {','.join(map(str, seeds))}"
    failed = dict.fromkeys(card.failed or (), "it failed in the training before")
    trainer = Trainer(model, objective, task, train_set, validation, seeds, options.training, name, keep, failed)
    return Training(trainer, card, classes, unchanged or {}, windows, checked, again)


@torch.no_grad()
def encode_all(model: HybridNet, windows: Windows, seeds: int) -> tuple[Tensor, Tensor]:
    """Posterior means z_e (S, N, P) and z_a (S, N, Q) of windows that all seeds share, y (T1, 1, N, *state)."""
    each = seeds * windows.points * windows.numbers * windows.y.element_size()
    size = min(LATENT_PART, max(1, LATENT_BYTES // each))
    parts = [model.encode(part.expand(seeds)).mean for part in windows.split(size)]
    z_e, z_a = (torch.cat([part[k] for part in parts], dim=1) for k in range(2))
    return z_e, z_a


def latent_of(z_a: Tensor) -> LatentRecord:
    """Mean and standard deviation of z_a (S, N, Q) over windows, and the first principal axes (S, C, Q) of a z_a of
    several components."""
    z_a = z_a.double().nan_to_num(0.0, 0.0, 0.0)
    mean, std = moments(z_a)
    axes = [principal_axes(of_seed, AXES).tolist() for of_seed in z_a] if z_a.shape[-1] > 1 else None
    record = {"mean": mean.tolist(), "std": std.tolist()}
    return LatentRecord.of(**record if axes is None else record | {"axes": axes})


def moments(z_a: Tensor) -> tuple[Tensor, Tensor]:
    """Mean and standard deviation of z_a (S, N, Q) over samples."""
    mean = z_a.mean(1)
    return mean, z_a.std(1, correction=0) if mean.numel() else mean  # torch warns of the spread of nothing


def make_objective(kind: type[Objective], seeds: Sequence[int], options: TrainOptions | FinetuneOptions) -> Objective:
    """The objective of a training of these seeds.

    Raises:
        InputError: the prior that it needs is missing, or an option is unknown.
    """
    arguments, named = dict(options.training.objective or {}), inspect.signature(kind).parameters
    if (taken := registry.arguments(kind)) is not None:
        own = [name for name in taken if name not in OBJECTIVE.given]
        check_keys(arguments, own, "training.objective", f"option of {kind.__name__}")
    prior = {"prior": options.prior} if "prior" in named else {}
    if prior and not isinstance(options.prior, Mapping):
        raise InputError("prior", f"missing, {kind.__name__} needs it", "give a range [low, high] by parameter")
    try:
        inspect.signature(kind).bind(seeds, options.choices, **prior, **arguments)
    except TypeError as error:
        raise InputError("training.objective", f"{kind.__name__}: {error}", "give what its constructor needs") from None
    return kind(seeds, options.choices, **prior, **arguments)

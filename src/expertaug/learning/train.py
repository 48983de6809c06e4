"""Training of a hybrid model, and the stage train."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from expertaug import systems
from expertaug.errors import InputError
from expertaug.files import read_json
from expertaug.learning.divergence import divergence_bound
from expertaug.learning.job import Job
from expertaug.learning.settings import (
    DEFAULT_OBJECTIVE,
    OBJECTIVE,
    DataOptions,
    RecipeKeys,
    TrainJob,
    TrainOptions,
    UntrainedJob,
    UntrainedOptions,
    objective_of,
)
from expertaug.learning.trainer import Progress, Training, prepare_training
from expertaug.learning.training_data import StackedSet, set_files, task_of
from expertaug.models import describe, store
from expertaug.models.card import ModelCard, RecipeRecord
from expertaug.models.estimators import Hybrid, LeastSquares, SharedHybrid, estimator
from expertaug.models.gaps import ranges_of
from expertaug.models.hybrid import HybridModel
from expertaug.models.store import device_of
from expertaug.presets import Choices
from expertaug.registry import short_name
from expertaug.settings import Range
from expertaug.systems.inputs import check_given, check_trainable
from expertaug.systems.solvers.solver import Solver
from expertaug.tracking.settings import Tracking
from expertaug.trajectories import Trajectories, points_until
from expertaug.wording import check_keys

FURTHER = 1_000_000_007  # added to a seed that is begun anew, at most three times: generators take 32 bits
# Of the options, what a model file says.
KEPT = ("experiment", "method", "label", "preset", "choices", "seeds", "training")


@dataclass(frozen=True)
class Calibration:
    """Constants of the double pendulum that the stage calibrate fitted, and those fitted together with a friction."""

    constants: Mapping[str, float]
    constants_with_friction: Mapping[str, float]
    friction: Sequence[float]

    @classmethod
    def load(cls, path: Path) -> Calibration:
        """What the stage calibrate wrote.

        Raises:
            InputError: the file has no constants.
        """
        report = read_json(path)
        if not isinstance(report, dict) or "constants" not in report or "with_friction" not in report:
            raise InputError(path, "has no constants", "make it again with calibrate")
        rubbed = report["with_friction"]
        return cls(report["constants"], rubbed["constants"], rubbed["friction"])


def run_stage(
    data: Path,
    output: Path,
    work: Path,
    settings: TrainJob | UntrainedJob,
    tracking: Tracking | None,
    calibration: Path | None = None,
) -> None:
    """Stage: train a method on ``data/train.npz`` and select on ``data/validation.npz``.

    Arguments:
        data: folder of the sets.
        output: model file.
        work: folder for checkpoints.
        settings: of the job.
        tracking: see :class:`expertaug.tracking.run_log.RunLog`.
        calibration: JSON whose ``constants`` complete the system's settings.

    Raises:
        InputError: unusable data or settings.
        SolveError: a seed cannot be trained.
    """
    inputs = set_files(data)
    described = describe_recipe(settings, None if calibration is None else Calibration.load(calibration))
    train_set, validation_set = map(Trajectories.load, inputs)
    system, build = systems.load(described.system), settings.build
    if isinstance(settings, UntrainedJob):
        stored = make_untrained(build.kind, system, train_set, settings, described, bool(build.truth))
        store.save(output, stored.model, stored.card)
        return
    recipe = describe.recipe_of(system, described)
    with Job(output, work, inputs, settings, tracking, __name__) as job:
        job.write(train(recipe, train_set, validation_set, settings, described, build.objective_kind, progress=job))


def describe_recipe(settings: RecipeKeys, calibration: Calibration | None = None) -> RecipeRecord:
    """What a file will say of the recipe of a training's settings, with a double pendulum's constants as calibrated."""
    build = settings.build
    system = settings.system | (build.system or {})
    if calibration is not None and system.get("expert") != "point_mass":
        rubbed = system.get("friction") == "calibrated"
        system["constants"] = calibration.constants_with_friction if rubbed else calibration.constants
        if rubbed:
            system["friction"] = calibration.friction
    return RecipeRecord.of(
        system=system,
        model=settings.model.to_json(),
        expert=build.has_expert,
        interaction=build.has_interaction,
        shared=settings.shared,
    )


def train(
    recipe: HybridModel,
    train_set: Trajectories,
    validation_set: Trajectories,
    options: TrainOptions,
    described: RecipeRecord,
    objective: str = DEFAULT_OBJECTIVE,
    classes: Mapping[str, Callable] | None = None,
    forecast_solver: Solver | None = None,
    progress: Progress | None = None,
) -> store.StoredModel:
    """Train a hybrid model for a group of seeds (paper, section 2); the best state of each, by validation.

    Arguments:
        progress: is told of the training while it runs.
        others: as of :func:`prepare`.

    Raises:
        InputError: as of :func:`prepare`.
        SolveError: no seed can be trained.
    """
    prepared = prepare(recipe, train_set, validation_set, options, described, objective, classes, forecast_solver)
    return prepared.run(progress)


def observed_points(t: Sequence[float], t1_s: float, choices: Choices) -> int:
    """Points of the times t that an encoder sees: those up to t1."""
    return points_until(t, t1_s) - (choices.observed_points == "exclusive")


def prepare(
    recipe: HybridModel,
    train: Trajectories,
    validation: Trajectories,
    options: TrainOptions,
    described: RecipeRecord,
    objective: str = DEFAULT_OBJECTIVE,
    classes: Mapping[str, Callable] | None = None,
    forecast_solver: Solver | None = None,
) -> Training:
    """Make the training of a hybrid model in memory.

    Arguments:
        train, validation: sets of the same times.
        options: how to train.
        described: what a file says of the recipe, as :func:`expertaug.models.describe.describe` gives it.
        objective: a kind, or a name in ``classes``.
        classes: see :class:`StoredModel`.
        forecast_solver: what to forecast with later; None: as the training's solver suggests.

    Raises:
        InputError: the sets differ in their times, lack the system's known inputs, or an option is unknown.
    """
    classes, device = classes or {}, device_of(options.device)
    if not (len(train.t) == len(validation.t) and (train.t == validation.t).all()):
        raise InputError("validation set", "has other times than the training set", "give both the same times")
    check_trainable(recipe.system)
    if options.training.bound_z_a:
        raise InputError("training.bound_z_a", "found true", "say it of fine-tuning: the trained model's z_a bound it")
    if isinstance(options.prior, Mapping):
        check_keys(options.prior, [p.name for p in recipe.system.expert_parameters], "prior", "expert parameter")
    kind = objective_of(objective, classes)
    card = ModelCard.of(
        kind=SharedHybrid.name if recipe.shared else Hybrid.name,
        **card_fields(train, recipe.system, options),
        **dict(described),
        likelihood=kind.learns_likelihood,
        stage="train",
        objective=short_name(OBJECTIVE, objective),
        forecast_solver=forecast_solver or store.forecast_solver(options.training.solver, recipe.system),
    )
    observed = card.observed
    times = torch.tensor(card.t[:observed], dtype=torch.float64)
    model = recipe.build(times, options.seeds, kind.learns_likelihood, card.start).to(device)
    task = task_of(options.training, card, device)
    needed = max(observed, task.points(options.choices))
    train_set, validation_set = StackedSet.of(train, device, needed), StackedSet.of(validation, device)
    for name, part in (("training set", train_set), ("validation set", validation_set)):
        check_given(recipe.system, part.u, name)
    windows = train_set.windows(observed)
    model.fit(windows.seed(0))

    def again(places: Sequence[int], number: int) -> Training:
        changed = _begin_anew(options, places, number)
        return prepare(recipe, train, validation, changed, described, objective, classes, forecast_solver)

    return prepare_training(
        model,
        lambda points: (train_set.window(points), [(validation_set, task.selection(options.choices))]),
        task,
        card,
        options,
        classes,
        windows=windows,
        checked=validation_set.windows(observed),
        again=again,
    )


def _begin_anew(options: TrainOptions, places: Sequence[int], number: int) -> TrainOptions:
    """Options of some of the group's seeds, with other random numbers than any seed has."""
    seeds, training = [options.seeds[place] + number * FURTHER for place in places], options.training
    own = dict(training.objective or {})
    for name, value in own.items():
        if isinstance(value, list | tuple) and len(value) == len(options.seeds):  # one for each seed
            own[name] = [value[place] for place in places]
    if own:
        training = training.model_copy(update={"objective": own})
    return options.model_copy(update={"seeds": seeds, "training": training, "snapshots": []})


def make_untrained(
    kind: str,
    system: systems.System,
    train: Trajectories,
    options: UntrainedOptions,
    described: RecipeRecord,
    truth: bool = False,
) -> store.StoredModel:
    """The model of a kind that no gradient step trains.

    Arguments:
        kind: its name (:mod:`expertaug.models.estimators`).
        options: how windows are fitted, where they are.
        described: as of :func:`prepare`.
        truth: whether the equation that made the data takes the expert's place.

    Raises:
        InputError: the kind needs a training, or there is no such equation.
    """
    card = ModelCard.of(
        kind=kind,
        **card_fields(train, system, options),
        **dict(described),
        **({} if options.refinement is None else {"refinement": options.refinement}),
        wall_s=0.0,
        best_score=None,
    )
    return store.StoredModel(*estimator(kind, "build.kind").fit(system, train, card, truth))


def make_expert_alone(
    system: systems.System, train: Trajectories, options: UntrainedOptions, described: RecipeRecord, truth: bool = False
) -> store.StoredModel:
    """The decoder of the expert alone, whose estimates are to be found by least squares; as :func:`make_untrained`."""
    return make_untrained(LeastSquares.name, system, train, options, described, truth)


def _first_values(train: Trajectories, system: systems.System, start: Mapping[str, Range]) -> dict[str, list[float]]:
    """The range of each component of first points, in the state's order."""
    axes, names = (0, 1, *range(3, train.y.ndim)), [p.name for p in system.state]
    y = train.seen
    low = np.where(np.isnan(y), np.inf, y).min(axes).astype(float)
    high = np.where(np.isnan(y), -np.inf, y).max(axes).astype(float)
    ranges = ranges_of(names, low.tolist(), high.tolist(), start)
    if missing := [name for name in names if name not in ranges]:
        remedy = "give the range [low, high] in which its first value lies (data.start)"
        raise InputError(f"start.{missing[0]}", "missing, nobody measured it", remedy)
    return {name: ranges[name] for name in names}


def card_fields(train: Trajectories, system: systems.System, options: DataOptions) -> dict:
    """What a card says of data and options.

    Raises:
        InputError: a component that nobody measured has no range, or a range is of no component.
    """
    t = [float(v) for v in train.t]
    observed = observed_points(t, options.t1_s, options.choices)
    kept = options.model_dump(include=set(KEPT))
    check_keys(options.start, [p.name for p in system.state], "start", "component of the state")
    start = None if train.mask is None else _first_values(train, system, options.start)
    return {
        "t": t,
        "observed": observed,
        "observed_s": t[max(observed, 1) - 1],
        "bound": divergence_bound(train.y, start),
        **({"start": start} if start is not None else {}),
        **({"data_noise": train.noise.tolist()} if train.noise is not None else {}),
        **kept,
    }

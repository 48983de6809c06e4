"""Training of a hybrid model, and the stage train."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import torch

from expertaug import systems
from expertaug.errors import InputError
from expertaug.files import read_json
from expertaug.learning import fitting, job
from expertaug.learning.divergence import divergence_bound
from expertaug.learning.fitting import Training
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
from expertaug.learning.training_data import StackedSet, task_of
from expertaug.models import describe, store
from expertaug.models.card import ModelCard, RecipeRecord
from expertaug.models.decoder import Decoder, MeanModel, TruthDecoder
from expertaug.models.gaps import ranges_of
from expertaug.models.hybrid import HybridModel
from expertaug.models.store import device_of
from expertaug.presets import Choices
from expertaug.registry import short_name
from expertaug.systems.inputs import check_given, check_trainable
from expertaug.systems.solvers.solver import Solver
from expertaug.tracking.settings import Tracking
from expertaug.trajectories import Trajectories, points_until

# Of the options, what a model file says.
KEPT = ("experiment", "method", "label", "preset", "choices", "seeds", "training")


def train(
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
    build, inputs = settings.build, inputs_of(data)
    system, described, train_data, validation_data = taken_in(inputs, settings, calibration)
    if isinstance(settings, UntrainedJob):
        if build.kind == "mean":
            stored = mean(system, train_data, settings, described)
        else:
            stored = expert_alone(system, train_data, settings, described, bool(build.truth))
        store.save(output, stored.model, stored.card)
        return
    recipe = describe.recipe_of(system, described)
    training = prepare(recipe, train_data, validation_data, settings, described, build.objective_kind)
    job.run(training, output, work, inputs, settings, tracking)


def inputs_of(data: Path) -> list[Path]:
    """Files of the sets that a training reads."""
    return [Path(data) / f"{name}.npz" for name in ("train", "validation")]


def taken_in(
    inputs: Sequence[Path], settings: RecipeKeys, calibration: Path | None
) -> tuple[systems.System, RecipeRecord, Trajectories, Trajectories]:
    """What a stage of training is given, read: the system, what a file will say of the recipe, and both sets.

    Arguments as of :func:`train`; ``inputs`` of :func:`inputs_of`.
    """
    described = described_by(settings, None if calibration is None else constants_of(calibration))
    first, second = map(Trajectories.load, inputs)
    return systems.load(described.system), described, first, second


def described_by(settings: RecipeKeys, constants: Mapping | None = None) -> RecipeRecord:
    """What a file will say of the recipe of a training's settings; ``constants`` are those that calibrate fitted."""
    build = settings.build
    system = settings.system | (build.system or {})
    if constants is not None and system.get("expert") != "point_mass":
        rubbed = system.get("friction") == "calibrated"
        system["constants"] = constants["with_friction"]["constants"] if rubbed else constants["constants"]
        if rubbed:
            system["friction"] = constants["with_friction"]["friction"]
    return RecipeRecord.of(
        system=system,
        model=settings.model.to_json(),
        expert=build.has_expert,
        interaction=build.has_interaction,
    )


def observed_points(t: Sequence[float], t1_s: float, choices: Choices) -> int:
    """Points of the times t that an encoder sees: those up to t1."""
    return points_until(t, t1_s) - (choices.observed_points == "exclusive")


def constants_of(calibration: Path) -> Mapping:
    """What the stage calibrate wrote."""
    found = read_json(calibration)
    if not isinstance(found, dict) or "constants" not in found or "with_friction" not in found:
        raise InputError(calibration, "has no constants", "make it again with calibrate")
    return found


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
    kind = objective_of(objective, classes)
    card = ModelCard.of(
        kind="hybrid",
        **of_data(train, recipe.system, options),
        **dict(described),
        likelihood=kind.learns_likelihood,
        stage="train",
        objective=short_name(OBJECTIVE, objective),
        forecast_solver=forecast_solver or store.forecast_solver(options.training.solver, recipe.system),
    )
    observed = card.observed
    times = torch.tensor(card.t[:observed], dtype=torch.float64)
    model = recipe.build(times, options.seeds, kind.learns_likelihood, card.start).to(device)
    train_set, validation_set = StackedSet.of(train, device), StackedSet.of(validation, device)
    for name, part in (("training set", train_set), ("validation set", validation_set)):
        check_given(recipe.system, part.u, name)
    windows = train_set.windows(observed)
    model.fit(windows[:, 0])
    task = task_of(options.training, card, device)
    return fitting.prepare(
        model,
        lambda points: (train_set.window(points), [(validation_set, task.selection(options.choices))]),
        task,
        card,
        options,
        classes,
        windows=windows,
        checked=validation_set.windows(observed),
    )


def mean(
    system: systems.System, train: Trajectories, options: UntrainedOptions, described: RecipeRecord
) -> store.StoredModel:
    """The baseline that forecasts the training set's mean; ``described`` as of :func:`prepare`."""
    card = ModelCard.of(kind="mean", **of_data(train, system, options), **dict(described), wall_s=0.0, best_score=None)
    return store.StoredModel(MeanModel(system, _mean(train)), card)


def _mean(train: Trajectories) -> torch.Tensor:
    """Mean (T, *state) of what was measured; 0 where nothing was."""
    if train.mask is None or train.mask.all():
        return torch.from_numpy(train.y).mean(0)
    return torch.from_numpy(train.y).sum(0) / torch.from_numpy(train.mask).sum(0).clamp_min(1)


def expert_alone(
    system: systems.System, train: Trajectories, options: UntrainedOptions, described: RecipeRecord, truth: bool = False
) -> store.StoredModel:
    """The decoder of the expert alone, whose estimates are to be found by least squares; nothing is trained.

    Arguments:
        options: how to fit.
        described: as of :func:`prepare`.
        truth: the equation that made the data instead, whose z_a lie where the training set's do.

    Raises:
        InputError: the true equation of data that were not simulated.
    """
    said = {**of_data(train, system, options), "system": described.system, "expert": True, "interaction": False}
    said |= {"refinement": options.refinement, "wall_s": 0.0, "best_score": None}
    card = ModelCard.of(kind="least_squares", **said)
    if not truth:
        return store.StoredModel(Decoder(system), card)
    z_a = train.z_a
    if z_a is None or not z_a.shape[1]:
        raise InputError("build.truth", "the training set has no z_a", "only simulated data have a true equation")
    latent = {"mean": [z_a.mean(0).tolist()], "std": [z_a.std(0).tolist()]}
    return store.StoredModel(TruthDecoder(system), card.but(truth=True, latent=latent))


def _first_values(train: Trajectories, system: systems.System, given: Mapping) -> dict[str, list[float]]:
    """The range of each component of first points, in the state's order."""
    axes, names = (0, 1, *range(3, train.y.ndim)), [p.name for p in system.state]
    y = train.seen
    low = np.where(np.isnan(y), np.inf, y).min(axes).astype(float)
    high = np.where(np.isnan(y), -np.inf, y).max(axes).astype(float)
    found = ranges_of(names, low.tolist(), high.tolist(), given)
    if missing := [name for name in names if name not in found]:
        remedy = "give the range [low, high] in which its first value lies (data.start)"
        raise InputError(f"start.{missing[0]}", "missing, nobody measured it", remedy)
    return {name: found[name] for name in names}


def of_data(train: Trajectories, system: systems.System, options: DataOptions) -> dict:
    """What a card says of data and options.

    Raises:
        InputError: a component that nobody measured has no range.
    """
    t = [float(v) for v in train.t]
    observed = observed_points(t, options.t1_s, options.choices)
    kept = options.model_dump(include=set(KEPT))
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

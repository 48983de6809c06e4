"""What the front door is given: seeds, sets and trained models that fit each other, and how windows are fitted."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TypeVar

import numpy as np

from expertaug import systems
from expertaug.api import arrays
from expertaug.api.arrays import Noise, Ranges
from expertaug.api.trained import TrainedModel
from expertaug.errors import InputError
from expertaug.models.hybrid import HybridModel
from expertaug.models.settings import Refinement, RefinementSettings
from expertaug.presets import resolve
from expertaug.settings import Settings
from expertaug.systems import System
from expertaug.trajectories import Trajectories

Options = TypeVar("Options", bound=Settings)


def seeds_of(given: Iterable[int]) -> list[int]:
    try:
        seeds = [int(seed) for seed in given]
    except (TypeError, ValueError) as error:
        raise InputError("seeds", f"found {given!r}", "give whole numbers, as range(3)") from error
    if not seeds or min(seeds) < 0 or max(seeds) >= 2**63 or len(set(seeds)) < len(seeds):
        raise InputError("seeds", f"found {seeds}", "give different whole numbers from 0 on")
    return seeds


def fit_options(
    kind: type[Options],
    system: System,
    method: str,
    label: str,
    observed_s: float,
    start: Ranges | None,
    refinement: Refinement,
    **rest: object,
) -> Options:
    """Options of a method whose estimates are least-squares fits of each window; ``rest`` are its training and seeds.

    Raises:
        InputError: a range cannot be used.
    """
    return kind.of(
        experiment=systems.describe(system)["name"],
        method=method,
        label=label,
        preset="corrected",
        choices=resolve("corrected"),
        t1_s=float(observed_s),
        start={} if start is None else arrays.ranges(start, start, "start"),
        refinement=refinement,
        **rest,
    )


def refinement_of(system: System, options: Mapping | None, noise: Noise, prior: Ranges | None) -> Refinement:
    """How windows are fitted; a ``prior`` of None is for the caller to find.

    Raises:
        InputError: an option or a range cannot be used.
    """
    names = [p.name for p in system.expert_parameters]
    return Refinement.of(
        settings=RefinementSettings.from_mapping(options),
        noise=arrays.noise(noise),
        prior=None if prior is None else arrays.ranges(prior, names, "prior"),
    )


def check_sets(model: HybridModel | TrainedModel, train: Trajectories, validation: Trajectories) -> None:
    """Both sets must be of the model's system and of one another's times."""
    for name, data in (("train", train), ("validation", validation)):
        arrays.trajectories(data, name)
        state, parameters = model.system.state_shape, model.system.expert_parameters
        if data.y.shape[2:] != state or data.z_e.shape[1] != len(parameters):
            found = f"y has shape {data.y.shape}, z_e {data.z_e.shape}"
            wanted = f"y (N, T, {', '.join(map(str, state))}), z_e (N, {len(parameters)})"
            raise InputError(name, found, f"{type(model.system).__name__} has {wanted}")
        arrays.inputs(data.u, model.system, len(data), data.t, f"{name}.u")
    if len(train.t) != len(validation.t) or not np.array_equal(train.t, validation.t):
        raise InputError("validation", f"has the times {arrays.brief(validation.t)}", "give those of train")


def check_trained(model: TrainedModel, train: Trajectories, validation: Trajectories) -> None:
    if not isinstance(model, TrainedModel):
        raise InputError("model", f"is {type(model).__name__}", "give what expertaug.fit returns")
    if model.stored.card.kind != "hybrid":
        raise InputError("model", f"a {model.stored.card.kind} model", "only hybrid models can be augmented")
    check_sets(model, train, validation)
    arrays.same_times(train.t, model.t, "train", "give the sets of its training")

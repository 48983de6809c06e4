"""What a user gives: arrays (NumPy or torch in, the same out, batch first), ranges, noise, sets, seeds; checked."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from numbers import Real
from operator import index
from typing import Literal, TypeAlias, TypedDict

import numpy as np
import torch
from torch import Tensor

from expertaug.errors import InputError
from expertaug.systems import System
from expertaug.systems.inputs import check_given
from expertaug.systems.solvers.solver import Solver
from expertaug.trajectories import Trajectories, brief, points_until
from expertaug.wording import check_keys

Array: TypeAlias = np.ndarray | Tensor
Ranges: TypeAlias = Mapping[str, Sequence[float]]
# Standard deviation of the noise of every value, of each component's, or as it was estimated from measurements.
Noise: TypeAlias = float | Mapping[str, float] | Literal["estimated"]

TIME_TOLERANCE = 1e-6  # of the observed window's length


class RefinementOptions(TypedDict, total=False):
    """How to refine; see :class:`expertaug.models.fit_settings.RefinementSettings` for meaning and defaults."""

    starts: int
    tries: int
    sufficient: float
    agreement: float
    steps: int
    free_start: bool
    latent: int
    latent_width: float
    windows: Mapping[str, tuple[float, float]]
    solver: Mapping
    units: Mapping[str, str]
    population: Mapping[str, str]
    sensors: Mapping[str, Mapping[str, str]]


def tensor(value: object, name: str, gaps: bool = False) -> Tensor:
    """A finite float32 tensor of what the user gave; with ``gaps`` it may have NaN, where nothing was measured.

    Raises:
        InputError: no array of numbers, or a value that is not finite.
    """
    try:
        array = value.detach() if isinstance(value, Tensor) else torch.from_numpy(np.array(value, dtype=np.float32))
    except (TypeError, ValueError) as error:
        raise InputError(name, f"no array of numbers ({error})", "give a NumPy array or a torch tensor") from error
    if array.is_complex():
        raise InputError(name, "has complex numbers", "give real ones")
    array = array.to(torch.float32)
    bad = torch.isinf(array) if gaps else ~torch.isfinite(array)
    if bad.any():
        where = tuple(bad.nonzero()[0].tolist())
        raise InputError(name, f"is not finite, first at index {where}", "every value must be finite")
    return array


def noise(noise_std: Noise) -> float | dict[str, float] | str:
    """A standard deviation of noise, of all components or of each, checked.

    Raises:
        InputError: one that cannot be used.
    """
    each = noise_std if isinstance(noise_std, Mapping) else {"": noise_std}
    for name, value in each.items():
        estimated = isinstance(noise_std, str) and noise_std == "estimated"
        if not (estimated or (isinstance(value, Real) and 0 <= float(value) < np.inf)):
            where = f"noise.{name}" if name else "noise"
            raise InputError(where, f"found {value!r}", "a standard deviation, at least 0, or 'estimated'")
    if isinstance(noise_std, Mapping):
        return {str(name): float(value) for name, value in noise_std.items()}
    return noise_std if isinstance(noise_std, str) else float(noise_std)


def like(value: Tensor, prototype: object) -> Array:
    """A tensor as what the user gave: NumPy, unless that was a tensor."""
    return value.to(prototype.device) if isinstance(prototype, Tensor) else value.cpu().numpy()


def times(value: object) -> np.ndarray:
    """Times in s, (T,), float64.

    Raises:
        InputError: they do not increase strictly.
    """
    try:
        t = np.array(value.detach().cpu() if isinstance(value, Tensor) else value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError("t", f"no array of numbers ({error})", "give the times in s, (T,)") from error
    remedy = "give finite, strictly increasing times in s, (T,)"
    if t.ndim != 1:
        raise InputError("t", f"has shape {t.shape}", remedy)
    if not np.isfinite(t).all() or np.any(np.diff(t) <= 0):
        raise InputError("t", f"does not increase from time to time: {brief(t)}", remedy)
    return t


def inputs(value: object, system: System, samples: int, t: np.ndarray, name: str = "u") -> Tensor | None:
    """Known inputs (N, T, U) of N samples at the times t; None for a system without.

    Raises:
        InputError: they are missing, not known to the system or of another shape, or a covariate is not constant.
    """
    if value is None:
        check_given(system, None, name)
        return None
    u = tensor(value, name)
    names = ", ".join(p.name for p in system.known)
    if u.dim() != 3 or u.shape[:2] != (samples, len(t)):
        problem, wanted = f"has shape {tuple(u.shape)}", f"({samples}, {len(t)}, {len(system.known)})"
        raise InputError(name, problem, f"give {wanted}, {names or 'known inputs'} at all times of t")
    check_given(system, u, name)
    check_constant(system, u, name)
    return u


def check_constant(system: System, u: Tensor, name: str) -> None:
    """Covariates of known inputs (N, T, U) must not change along a trajectory.

    Raises:
        InputError: one does.
    """
    for k, covariate in enumerate(system.covariates, start=len(system.inputs)):
        if (u[..., k] != u[:, :1, k]).any():
            raise InputError(
                name, f"{covariate.name} changes along a trajectory", "a covariate is constant; declare an input"
            )


def stack_seeds(value: Tensor, seeds: int) -> Tensor:
    """What all seeds share, (N, T, …) → (T, S, N, …)."""
    each = value.movedim(1, 0).unsqueeze(1)
    return each.expand(-1, seeds, *each.shape[2:])


def same_times(actual: np.ndarray, expected: np.ndarray, name: str, remedy: str) -> None:
    """Refuse times that are not the expected ones.

    Raises:
        InputError: a time differs by more than a millionth of the whole.
    """
    if len(actual) == len(expected):
        span = abs(expected[-1] - expected[0]) or 1.0
        if np.abs(actual - expected).max() <= TIME_TOLERANCE * span:
            return
    raise InputError(name, f"has the times {brief(actual)}", f"the model knows {brief(expected)}: {remedy}")


def ranges(bounds: Ranges, names: Iterable[str], where: str) -> dict[str, list[float]]:
    """Ranges [low, high] by parameter, checked.

    Raises:
        InputError: other names than the expected ones, or no range.
    """
    names = list(names)
    if not isinstance(bounds, Mapping) or sorted(bounds) != sorted(names):
        actual = ", ".join(map(str, bounds)) if isinstance(bounds, Mapping) else type(bounds).__name__
        raise InputError(where, f"gives {actual or 'nothing'}", f"give [low, high] for each of {', '.join(names)}")
    kept = {}
    for name in names:
        try:
            low, high = (float(v) for v in bounds[name])
        except (TypeError, ValueError) as error:
            raise InputError(f"{where}.{name}", f"found {bounds[name]!r}", "give [low, high]") from error
        if not (np.isfinite([low, high]).all() and low <= high):
            raise InputError(f"{where}.{name}", f"found [{low:g}, {high:g}]", "low must not exceed high")
        kept[name] = [low, high]
    return kept


def share(value: object, name: str) -> float:
    """A share from 0 to 1.

    Raises:
        InputError: it is none.
    """
    if not isinstance(value, Real) or not 0 <= float(value) <= 1:
        raise InputError(name, f"found {value!r}", "give a share from 0 to 1")
    return float(value)


def start(bounds: Ranges, system: System) -> dict[str, list[float]]:
    """Ranges [low, high] of first values by component of a system's state, checked.

    Raises:
        InputError: a name that is no component's, or no range.
    """
    check_keys(bounds, [p.name for p in system.state], "start", "component of the state")
    return ranges(bounds, bounds, "start")


def solver(value: object, name: str) -> Solver | None:
    """A solver, or none.

    Raises:
        InputError: it is something else.
    """
    if value is not None and not isinstance(value, Solver):
        raise InputError(name, f"found {value!r}", 'give one, as expertaug.Solver("rk4")')
    return value


def trajectories(data: object, name: str) -> Trajectories:
    """A set that the user gave.

    Raises:
        InputError: it is none, or empty.
    """
    if not isinstance(data, Trajectories):
        raise InputError(name, f"is {type(data).__name__}", "give expertaug.Trajectories(t, y, z_e)")
    if not len(data):
        raise InputError(name, "holds no trajectory", "give at least one")
    return data


@contextmanager
def one_thread() -> Iterator[None]:
    """One thread of torch, with which results do not depend on the machine; the number before is restored."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def seeds_of(values: Iterable[int]) -> list[int]:
    """Seeds that a user gave.

    Raises:
        InputError: no different whole numbers from 0 on.
    """
    try:
        each = list(values)
        seeds = [index(seed) for seed in each if not isinstance(seed, bool)]
    except TypeError as error:
        raise InputError("seeds", f"found {values!r}", "give whole numbers, as range(3)") from error
    if not seeds or len(seeds) < len(each) or min(seeds) < 0 or max(seeds) >= 2**63 or len(set(seeds)) < len(seeds):
        raise InputError("seeds", f"found {each}", "give different whole numbers from 0 on")
    return seeds


def check_observed(observed_s: object, t: np.ndarray) -> None:
    """The end of the observed window lies within the times of the data, behind their first.

    Raises:
        InputError: it does not.
    """
    if (
        not isinstance(observed_s, Real)
        or points_until(t, float(observed_s)) < 2
        or observed_s > t[-1] + TIME_TOLERANCE * abs(t[-1] - t[0])
    ):
        raise InputError("observed_s", f"found {observed_s!r}", f"the data's times are {brief(t)}")


def check_set(system: System, data: object, name: str, labelled: bool = True) -> None:
    """A set must be of the system.

    Arguments:
        labelled: whether z_e must be the system's too.

    Raises:
        InputError: it is not.
    """
    if not isinstance(system, System):
        problem = f"is {getattr(system, '__name__', type(system).__name__)}"
        raise InputError("system", problem, "give an instance, as expertaug.DampedPendulum()")
    dataset, state, parameters = trajectories(data, name), system.state_shape, system.expert_parameters
    if dataset.y.shape[2:] != state or (labelled and dataset.z_e.shape[1] != len(parameters)):
        problem = f"y has shape {dataset.y.shape}, z_e {dataset.z_e.shape}"
        wanted = f"y (N, T, {', '.join(map(str, state))}), z_e (N, {len(parameters)})"
        raise InputError(name, problem, f"{type(system).__name__} has {wanted}")
    inputs(dataset.u, system, len(dataset), dataset.t, f"{name}.u")


def check_sets(system: System, train: Trajectories, validation: Trajectories) -> None:
    """Both sets must be of the system and of one another's times.

    Raises:
        InputError: they are not.
    """
    check_set(system, train, "train")
    check_set(system, validation, "validation")
    if len(train.t) != len(validation.t) or not np.array_equal(train.t, validation.t):
        raise InputError("validation", f"has the times {brief(validation.t)}", "give those of train")

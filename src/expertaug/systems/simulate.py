"""Simulated sets of trajectories, many samples in one batched solve."""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from numbers import Integral, Real
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from expertaug.errors import InputError, SolveError
from expertaug.systems import Parameter, System, load
from expertaug.systems.inputs import check_given, solve
from expertaug.systems.jumps import watch
from expertaug.systems.settings import SimulatedData, SimulateJob
from expertaug.systems.solvers.solver import Solver, check_finite
from expertaug.trajectories import Trajectories
from expertaug.wording import suggest

CHUNK = 2**17  # values of the state solved at a time: bounds the memory and stays in the processor's cache


def uniform(
    parameters: tuple[Parameter, ...],
    ranges: Mapping[str, Sequence[float]],
    n: int,
    generator: torch.Generator,
    where: str = "parameter ranges",
) -> Tensor:
    """n samples (n, P), float64, uniform in the named ranges.

    Raises:
        InputError: a range is missing, unknown or empty.
    """
    names = [p.name for p in parameters]
    if sorted(ranges) != sorted(names):
        raise InputError(where, f"given for {sorted(ranges)}", f"give one range for each of {names}")
    for name, (low, high) in ranges.items():
        if not low <= high:
            raise InputError(f"range of {name}", f"[{low}, {high}]", "min must not exceed max")
    low = torch.tensor([ranges[name][0] for name in names], dtype=torch.float64)
    high = torch.tensor([ranges[name][1] for name in names], dtype=torch.float64)
    return low + (high - low) * torch.rand(n, len(names), generator=generator, dtype=torch.float64)


def trajectories(
    system: System,
    z_e: Mapping[str, Sequence[float]],
    z_a: Mapping[str, Sequence[float]] | None = None,
    *,
    n: int,
    t: Sequence[float] | np.ndarray,
    inputs: Mapping[str, Sequence[float]] | None = None,
    u: np.ndarray | None = None,
    noise: float = 0.0,
    seed: int = 0,
    name: str = "train",
) -> Trajectories:
    """Simulate a set of trajectories of a system.

    Arguments:
        system: with ``truth`` and ``sample_initial_state``.
        z_e, z_a: expert and interaction parameters are drawn uniformly from [low, high], by name, in their units.
        n: number of trajectories.
        t: times in s, (T,), strictly increasing; the initial states are those at the first.
        inputs: ranges, likewise, of what the known inputs are drawn from: the system's ``input_parameters`` and
            ``covariates``.  The inputs are what the system says of them at the times t, and interpolated between.
        u: the known inputs themselves, (n, T, U), instead.
        noise: standard deviation of the Gaussian noise added to every value, the initial state's too.
        seed: of the random numbers, together with ``name``.
        name: of the set (train, validation, test, …): sets of other names are independent under one seed.

    Raises:
        InputError: a range is missing, unknown or empty; the times do not increase; n or noise is out of range.
        SolveError: a trajectory is not finite; the message has its parameters.
    """
    t = np.ascontiguousarray(t, dtype=np.float64)
    if t.ndim != 1 or len(t) < 2 or not np.isfinite(t).all() or np.any(np.diff(t) <= 0):
        raise InputError(
            "simulation", f"t has shape {t.shape}", "t must be finite and strictly increasing, (T,), T ≥ 2"
        )
    if not (isinstance(n, Integral) and n > 0 and isinstance(noise, Real) and 0 <= noise < np.inf):
        raise InputError("simulation", f"n = {n}, noise = {noise}", "n must be at least 1, noise at least 0")
    if not isinstance(seed, Integral) or seed < 0:
        raise InputError("seed", f"found {seed!r}", "give a whole number from 0 on")
    n = int(n)
    generator = torch.Generator().manual_seed(_seed_of(int(seed), name))
    expert = uniform(system.expert_parameters, z_e, n, generator)
    interaction = uniform(system.interaction_parameters, z_a or {}, n, generator)
    y0 = system.sample_initial_state(n, generator)
    input_values = _inputs(system, inputs, u, n, torch.from_numpy(t), generator)
    what = f"{type(system).__name__}, set {name}, (sample)"
    y = torch.empty(len(t), *y0.shape, dtype=torch.float64 if noise else torch.float32)
    size = max(CHUNK // y0[0].numel(), 1)
    for part in torch.arange(n).split(size):
        here = None if input_values is None else input_values[part].movedim(1, 0)
        y[:, part] = _solve(system, y0[part], expert[part], interaction[part], torch.from_numpy(t), what, here).to(y)
    check_finite(y, torch.cat((expert, interaction), dim=-1), what)
    if noise:
        y += noise * torch.randn(y.shape, generator=generator, dtype=torch.float64)
    input_array = None if input_values is None else input_values.numpy()
    return Trajectories(t=t, y=y.movedim(0, 1).numpy(), z_e=expert.numpy(), z_a=interaction.numpy(), u=input_array)


def _seed_of(seed: int, name: str) -> int:
    """A generator's seed for a set.  It takes 32 bits alone; with a seed of 0 they are the name's."""
    checksum = zlib.crc32(name.encode())
    return checksum if not seed else int(np.random.SeedSequence([seed, checksum]).generate_state(1)[0])


def _inputs(
    system: System,
    ranges: Mapping[str, Sequence[float]] | None,
    values: np.ndarray | None,
    n: int,
    t: Tensor,
    generator: torch.Generator,
) -> Tensor | None:
    """Known inputs (n, T, U), as precise as a file holds them; None for a system without."""
    if values is not None:
        u = torch.as_tensor(np.asarray(values, dtype=np.float32)).double()
        if u.shape[:2] != (n, len(t)) or u.dim() != 3 or not torch.isfinite(u).all():
            raise InputError("u", f"has shape {tuple(u.shape)}", f"give finite inputs ({n}, {len(t)}, U)")
        check_given(system, u)
        return u
    if not system.known:
        if ranges:
            raise InputError("inputs", f"given for {sorted(ranges)}", f"{type(system).__name__} has no known inputs")
        return None
    drawn = uniform((*system.input_parameters, *system.covariates), ranges or {}, n, generator, "inputs")
    first, covariates = drawn.split((len(system.input_parameters), len(system.covariates)), dim=1)
    try:
        signal = system.input_signal(t, first)
    except NotImplementedError as error:
        raise InputError("u", "missing", str(error)) from error
    return torch.cat((signal, covariates.unsqueeze(1).expand(-1, len(t), -1)), dim=2).float().double()


def sample(system: System, data: SimulatedData, set_name: str) -> Trajectories:
    """The set ``set_name`` of ``data``.

    Raises:
        InputError: there is no such set, or as of :func:`trajectories`.
    """
    if set_name not in data.sets:
        raise InputError("data.sets", f"no set '{set_name}'", suggest(set_name, data.sets))
    drawn, t = data.sets[set_name], np.arange(round(data.t2_s / data.step_s) + 1) * data.step_s
    options = {"n": drawn.size, "noise": data.noise, "seed": data.seed, "name": set_name}
    return trajectories(system, drawn.z_e, drawn.z_a, t=t, inputs=drawn.inputs, **options)


@torch.no_grad()
def _solve(
    system: System, y0: Tensor, z_e: Tensor, z_a: Tensor, t: Tensor, name: str, u: Tensor | None = None
) -> Tensor:
    """States (T, N, *state) of one chunk of samples."""

    def field(s: Tensor, y: Tensor, *more: Tensor) -> Tensor:
        return system.truth(s, y, z_e, z_a, *more)

    try:
        return solve(system, watch(system, field, name), y0, t, system.simulation, z_e, u)
    except SolveError as error:  # a fixed grid goes on, so that the sample can be named
        check_finite(solve(system, field, y0, t, Solver("rk4"), z_e, u), torch.cat((z_e, z_a), dim=-1), name)
        raise SolveError(f"{name}: {error}") from error


def simulate(set_name: str, output: Path, job: SimulateJob) -> None:
    """Stage: write the set ``set_name`` of a job to ``output``."""
    sample(load(job.system), job.data, set_name).save(output)

"""Simulated sets of trajectories, many samples in one batched solve."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from expertaug.errors import InputError, SolveError
from expertaug.systems import Parameter, System, load
from expertaug.systems.solver import Solver, check_finite
from expertaug.trajectories import Trajectories

CHUNK = 2**17  # values of the state solved at a time: bounds the memory and stays in the processor's cache


def uniform(
    parameters: tuple[Parameter, ...], ranges: Mapping[str, list[float]], n: int, generator: torch.Generator
) -> Tensor:
    """n samples (n, P), float64, uniform in the named ranges.

    Raises:
        InputError: a range is missing, unknown or empty.
    """
    names = [p.name for p in parameters]
    if sorted(ranges) != sorted(names):
        raise InputError("parameter ranges", f"given for {sorted(ranges)}", f"give one range for each of {names}")
    for name, (low, high) in ranges.items():
        if not low <= high:
            raise InputError(f"range of {name}", f"[{low}, {high}]", "min must not exceed max")
    low = torch.tensor([ranges[name][0] for name in names], dtype=torch.float64)
    high = torch.tensor([ranges[name][1] for name in names], dtype=torch.float64)
    return low + (high - low) * torch.rand(n, len(names), generator=generator, dtype=torch.float64)


def sample(system: System, data: Mapping, set_name: str) -> Trajectories:
    """One set of a simulated system.

    Arguments:
        system: with ``truth`` and ``sample_initial_state``.
        data: ``seed``, ``step_s``, ``t2_s`` in s, ``noise`` (standard deviation added to every observed value, the
            initial state's too), and ``sets[set_name]`` with ``size`` and the ranges ``z_e`` and ``z_a``.
        set_name: train, validation, test, …; it is part of the seed, so that sets are independent.

    Raises:
        SolveError: a trajectory is not finite.
    """
    settings = data["sets"][set_name]
    n = int(settings["size"])
    generator = torch.Generator().manual_seed((int(data["seed"]) << 32) + zlib.crc32(set_name.encode()))
    z_e = uniform(system.expert_parameters, settings["z_e"], n, generator)
    z_a = uniform(system.interaction_parameters, settings.get("z_a", {}), n, generator)
    y0 = system.sample_initial_state(n, generator)
    t = times(data)
    name = f"{type(system).__name__}, set {set_name}, (sample)"
    noise = float(data["noise"])
    y = torch.empty(len(t), *y0.shape, dtype=torch.float64 if noise else torch.float32)
    size = max(CHUNK // y0[0].numel(), 1)
    for part in torch.arange(n).split(size):
        y[:, part] = _solve(system, y0[part], z_e[part], z_a[part], torch.from_numpy(t), name).to(y)
    check_finite(y, torch.cat((z_e, z_a), dim=-1), name)
    if noise:
        y += noise * torch.randn(y.shape, generator=generator, dtype=torch.float64)
    return Trajectories(t=t, y=y.movedim(0, 1).numpy(), z_e=z_e.numpy(), z_a=z_a.numpy())


@torch.no_grad()
def _solve(system: System, y0: Tensor, z_e: Tensor, z_a: Tensor, t: Tensor, name: str) -> Tensor:
    """States (T, N, *state) of one chunk of samples."""

    def field(s: Tensor, y: Tensor) -> Tensor:
        return system.truth(s, y, z_e, z_a)

    try:
        return system.simulation(field, y0, t, rank=len(system.state_shape))
    except SolveError as error:  # a fixed grid goes on, so that the sample can be named
        check_finite(Solver("rk4")(field, y0, t), torch.cat((z_e, z_a), dim=-1), name)
        raise SolveError(f"{name}: {error}") from error


def times(data: Mapping) -> np.ndarray:
    """The times 0, step_s, …, t2_s in s."""
    return np.arange(round(data["t2_s"] / data["step_s"]) + 1) * float(data["step_s"])


def simulate(set_name: str, output: Path, settings: Mapping) -> None:
    """Stage: write the set ``set_name`` of ``settings = {system, data}`` to ``output``."""
    sample(load(settings["system"]), settings["data"], set_name).save(output)

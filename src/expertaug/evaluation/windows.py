"""What is known of single windows: errors, misfits and estimates of every version, with the seeds of all groups."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from expertaug.errors import InputError
from expertaug.evaluation.samples import ERRORS, ESTIMATE, MISFIT, REMEDY, TRUTH
from expertaug.files import read_npz


@dataclass(frozen=True)
class WindowSet:
    """The windows of one set, of one version.

    Attributes:
        errors: squared error of each forecast, (S, N).
        misfit: squared error over the observed window, (S, N).
        z_e: true expert parameters, (N, P).
        z_e_hat: estimates (S, N, P), or None where a version has none.
    """

    errors: np.ndarray
    misfit: np.ndarray
    z_e: np.ndarray
    z_e_hat: np.ndarray | None


@dataclass(frozen=True)
class Version:
    """All windows of a version, of the seeds that could be trained.

    Attributes:
        seeds: S of them.
        parameters: names of the expert parameters.
        sets: by name.
    """

    seeds: list[int]
    parameters: list[str]
    sets: dict[str, WindowSet]


def read_windows(paths: Sequence[str | Path]) -> dict[str, Version]:
    """Versions by name from the forecasts.npz of all versions and groups of seeds of an experiment.

    Raises:
        InputError: a file is broken, or from before errors of single windows were kept.
    """
    parts: dict[str, list[Version]] = {}
    for path in paths:
        arrays = read_npz(path, "forecast file", REMEDY)
        if missing := [
            name for name in ("version", "seeds", "parameter_names", f"test_{MISFIT}") if name not in arrays
        ]:
            raise InputError(path, f"no array {missing[0]!r}", REMEDY)
        good = ~np.isin(arrays["seeds"], arrays.get("failed", []))
        sets = {}
        for name in (key.removesuffix(f"_{MISFIT}") for key in arrays if key.endswith(f"_{MISFIT}")):
            z_e_hat = arrays.get(f"{name}_{ESTIMATE}")
            sets[name] = WindowSet(
                arrays[f"{name}_{ERRORS}"][good],
                arrays[f"{name}_{MISFIT}"][good],
                arrays[f"{name}_{TRUTH}"],
                None if z_e_hat is None else z_e_hat[good],
            )
        one = Version([int(s) for s in arrays["seeds"][good]], list(map(str, arrays["parameter_names"])), sets)
        parts.setdefault(str(arrays["version"][2]), []).append(one)
    return {name: _joined(several) for name, several in parts.items()}


def _joined(parts: Sequence[Version]) -> Version:
    first = parts[0]
    sets = {}
    for name, one in first.sets.items():
        each = [part.sets[name] for part in parts]
        hats = [s.z_e_hat for s in each if s.z_e_hat is not None]
        sets[name] = WindowSet(
            np.concatenate([s.errors for s in each]),
            np.concatenate([s.misfit for s in each]),
            one.z_e,
            np.concatenate(hats) if hats else None,
        )
    return Version([seed for part in parts for seed in part.seeds], first.parameters, sets)


def experiment_of(paths: Sequence[str | Path]) -> str:
    """The experiment of the first of some forecasts.npz."""
    return str(read_npz(paths[0], "forecast file", REMEDY, ["version"])["version"][0])

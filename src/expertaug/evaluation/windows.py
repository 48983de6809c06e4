"""What is known of single windows: errors, misfits and estimates of every version, with the seeds of all groups."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from expertaug.errors import InputError
from expertaug.evaluation.samples import DRAWS, ERRORS, ESTIMATE, MISFIT, RANKS, REMEDY, TARP, TRUTH
from expertaug.evaluation.summary import in_domain
from expertaug.files import read_npz


@dataclass(frozen=True)
class WindowSet:
    """The windows of one set, of one version.

    Attributes:
        errors: squared error of each forecast, (S, N).
        misfit: squared error over the observed window, (S, N).
        z_e: true expert parameters, (N, P).
        z_e_hat: estimates (S, N, P), or None where a version has none.
        ranks: of the true parameters among ``draws`` draws, (S, N, P), or None where a version estimates a point.
        tarp: ranks by distance from random points, (S, N).
    """

    errors: np.ndarray
    misfit: np.ndarray
    z_e: np.ndarray
    z_e_hat: np.ndarray | None
    ranks: np.ndarray | None = None
    tarp: np.ndarray | None = None
    draws: int = 0


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

    @property
    def judged(self) -> list[str]:
        """The set of the training's domain and the shifted one, where they are there."""
        return [name for name in (in_domain(self.sets), "test") if name in self.sets]


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
            of_seeds = {key: arrays.get(f"{name}_{key}") for key in (ERRORS, MISFIT, ESTIMATE, RANKS, TARP)}
            errors, misfit, *others = (None if v is None else v[good] for v in of_seeds.values())
            assert errors is not None and misfit is not None
            draws = int(arrays.get(DRAWS, np.array(0)))
            sets[name] = WindowSet(errors, misfit, arrays[f"{name}_{TRUTH}"], *others, draws)
        one = Version([int(s) for s in arrays["seeds"][good]], list(map(str, arrays["parameter_names"])), sets)
        parts.setdefault(str(arrays["version"][2]), []).append(one)
    return {name: _joined(several) for name, several in parts.items()}


def _joined(parts: Sequence[Version]) -> Version:
    first = parts[0]
    if len(parts) == 1:
        return first
    sets = {}
    for name, one in first.sets.items():
        each = [part.sets[name] for part in parts]
        joined = [
            _together([getattr(s, key) for s in each]) for key in ("errors", "misfit", "z_e_hat", "ranks", "tarp")
        ]
        sets[name] = WindowSet(joined[0], joined[1], one.z_e, *joined[2:], one.draws)  # type: ignore[arg-type]
    return Version([seed for part in parts for seed in part.seeds], first.parameters, sets)


def _together(parts: Sequence[np.ndarray | None]) -> np.ndarray | None:
    known = [part for part in parts if part is not None]
    return np.concatenate(known) if len(known) == len(parts) else None


def experiment_of(paths: Sequence[str | Path]) -> str:
    """The experiment of the first of some forecasts.npz."""
    return str(read_npz(paths[0], "forecast file", REMEDY, ["version"])["version"][0])

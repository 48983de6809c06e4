"""What is known of single windows: errors, misfits and estimates of every version, with the seeds of all groups."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from expertaug.errors import InputError
from expertaug.evaluation.samples import (
    DRAWS,
    ERRORS,
    ESTIMATE,
    EXPECTED,
    INSIDE,
    LATENT,
    MISFIT,
    MOVED,
    OWN,
    RANKS,
    REMEDY,
    TARP,
    TRUTH,
)
from expertaug.evaluation.summary import in_domain
from expertaug.files import read_npz


@dataclass(frozen=True)
class Drawn:
    """Where the truth lies among draws.

    Attributes:
        count: K, draws of z_e a window.
        ranks: of the true parameters, (S, N, P).
        tarp: ranks by distance from random points, (S, N).
        inside: share of each drawn forecast's times and quantities within its intervals, (S, M, L) of M windows; None
            where no forecasts were drawn.
    """

    count: int
    ranks: np.ndarray
    tarp: np.ndarray
    inside: np.ndarray | None = None


@dataclass(frozen=True)
class WindowSet:
    """The windows of one set, of one version.

    Attributes:
        errors: squared error of each forecast, (S, N).
        misfit: squared error over the observed window, (S, N).
        z_e: true expert parameters, (N, P).
        z_e_hat: estimates (S, N, P), or None where a version has none.
        z_a: true parameters of the interaction, (N, Q), or None where they are not known.
        drawn: what draws of the estimates and of the forecasts are worth; None where a version estimates a point.
        expected: squared error that is expected of each forecast, (S, N), by a version with a distribution.
        moved: the same that a refined version expects of its encoder's forecasts.
    """

    errors: np.ndarray
    misfit: np.ndarray
    z_e: np.ndarray
    z_e_hat: np.ndarray | None
    z_a: np.ndarray | None = None
    drawn: Drawn | None = None
    expected: np.ndarray | None = None
    moved: np.ndarray | None = None


@dataclass(frozen=True)
class Version:
    """All windows of a version, of the seeds that could be trained.

    Attributes:
        seeds: S of them.
        parameters: names of the expert parameters.
        sets: by name.
        interaction: names of the true interaction's parameters, where they are known.
        own: of windows that the version's models have made themselves, where they were drawn.
    """

    seeds: list[int]
    parameters: list[str]
    sets: dict[str, WindowSet]
    own: Drawn | None = None
    interaction: tuple[str, ...] = ()

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
            of_seeds = {key: arrays.get(f"{name}_{key}") for key in (ERRORS, MISFIT, ESTIMATE, EXPECTED, MOVED)}
            errors, misfit, hats, *supposed = (None if v is None else v[good] for v in of_seeds.values())
            assert errors is not None and misfit is not None
            true, z_a, drawn = arrays[f"{name}_{TRUTH}"], arrays.get(f"{name}_{LATENT}"), _drawn(arrays, name, good)
            told = ~np.isnan(errors).all(0) if len(errors) else np.ones(errors.shape[1], dtype=bool)
            if not told.all():  # windows after which nothing was measured
                errors, misfit, true = errors[:, told], misfit[:, told], true[told]
                hats, z_a = None if hats is None else hats[:, told], None if z_a is None else z_a[told]
                supposed = [None if one is None else one[:, told] for one in supposed]
                drawn = None if drawn is None else replace(drawn, ranks=drawn.ranks[:, told], tarp=drawn.tarp[:, told])
            sets[name] = WindowSet(errors, misfit, true, hats, z_a, drawn, *supposed)
        names = list(map(str, arrays["parameter_names"]))
        one = Version(
            [int(s) for s in arrays["seeds"][good]],
            names,
            sets,
            _drawn(arrays, OWN, good),
            tuple(arrays.get("interaction_names", ())),
        )
        parts.setdefault(str(arrays["version"][2]), []).append(one)
    return {name: _joined(several) for name, several in parts.items()}


def _drawn(arrays: Mapping[str, np.ndarray], name: str, good: np.ndarray) -> Drawn | None:
    """What a file's draws of a set are worth, of the seeds that could be trained."""
    found = {key: arrays.get(f"{name}_{key}") for key in (RANKS, TARP, INSIDE)}
    ranks, tarp, held = (None if v is None else v[good] for v in found.values())
    if held is not None and (untold := np.isnan(held).any((0, 2))).any():  # nothing was measured after the window
        held = held[:, ~untold]
    return None if ranks is None or tarp is None else Drawn(int(arrays[DRAWS]), ranks, tarp, held)


def _joined(parts: Sequence[Version]) -> Version:
    first = parts[0]
    if len(parts) == 1:
        return first
    sets = {}
    for name, one in first.sets.items():
        each = [part.sets[name] for part in parts]
        keys = ("errors", "misfit", "z_e_hat", "expected", "moved")
        errors, misfit, hats, *supposed = (_together([getattr(s, key) for s in each]) for key in keys)
        assert errors is not None and misfit is not None
        drawn = _joined_draws([s.drawn for s in each])
        sets[name] = WindowSet(errors, misfit, one.z_e, hats, one.z_a, drawn, *supposed)
    seeds = [seed for part in parts for seed in part.seeds]
    return Version(seeds, first.parameters, sets, _joined_draws([part.own for part in parts]), first.interaction)


def _joined_draws(parts: Sequence[Drawn | None]) -> Drawn | None:
    known = [part for part in parts if part is not None]
    if len(known) < len(parts) or len({part.tarp.shape[1] for part in known}) > 1:
        return None
    ranks, tarp, held = (_together([getattr(part, key) for part in known]) for key in ("ranks", "tarp", "inside"))
    assert ranks is not None and tarp is not None
    return Drawn(known[0].count, ranks, tarp, held)


def _together(parts: Sequence[np.ndarray | None]) -> np.ndarray | None:
    known = [part for part in parts if part is not None]
    return np.concatenate(known) if len(known) == len(parts) else None


def experiment_of(paths: Sequence[str | Path]) -> str:
    """The experiment of the first of some forecasts.npz."""
    return str(read_npz(paths[0], "forecast file", REMEDY, ["version"])["version"][0])

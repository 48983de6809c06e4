"""What is known of single windows: errors, misfits and estimates of every version, with the seeds of all groups."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from expertaug.errors import InputError
from expertaug.evaluation.forecasts import REMEDY, Forecasts, SetForecasts
from expertaug.evaluation.summary import in_domain


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
        median: squared error of the median over the seeds of each of G groups, (G, N); None of single seeds.
        id: where they come from, (N,) texts; None of simulated ones.
    """

    errors: np.ndarray
    misfit: np.ndarray
    z_e: np.ndarray
    z_e_hat: np.ndarray | None
    z_a: np.ndarray | None = None
    drawn: Drawn | None = None
    expected: np.ndarray | None = None
    moved: np.ndarray | None = None
    median: np.ndarray | None = None
    id: np.ndarray | None = None


@dataclass(frozen=True)
class VersionWindows:
    """All windows of a version, of the seeds that could be trained.

    Attributes:
        experiment: that they are of.
        seeds: S of them.
        parameters: names of the expert parameters.
        sets: by name.
        interaction: names of the true interaction's parameters, where they are known.
        own: of windows that the version's models have made themselves, where they were drawn.
        path: of the first of its files.
    """

    experiment: str
    seeds: list[int]
    parameters: list[str]
    sets: dict[str, WindowSet]
    own: Drawn | None = None
    interaction: tuple[str, ...] = ()
    path: Path | None = field(default=None, compare=False)

    @property
    def judged(self) -> list[str]:
        """The set of the training's domain and the shifted one, where they are there."""
        return [name for name in (in_domain(self.sets), "test") if name in self.sets]


def windows_of(forecasts: Iterable[Forecasts]) -> dict[str, VersionWindows]:
    """Versions by name.

    Arguments:
        forecasts: of all versions and groups of seeds of an experiment, each of which is needed but once.

    Raises:
        InputError: they do not say whose they are, or are from before errors of single windows were kept.
    """
    parts: dict[str, list[VersionWindows]] = {}
    for of_group in forecasts:
        method = of_group.identified().method
        if "test" not in of_group.sets or of_group.sets["test"].misfit is None:
            raise InputError(of_group.path or "forecasts", "no array 'test_misfit'", REMEDY)
        parts.setdefault(method, []).append(_of_trained_seeds(of_group))
    return {name: _join(several) for name, several in parts.items()}


def none_shown(versions: Mapping[str, VersionWindows]) -> InputError:
    """What is wrong where none of the versions is among those that a study shows."""
    paths = [version.path for version in versions.values() if version.path is not None]
    return InputError(paths[0] if paths else "forecasts", "no version has windows", "evaluate them again")


def _of_trained_seeds(forecasts: Forecasts) -> VersionWindows:
    good, count = forecasts.places, forecasts.rank_draws or 0
    sets = {
        name: _windows(set_forecasts, good, count)
        for name, set_forecasts in forecasts.sets.items()
        if set_forecasts.misfit is not None
    }
    return VersionWindows(
        forecasts.identified().experiment,
        [forecasts.seeds[place] for place in good],
        forecasts.parameter_names,
        sets,
        None if forecasts.own is None else _score_draws(forecasts.own, good, count),
        tuple(forecasts.interaction_names),
        forecasts.path,
    )


def _windows(set_forecasts: SetForecasts, good: list[int], count: int) -> WindowSet:
    """A set's windows, of some of the seeds, without those after which nothing was measured."""
    assert set_forecasts.errors is not None and set_forecasts.misfit is not None and set_forecasts.z_e is not None
    errors = set_forecasts.errors[good]
    measured = ~np.isnan(errors).all(0) if len(errors) else np.ones(errors.shape[1], dtype=bool)

    def of_seeds(values: np.ndarray | None) -> np.ndarray | None:
        return None if values is None else values[good][:, measured]

    drawn = _score_draws(set_forecasts, good, count)
    return WindowSet(
        errors[:, measured],
        set_forecasts.misfit[good][:, measured],
        set_forecasts.z_e[measured],
        of_seeds(set_forecasts.z_e_hat),
        None if set_forecasts.z_a is None else set_forecasts.z_a[measured],
        drawn and replace(drawn, ranks=drawn.ranks[:, measured], tarp=drawn.tarp[:, measured]),
        of_seeds(set_forecasts.expected),
        of_seeds(set_forecasts.moved),
        None if set_forecasts.median is None else set_forecasts.median[None, measured],
        None if set_forecasts.sample_id is None else set_forecasts.sample_id[measured],
    )


def _score_draws(set_forecasts: SetForecasts, good: list[int], count: int) -> Drawn | None:
    """What a set's draws are worth, of some of the seeds; None where there are no ranks."""
    if set_forecasts.ranks is None or set_forecasts.tarp is None:
        return None
    inside = None if set_forecasts.inside is None else set_forecasts.inside[good]
    if inside is not None and (unmeasured := np.isnan(inside).any((0, 2))).any():
        inside = inside[:, ~unmeasured]
    return Drawn(count, set_forecasts.ranks[good], set_forecasts.tarp[good], inside)


def _join(parts: Sequence[VersionWindows]) -> VersionWindows:
    """Groups of seeds of a version, as one."""
    first = parts[0]
    if len(parts) == 1:
        return first
    sets = {}
    for name, window_set in first.sets.items():
        each = [part.sets[name] for part in parts]
        sets[name] = replace(
            window_set,
            errors=np.concatenate([s.errors for s in each]),
            misfit=np.concatenate([s.misfit for s in each]),
            z_e_hat=_together([s.z_e_hat for s in each]),
            drawn=_join_draws([s.drawn for s in each]),
            expected=_together([s.expected for s in each]),
            moved=_together([s.moved for s in each]),
            median=_together([s.median for s in each]),
        )
    seeds = [seed for part in parts for seed in part.seeds]
    return replace(first, seeds=seeds, sets=sets, own=_join_draws([part.own for part in parts]))


def _join_draws(parts: Sequence[Drawn | None]) -> Drawn | None:
    present = [part for part in parts if part is not None]
    if len(present) < len(parts) or len({part.tarp.shape[1] for part in present}) > 1:
        return None
    return Drawn(
        present[0].count,
        np.concatenate([part.ranks for part in present]),
        np.concatenate([part.tarp for part in present]),
        _together([part.inside for part in present]),
    )


def _together(parts: Sequence[np.ndarray | None]) -> np.ndarray | None:
    """Arrays of several groups of seeds, as one; None where one of them has none."""
    present = [part for part in parts if part is not None]
    return np.concatenate(present) if len(present) == len(parts) else None

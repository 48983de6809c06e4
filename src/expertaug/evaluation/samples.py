"""Errors of single samples: what evaluate keeps of them, and statistics of many runs that are resampled alike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from expertaug.errors import InputError
from expertaug.evaluation.intervals import Interval, Resampled, interval, units_of
from expertaug.evaluation.metrics import SampleErrors, metric_of
from expertaug.files import read_npz
from expertaug.inference.diagnostics.calibration import calibration
from expertaug.trajectories import Trajectories

if TYPE_CHECKING:  # tables are made without torch
    from torch import Tensor

VERSION = ("experiment", "preset", "method")  # what tells one forecasts.npz from another, but for its seeds
OWN = "own"  # the set of a model's own windows
CRPS, INSIDE = "crps", "inside"
RANKS, TARP, DRAWS = "ranks", "tarp", "rank_draws"  # the last is no set's
# Arrays of a set: <set>_<name>.
ERRORS, MISFIT, TRUTH, LATENT, ESTIMATE, IDENTITY = "errors", "misfit", "z_e", "z_a", "z_e_hat", "sample_id"
MOVED, EXPECTED = "moved", "expected"  # see .drawn_forecasts
REMEDY = "make it again with evaluate"
Key = tuple[str, str, str]  # as VERSION


def ranks_of(name: str, z_e: np.ndarray, draws: Tensor | None) -> dict[str, np.ndarray]:
    """Where the true z_e, (N, P) or each seed's own (S, N, P), lies among draws (S, N, K, P): <set>_ranks (S, N, P),
    <set>_tarp (S, N), and rank_draws, K; nothing where a true one is not known."""
    if draws is None or not z_e.shape[-1] or np.isnan(z_e).any():
        return {}
    true = np.broadcast_to(z_e, (len(draws), *z_e.shape[-2:]))
    pairs = zip(draws, true, strict=True)
    each = [calibration(one.movedim(1, 0).double().nan_to_num().numpy(), own) for one, own in pairs]
    ranks, tarp = (np.stack([getattr(one, key) for one in each]) for key in ("marginal", "tarp"))
    return {f"{name}_{RANKS}": ranks, f"{name}_{TARP}": tarp, DRAWS: np.array(draws.shape[2])}


def arrays_of(name: str, truth: Trajectories, errors: Tensor, z_e: Tensor | None) -> dict[str, np.ndarray]:
    """What a forecasts.npz holds of every sample of a set: <set>_errors (S, N), _z_e (N, P), _z_a (N, Q) where it is
    known, _sample_id (N,) where the samples have one, and _z_e_hat (S, N, P) where the model estimates, of all sets but
    train."""
    arrays = {f"{name}_{ERRORS}": errors.float().numpy(), f"{name}_{TRUTH}": truth.z_e}
    if truth.z_a.shape[1]:
        arrays[f"{name}_{LATENT}"] = truth.z_a
    if z_e is not None and name != "train":
        arrays[f"{name}_{ESTIMATE}"] = z_e.numpy()
    return arrays if truth.id is None else arrays | {f"{name}_{IDENTITY}": truth.id}


@dataclass(frozen=True)
class _Set(SampleErrors):
    """A set's errors, and what is resampled as a whole: units (N,)."""

    units: np.ndarray
    by_recording: bool


class Samples:
    """Errors of every sample of all runs of one or several experiments.

    Arguments:
        paths: forecasts.npz of every method and group of seeds.

    Raises:
        InputError: a file is broken or from before samples' errors were kept, or two of one version have other samples.
    """

    def __init__(self, paths: Sequence[str | Path]) -> None:
        parts: dict[Key, list[tuple[str | Path, list[int], dict[str, _Set]]]] = {}
        for path in paths:
            key, seeds, found = _read(path)
            parts.setdefault(key, []).append((path, seeds, found))
        self._sets = {key: _joined(several) for key, several in parts.items()}
        self._seeds = {key: np.array([seed for _, seeds, _ in part for seed in seeds]) for key, part in parts.items()}
        self._made: dict[tuple[Key, str, str], tuple[np.ndarray, Resampled] | None] = {}

    def by_recording(self, experiment: str) -> bool:
        """Whether an experiment's samples are chunks of recordings."""
        found = [one for key, sets in self._sets.items() if key[0] == experiment for one in sets.values()]
        return any(one.by_recording for one in found)

    def estimates_unknown(self, key: Key, name: str) -> bool:
        """Whether a version estimates parameters whose truth nobody knows on a set (estimates on train are not kept:
        there, whether it is so on all others)."""
        sets = self._sets.get(key, {})
        unknown = {
            n: bool(np.isnan(one.relative).all())
            for n, one in sets.items()
            if one.relative is not None and one.parameters
        }
        return unknown.get(name, bool(unknown) and all(unknown.values()))

    def resampled(self, key: Key, name: str, metric: str) -> Resampled | None:
        """A metric of a version on a set, of the seeds with a finite value; None where no samples are kept of it."""
        found = self._of(key, name, metric)
        return None if found is None else found[1]

    def difference(self, key: Key, reference: Key, name: str, metric: str) -> Interval | None:
        """How much lower a version's metric is than another's, of the seeds that both have, sample by sample; None
        where one of them is not there, or no seed is common."""
        own, other = self._of(key, name, metric), self._of(reference, name, metric)
        if own is None or other is None or own[1].units != other[1].units:
            return None
        common = np.intersect1d(own[0], other[0])
        if not len(common):
            return None
        mine, theirs = (one.of([int(np.flatnonzero(seeds == s)[0]) for s in common]) for seeds, one in (own, other))
        return interval(theirs - mine)

    def _of(self, key: Key, name: str, metric: str) -> tuple[np.ndarray, Resampled] | None:
        metric = metric_of(metric).like or metric
        if (key, name, metric) not in self._made:
            self._made[key, name, metric] = self._make(key, name, metric)
        return self._made[key, name, metric]

    def _make(self, key: Key, name: str, metric: str) -> tuple[np.ndarray, Resampled] | None:
        one = self._sets.get(key, {}).get(name)
        described = metric_of(metric)
        chosen = None if one is None else described.samples(one, described.of)
        if one is None or chosen is None:
            return None
        statistic, values = chosen
        told = np.isfinite(values).any(0)  # not of samples of which nothing was measured, or no parameter is known
        if not told.any():
            return None
        values, units = values[:, told], one.units[told]
        finite = np.isfinite(values).all(1)
        if not finite.any():
            return None
        return self._seeds[key][finite], statistic(values[finite].astype(float), units)


def _read(path: str | Path) -> tuple[Key, list[int], dict[str, _Set]]:
    """Version, seeds and sets of one file."""
    arrays = read_npz(path, "forecast file", REMEDY)
    if missing := [name for name in ("version", "seeds", "parameter_names") if name not in arrays]:
        raise InputError(path, f"no array {missing[0]!r}", REMEDY)
    experiment, preset, method = map(str, arrays["version"])
    end, found = f"_{ERRORS}", {}
    for name in (one.removesuffix(end) for one in arrays if one.endswith(end)):
        errors, estimate = arrays[f"{name}{end}"], arrays.get(f"{name}_{ESTIMATE}")
        relative = None
        if estimate is not None:
            truth = arrays[f"{name}_{TRUTH}"]
            with np.errstate(divide="ignore", invalid="ignore"):
                relative = 100 * np.abs((estimate - truth) / truth)
        identity = arrays.get(f"{name}_{IDENTITY}")
        units = units_of(identity, errors.shape[1])
        found[name] = _Set(errors, relative, list(map(str, arrays["parameter_names"])), units, identity is not None)
    return (experiment, preset, method), [int(seed) for seed in arrays["seeds"]], found


def _joined(parts: Sequence[tuple[str | Path, list[int], dict[str, _Set]]]) -> dict[str, _Set]:
    """Sets of all groups of seeds of a version."""
    path, _, first = parts[0]
    for other, _, sets in parts[1:]:
        if {n: one.errors.shape[1] for n, one in sets.items()} != {n: one.errors.shape[1] for n, one in first.items()}:
            raise InputError(other, f"other samples than {path}", "make both again with evaluate")
    joined = {}
    for name, one in first.items():
        several = [sets[name] for _, _, sets in parts]
        relative = None
        if one.relative is not None:
            relative = np.concatenate([s.relative for s in several if s.relative is not None])
        joined[name] = _Set(
            np.concatenate([s.errors for s in several]), relative, one.parameters, one.units, one.by_recording
        )
    return joined

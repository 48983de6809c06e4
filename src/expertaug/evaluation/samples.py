"""Errors of single samples: statistics of many runs that are resampled alike."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from expertaug.errors import InputError
from expertaug.evaluation.forecasts import Forecasts, VersionKey
from expertaug.evaluation.intervals import Interval, Resampled, interval, standard_error, units_of
from expertaug.evaluation.metrics import SampleErrors, metric_of


@dataclass(frozen=True)
class _Set(SampleErrors):
    """A set's errors, and what is resampled as a whole: units (N,)."""

    units: np.ndarray
    by_recording: bool


class Samples:
    """Errors of every sample of all runs of one or several experiments.

    Arguments:
        forecasts: of every method and group of seeds.

    Raises:
        InputError: a file is from before samples' errors were kept, or two of one version have other samples.
    """

    def __init__(self, forecasts: Iterable[Forecasts]) -> None:
        parts: dict[VersionKey, list[Forecasts]] = {}
        for loaded in forecasts:
            parts.setdefault(loaded.identified(), []).append(loaded)
        self._sets = {key: _join(several) for key, several in parts.items()}
        self._seeds = {key: np.array([seed for group in part for seed in group.seeds]) for key, part in parts.items()}
        self._made: dict[tuple[VersionKey, str, str], tuple[np.ndarray, Resampled] | None] = {}

    def by_recording(self, experiment: str) -> bool:
        """Whether an experiment's samples are chunks of recordings."""
        sample_sets = [
            sample_set
            for key, sets in self._sets.items()
            if key.experiment == experiment
            for sample_set in sets.values()
        ]
        return any(sample_set.by_recording for sample_set in sample_sets)

    def estimates_unknown(self, key: VersionKey, name: str) -> bool:
        """Whether a version estimates parameters whose truth nobody knows on a set (estimates on train are not kept:
        there, whether it is so on all others)."""
        sets = self._sets.get(key, {})
        unknown = {
            n: bool(np.isnan(sample_set.relative).all())
            for n, sample_set in sets.items()
            if sample_set.relative is not None and sample_set.parameters
        }
        return unknown.get(name, bool(unknown) and all(unknown.values()))

    def resampled(self, key: VersionKey, name: str, metric: str) -> Resampled | None:
        """A metric of a version on a set, of the seeds with a finite value; None where no samples are kept of it."""
        seeds_and_metric = self._of(key, name, metric)
        return None if seeds_and_metric is None else seeds_and_metric[1]

    def difference(self, key: VersionKey, reference: VersionKey, name: str, metric: str) -> Interval | None:
        """How much lower a version's metric is than another's, of the seeds that both have, sample by sample; None
        where one of them is not there, or no seed is common."""
        pairs = self._pairs(key, reference, name, metric)
        return None if pairs is None else interval(pairs)

    def behind(self, key: VersionKey, reference: VersionKey, name: str, metric: str) -> tuple[float, float] | None:
        """How much higher a version's metric is than another's, and the standard error of that; as
        :meth:`difference`."""
        pairs = self._pairs(reference, key, name, metric)
        return None if pairs is None else (float(pairs.value.mean()), standard_error(pairs))

    def _pairs(self, key: VersionKey, reference: VersionKey, name: str, metric: str) -> Resampled | None:
        own, other = self._of(key, name, metric), self._of(reference, name, metric)
        if own is None or other is None or own[1].units != other[1].units:
            return None
        common = np.intersect1d(own[0], other[0])
        if not len(common):
            return None
        mine, theirs = (
            resampled.of([int(np.flatnonzero(seeds == s)[0]) for s in common]) for seeds, resampled in (own, other)
        )
        return theirs - mine

    def _of(self, key: VersionKey, name: str, metric: str) -> tuple[np.ndarray, Resampled] | None:
        metric = metric_of(metric).like or metric
        if (key, name, metric) not in self._made:
            self._made[key, name, metric] = self._make(key, name, metric)
        return self._made[key, name, metric]

    def _make(self, key: VersionKey, name: str, metric: str) -> tuple[np.ndarray, Resampled] | None:
        sample_set = self._sets.get(key, {}).get(name)
        described = metric_of(metric)
        chosen = None if sample_set is None else described.samples(sample_set, described.of)
        if sample_set is None or chosen is None:
            return None
        statistic, values = chosen
        usable = np.isfinite(values).any(0)  # not of samples of which nothing was measured, or no parameter is known
        if not usable.any():
            return None
        values, units = values[:, usable], sample_set.units[usable]
        finite = np.isfinite(values).all(1)
        if not finite.any():
            return None
        return self._seeds[key][finite], statistic(values[finite].astype(float), units)


def _sets(forecasts: Forecasts) -> dict[str, _Set]:
    """A file's sets whose samples' errors are kept."""
    sets = {}
    for name, set_forecasts in forecasts.sets.items():
        if set_forecasts.errors is None:
            continue
        relative = None
        if set_forecasts.z_e_hat is not None and set_forecasts.z_e is not None:
            with np.errstate(divide="ignore", invalid="ignore"):
                relative = 100 * np.abs((set_forecasts.z_e_hat - set_forecasts.z_e) / set_forecasts.z_e)
        units = units_of(set_forecasts.sample_id, set_forecasts.errors.shape[1])
        sets[name] = _Set(
            set_forecasts.errors, relative, forecasts.parameter_names, units, set_forecasts.sample_id is not None
        )
    return sets


def _join(parts: Sequence[Forecasts]) -> dict[str, _Set]:
    """Sets of all groups of seeds of a version."""
    first, *others = [_sets(part) for part in parts]
    for part, sets in zip(parts[1:], others, strict=True):
        if _sizes(sets) != _sizes(first):
            path = part.path or Path("forecasts")
            raise InputError(path, f"other samples than {parts[0].path}", "make both again with evaluate")
    joined = {}
    for name, sample_set in first.items():
        each = [sample_set, *(sets[name] for sets in others)]
        relative = [s.relative for s in each if s.relative is not None]
        joined[name] = _Set(
            np.concatenate([s.errors for s in each]),
            np.concatenate(relative) if sample_set.relative is not None else None,
            sample_set.parameters,
            sample_set.units,
            sample_set.by_recording,
        )
    return joined


def _sizes(sets: dict[str, _Set]) -> dict[str, int]:
    return {name: sample_set.errors.shape[1] for name, sample_set in sets.items()}

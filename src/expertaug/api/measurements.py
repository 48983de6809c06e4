"""Measurements of one's own in Python: tables become chunks, and these training, validation and test sets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike, fspath
from typing import TypeAlias

from expertaug import systems
from expertaug.measurements.cut import Measured, all_chunks, measure, sets_of
from expertaug.measurements.horizons import long_set
from expertaug.measurements.settings import MeasurementSettings
from expertaug.systems import System
from expertaug.trajectories import Trajectories

Paths: TypeAlias = str | PathLike | Sequence[str | PathLike]
# A column's name, or {name, unit, factor, offset}.
Column: TypeAlias = str | Mapping[str, object]


def read_measurements(
    paths: Paths, system: System, *, columns: Mapping[str, Column], length: int, **settings: object
) -> Trajectories:
    """Chunks of measured trajectories.

    Arguments:
        paths: files or globs: CSV, Parquet or NPZ; they are never changed.
        system: whose components the columns are.
        columns: component of the state → its column; components without one are masked.  Of a driven system
            ``inputs``, among the settings, does so for its known inputs.
        length: points of a chunk.
        settings: time, trajectory, z_e, angles, step_s, uneven, stride …: those of
            :class:`expertaug.measurements.settings.MeasurementSettings` but for ``split``.

    Returns:
        y with a mask of what was measured, known inputs u of a driven system, z_e (NaN where not known), id (trajectory
        and row), and the noise as estimated from how rough the columns are.

    Raises:
        InputError: a file, a column, a time or a setting cannot be used.
    """
    return all_chunks(_read(paths, system, columns, length, settings))


def split_measurements(
    paths: Paths,
    system: System,
    *,
    columns: Mapping[str, Column],
    length: int,
    split: Mapping[str, object],
    **settings: object,
) -> dict[str, Trajectories]:
    """The same divided into train, validation and test; no point is in two of them.

    With ``horizons_s`` come further sets of longer chunks from the validation and the test points, as ``test_2s``.

    Arguments:
        split: how, {by: random, time, quantity, file or column, …}:
            :class:`expertaug.measurements.settings.SplitSettings`.

    Raises:
        InputError: as :func:`read_measurements`, or a set has fewer than ``min_chunks`` chunks (here 1 by default).
    """
    data = _read(paths, system, columns, length, {"min_chunks": 1, **settings, "split": dict(split)})
    return sets_of(data)[0] | {name: long_set(data, name) for name in data.settings.horizons}


def _read(
    paths: Paths, system: System, columns: Mapping[str, Column], length: int, settings: Mapping[str, object]
) -> Measured:
    several = [paths] if isinstance(paths, str | PathLike) else list(paths)
    stride = min(length, 5)
    defaults = {"stride": stride, "evaluation_stride": length, **settings}
    defaults |= {"paths": [fspath(path) for path in several], "columns": dict(columns), "length": length}
    data = measure(MeasurementSettings.from_mapping(defaults), systems.names(system))
    data.warn_of_slopes()
    data.warn_of_short()
    return data

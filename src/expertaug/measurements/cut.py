"""Chunks of measured trajectories, divided into train, validation and test."""

from __future__ import annotations

import fnmatch
import logging
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from expertaug.errors import InputError
from expertaug.measurements.chunks import choose_chunks, rows_of, space_out, stride_of, thin_out
from expertaug.measurements.grid import Grid, Series, describe_uneven, on_grid
from expertaug.measurements.names import Names
from expertaug.measurements.noise import noise_of, noise_of_rows
from expertaug.measurements.paths import list_files, verify
from expertaug.measurements.sensors import resolution, stands_still
from expertaug.measurements.settings import MeasurementSettings, column_of, label_of
from expertaug.measurements.slopes import Off, slopes_off
from expertaug.measurements.splitting import (
    SPLITS,
    keep_apart,
    label_at_random,
    label_by_level,
    label_by_time,
    stretches,
)
from expertaug.measurements.table import Table
from expertaug.measurements.trajectory import WHERE, read
from expertaug.measurements.units import time_unit
from expertaug.trajectories import Trajectories

logger = logging.getLogger(__name__)
FEW_LOST = 0.01  # of the rows that no chunk can hold, which is not told
BLOCK = 2**17  # points of chunks that are looked at together


@dataclass(frozen=True)
class Source:
    """How messages call what is cut.

    Attributes:
        keys, split: keys that say how it is cut, and how it is divided.
        series, points: what there are several of, and what each consists of.
        more: what there should be more of where a set has too few chunks.
        longer: what else helps where the chunks are too long.
    """

    keys: str = WHERE
    split: str = f"{WHERE}.split"
    series: str = "trajectories"
    points: str = "points"
    more: str = "measurements, a lower min_seen"
    longer: str = "a larger longest_gap"


@dataclass(frozen=True)
class Measured:
    """What the files hold.

    Attributes:
        files: read, in natural order.
        names: of the system.
        settings: how they were read.
        grid: all trajectories.
        noise: standard deviation of each component's noise, (K,), at least that of its sensor's resolution, NaN where
            it cannot be told; None where it is not asked for.
        source: how messages call it.
        nearer: whether a set with too few chunks has them begin nearer to each other.
        resolution: the step of each component's sensor, (K,), where it makes most of the noise, else NaN; None where
            it is not asked for.
    """

    files: list[Path]
    names: Names
    settings: MeasurementSettings
    grid: Grid
    noise: np.ndarray | None
    source: Source = Source()
    nearer: bool = False
    resolution: np.ndarray | None = None

    @property
    def seen(self) -> np.ndarray:
        """Components that have a column, (K,)."""
        return np.array([name in self.settings.columns for name in self.names.state])

    def warn_of_slopes(self) -> None:
        """Tell of each of them, where the system says what is whose rate of change."""
        for mismatch in self.slopes_off() if self.names.rates else ():
            logger.warning("%s", mismatch.says(self.settings))

    def slopes_off(self) -> list[Off]:
        """Columns that are not the slope of the column whose rate of change they are
        (:mod:`expertaug.measurements.slopes`)."""
        return slopes_off(self.settings, list(self.names.state), self.grid.series, self.names.rates)

    def told_rates(self) -> str:
        """What is said of expert parameters that are no rates per second although times are read in s; else empty."""
        column = column_of(self.settings.time)
        rates = {name: said for name, unit in self.names.parameters.items() if (said := time_unit(unit))}
        if not rates or column.unit in (None, "s"):
            return ""
        name, unit = next(iter(rates.items()))
        problem = f"times are converted to s, but the system has {name} in {self.names.parameters[name]}"
        remedy = f"give the system's parameters in s instead of {unit}, or let the numbers be (unit: s) and read {unit}"
        return f"{problem}: {remedy} where keys and figures say s"

    def told_late(self, rows: Iterable[np.ndarray]) -> str:
        """What is said of chunks (N, 2) that do not begin where t does, of an expert that depends on it; else empty."""
        begins = np.concatenate(list(rows))[:, 1]
        if not self.names.timed or not begins.any():
            return ""
        late = f"{np.count_nonzero(begins)} of {len(begins)} begin later in their trajectory"
        remedy = "give whole: true, or what it depends on as a known input"
        return f"the system's expert depends on t, which counts from a chunk's first point, and {late}: {remedy}"

    def told_short(self) -> str:
        """What is said of rows that no chunk can hold, whatever the split; else empty."""
        span, total, lost = (self.settings.length - 1) * self.grid.step + 1, 0, 0
        if self.settings.whole:
            since = np.concatenate([of.rows.t - of.rows.t[0] for of in self.grid.series])
            total, lost = len(since), int((since > (self.settings.length - 0.5) * self.grid.step_s).sum())
            where = f"beyond the {self.settings.length} points of a chunk: give a larger length"
            return f"{lost} of {total} rows lie {where}" if lost else ""
        for trajectory in self.grid.series:
            measured_rows = (trajectory.row >= 0) & np.isfinite(trajectory.y).any(1)
            total += int(measured_rows.sum())
            lost += sum(int(measured_rows[a:b].sum()) for a, b in stretches(trajectory.usable) if b - a < span)
        if lost <= FEW_LOST * total:
            return ""
        where = f"stretches shorter than the {self.settings.length} points of a chunk, so that none holds them"
        return f"{lost} of {total} rows lie in {where}: give a larger longest_gap, or a smaller length"

    def warn_of_short(self) -> None:
        """Tell of rows that no chunk can hold, and of parameters in another unit of time."""
        for said in filter(None, (self.told_short(), self.told_rates())):
            logger.warning("%s", said)

    def warn_of_late(self, rows: Iterable[np.ndarray]) -> None:
        """Tell of chunks (N, 2) that do not begin where t does."""
        if said := self.told_late(rows):
            logger.warning("%s", said)

    def shares_seen(self) -> dict[str, float]:
        """In what share of the rows each component with a column was measured."""
        present = np.concatenate([np.isfinite(trajectory.rows.y) for trajectory in self.grid.series])
        return {name: float(present[:, k].mean()) for k, name in enumerate(self.names.state) if self.seen[k]}


def measure(settings: MeasurementSettings, names: Names, tables: Mapping[Path, Table] | None = None) -> Measured:
    """Read the files and put their trajectories on a grid; the files are never changed.

    Arguments:
        tables: of files that were read already, as these settings read them.

    Raises:
        InputError: a file, a column or a time cannot be used.
    """
    files = list_files(settings.files)
    if settings.checksums is not None:
        verify(files, settings.checksums)
    grid = on_grid(read(files, settings, names, tables), settings)
    for trajectory in grid.series:
        for name in settings.angles:
            _unwrap(trajectory.y, list(names.state).index(name))
        _fill_constants(trajectory, [k for k, name in enumerate(names.inputs) if name in names.constant])
    noise = _noise(grid)
    steps = _steps(grid, noise)
    return Measured(files, names, settings, grid, np.fmax(noise, steps / math.sqrt(12)), resolution=steps)


def _noise(grid: Grid) -> np.ndarray:
    if grid.share == 1:
        return noise_of([trajectory.y for trajectory in grid.series])
    return noise_of_rows(
        [(trajectory.t[trajectory.row >= 0], trajectory.y[trajectory.row >= 0]) for trajectory in grid.series]
    )


def _steps(grid: Grid, noise: np.ndarray) -> np.ndarray:
    """The step (K,) of each sensor whose noise (K,), as its roughness tells it, is below a step / √12; else NaN."""
    steps = np.full(len(noise), np.nan)
    for k in range(len(noise)):
        values = np.concatenate([trajectory.rows.y[:, k] for trajectory in grid.series])
        step = resolution(values) if stands_still(values) else None
        if step is not None and not noise[k] >= step / math.sqrt(12):
            steps[k] = step
    return steps


def _fill_constants(series: Series, places: Sequence[int]) -> None:
    """Give covariates, at their places among the inputs, the one value that a trajectory's rows have of each, at all of
    its points, in place; one that changes stays as it is, and is refused."""
    for k in places:
        values = np.unique(series.rows.u[np.isfinite(series.rows.u[:, k]), k])
        if len(values) == 1:
            series.u[:, k] = values[0]


def _unwrap(y: np.ndarray, k: int) -> None:
    """Take an angle's jumps by whole turns out, in place."""
    present = np.isfinite(y[:, k])
    y[present, k] = np.unwrap(y[present, k])


def divide(data: Measured) -> tuple[list[np.ndarray], dict[str, float] | None]:
    """Which set each point belongs to, per trajectory (n,): 0 train, 1 validation, 2 test, -1 none; and the thresholds
    of a quantity.

    Raises:
        InputError: there are too few pieces, or names that say nothing.
    """
    split, series = data.settings.split, data.grid.series
    usable, where = [trajectory.usable for trajectory in series], data.source.split
    shares, thresholds = split.shares, None
    _refuse_too_long(data)
    size = data.settings.length * data.grid.step
    sizes = None if split.pieces == "trajectories" or data.settings.whole else [size] * len(series)
    if split.by == "time":
        labels = [label_by_time(points, shares, split.reverse) for points in usable]
    elif split.by == "random":
        if data.settings.whole and len(series) < 3:
            problem, remedy = f"{len(series)} trajectories are as many chunks", "give three or more, or leave it out"
            raise InputError(f"{WHERE}.whole", problem, remedy)
        labels = label_at_random(usable, sizes, shares, split.seed, where)
    elif split.by == "quantity":
        levels = [trajectory.level for trajectory in series]
        order = shares[::-1] if split.reverse else shares
        bounds = split.thresholds
        labels, thresholds = label_by_level(usable, levels, sizes, order, split.statistic, bounds, where)  # type: ignore[arg-type]
        if split.reverse:
            labels = [np.where(label < 0, label, 2 - label) for label in labels]
    else:
        labels = _by_name(data, usable)
    guard = round(split.guard_s / data.grid.row_s)
    return [keep_apart(label, guard) for label in labels] if guard else labels, thresholds


def _refuse_too_long(data: Measured) -> None:
    """Chunks must fit into a series."""
    longest = max(b - a for trajectory in data.grid.series for a, b in [(0, 0), *stretches(trajectory.usable)])
    points = (longest - 1) // data.grid.step + 1
    if points < data.settings.length:
        source = data.source
        what = "trajectory" if source.series == "trajectories" else "recording"
        problem = f"found {data.settings.length}, the longest {what} without a long gap has {points} points"
        raise InputError(f"{source.keys}.length", problem, _off_grid_or(data, f"give fewer, or {source.longer}"))


def _off_grid_or(data: Measured, remedy: str) -> str:
    """What would help: where rows lie off the grid, or sensors have rates of their own, nothing else does."""
    if said := describe_uneven(data.grid):
        return said
    shares = data.shares_seen() if data.grid.share == 1 else {}
    if shares and (mean := sum(shares.values()) / len(shares)) < data.settings.min_seen:
        listed = ", ".join(f"{name} in {100 * share:.0f} %" for name, share in shares.items())
        return f"measured is {listed} of the rows: set min_seen below {mean:.2g}"
    return remedy


def _by_name(data: Measured, usable: list[np.ndarray]) -> list[np.ndarray]:
    """Labels by the files' names, or by the values of a column."""
    split, labels = data.settings.split, []
    values: dict[str, None] = {}
    for trajectory, free in zip(data.grid.series, usable, strict=True):
        texts = np.full(len(free), _name_of(trajectory)) if split.by == "file" else _fill(trajectory)
        label = np.full(len(free), -1, dtype=np.int8)
        for value in dict.fromkeys(texts):
            values[str(value)] = None
            fitting = [
                k for k, name in enumerate(SPLITS) if _fits(str(value), trajectory, split.values(name), split.by)
            ]
            if len(fitting) > 1:
                names = " and ".join(SPLITS[k] for k in fitting)
                raise InputError(f"{WHERE}.split", f"'{value}' is in {names}", "each belongs to one set")
            if fitting:
                label[(texts == value) & free] = fitting[0]
        labels.append(label)
    for k, name in enumerate(SPLITS):
        if not any((label == k).any() for label in labels):
            listed = ", ".join(f"'{value}'" for value in list(values)[:10] if value)
            problem = f"no {split.by} is {' or '.join(map(repr, split.values(name)))}"
            raise InputError(f"{WHERE}.split.{name}", problem, f"there are {listed}")
    return labels


def _name_of(series: Series) -> str:
    return series.rows.path.name


def _fill(series: Series) -> np.ndarray:
    """The column's text of each point, of one without a row that of the row before."""
    assert series.label is not None
    last = np.maximum.accumulate(np.where(series.row >= 0, np.arange(len(series.row)), 0))
    return series.label[last]


def _fits(value: str, series: Series, patterns: Sequence[str], by: str) -> bool:
    if by == "column":
        return value in patterns
    path = series.rows.path
    return any(fnmatch.fnmatch(name, p) for p in patterns for name in (path.name, path.stem, str(path)))


def candidates(data: Measured, labels: list[np.ndarray]) -> dict[str, np.ndarray]:
    """Per split, the chunks that begin with a measured point, unless whole, lie on the grid and have enough of it
    measured: rows (series, first point), (N, 2)."""
    rows = {name: _of_split(data, labels, name) for name in SPLITS}
    if data.settings.whole:
        _refuse_left_out(data, labels, np.concatenate(list(rows.values()))[:, 0])
    return rows


def _refuse_left_out(data: Measured, labels: list[np.ndarray], taken: np.ndarray) -> None:
    """A trajectory that is a chunk is not left out without a word; ``taken``: places of those that are chunks."""
    for k, label in enumerate(labels):
        if (label >= 0).any() and k not in taken:
            trajectory = data.grid.series[k]
            problem, remedy = f"the rows of {trajectory.name} are of several sets", "divide whole trajectories"
            if not np.isfinite(trajectory.u).all():
                problem = f"known inputs of {trajectory.name} do not reach from its first row to the chunk's end"
                remedy = "give them there, or a smaller length"
            raise InputError(f"{WHERE}.whole", problem, remedy)


def _of_split(data: Measured, labels: list[np.ndarray], split: str) -> np.ndarray:
    """A split's chunks, (N, 2): as far apart as the settings say, or, where asked for, nearer where these are too few.

    Recordings of some hundred frames would otherwise be refused for a stride that nobody chose for them.
    """
    options = data.settings
    wanted = stride = stride_of(split, options)
    rows = _apart(data, labels, split, stride)
    while data.nearer and len(rows) < options.min_chunks and stride > 1:
        stride //= 2
        rows = _apart(data, labels, split, stride)
    if stride < wanted and len(rows) >= options.min_chunks:
        text = "the %s split's chunks begin every %d points instead of every %d, for there to be %d%s"
        overlap = ": they overlap, and intervals of its scores are too narrow" if stride < options.length else ""
        logger.warning(text, split, stride, wanted, options.min_chunks, overlap)
    return rows


def _apart(data: Measured, labels: list[np.ndarray], split: str, stride: int) -> np.ndarray:
    """A split's chunks, (N, 2), that begin so many points apart."""
    steps = [data.grid.step] * len(labels)
    if data.grid.share == 1:
        rows = rows_of(labels, steps, split, data.settings, stride)
        return rows[_good(data, rows)]
    # Between rows lie points at which no chunk can begin: of those at which one can, such as are a stride apart.
    rows = rows_of(labels, steps, split, data.settings, 1)
    return space_out(rows[_good(data, rows)], stride)


def _good(data: Measured, rows: np.ndarray) -> np.ndarray:
    """Which chunks (N,) begin with a measured point, unless whole, lie on the grid and have enough of it measured."""
    seen, h, settings = data.seen, data.grid.row_s, data.settings
    tolerance = 1.01 if data.grid.share < 1 else settings.tolerance  # both ends may be half a point off
    least, good = (0.0 if settings.whole else settings.min_seen * data.grid.share), np.zeros(len(rows), dtype=bool)
    for index in np.unique(rows[:, 0]):
        trajectory, of_series = data.grid.series[index], np.flatnonzero(rows[:, 0] == index)
        present, driven = np.isfinite(trajectory.y[:, seen]), np.isfinite(trajectory.u).all(1)
        for begin in range(0, len(of_series), max(1, BLOCK // settings.length)):
            here = of_series[begin : begin + max(1, BLOCK // settings.length)]
            first = rows[here, 1]
            points = first[:, None] + data.grid.step * np.arange(settings.length)
            off = np.abs(trajectory.t[points] - trajectory.t[first][:, None] - h * (points - first[:, None]))
            good[here] = (
                driven[points].all(1)
                & (present[first].any(1) | settings.whole)
                & (present.sum(1)[points].sum(1) / (settings.length * present.shape[1]) >= least)
                & ~(off > max(tolerance, 1e-6) * h).any(1)
            )
    return good


def trajectories_of(data: Measured, rows: np.ndarray) -> Trajectories:
    """The chunks (N, 2) of :func:`candidates`; values that were not measured are masked, unknown parameters NaN."""
    state, settings = list(data.names.state), data.settings
    y = np.full((len(rows), settings.length, len(state)), np.nan)
    z_e = np.full((len(rows), len(data.names.parameters)), np.nan)
    u, identity = np.full((len(rows), settings.length, len(data.names.inputs)), np.nan), [""] * len(rows)
    for index in np.unique(rows[:, 0]):
        trajectory, here = data.grid.series[index], rows[:, 0] == index
        first = rows[here, 1]
        points = first[:, None] + data.grid.step * np.arange(settings.length)
        y[here], u[here], z_e[here] = trajectory.y[points], trajectory.u[points], trajectory.rows.z_e
        row = trajectory.row[first]
        lines = np.where(row >= 0, trajectory.rows.line[row], first)
        for k, line in zip(np.flatnonzero(here).tolist(), lines.tolist(), strict=True):
            identity[k] = f"{trajectory.name}/{line}"
    for name in settings.angles:
        column = y[..., state.index(name)]
        begins = np.take_along_axis(column, np.isfinite(column).argmax(1)[:, None], 1)
        column -= 2 * np.pi * np.nan_to_num(np.round(begins / (2 * np.pi)))
    for k, parameter in enumerate(data.names.parameters):
        start = label_of(settings.z_e[parameter]).start if parameter in settings.z_e else None
        if start is not None:
            z_e[:, k] = y[:, 0, state.index(start)]
    for k, name in enumerate(data.names.inputs):
        changed = (u[..., k] != u[:, :1, k]).any(1)
        if name in data.names.constant and changed.any():
            problem = f"{name} changes along {identity[int(changed.argmax())]}"
            raise InputError(f"{WHERE}.inputs.{name}", problem, "a covariate is constant; declare an input")
    fields = {"id": np.array(identity)}
    if data.noise is not None:
        fields["noise"] = np.nan_to_num(data.noise)
    # Windows without a gap are what a model of them may rely on, as one of simulated sets or recordings does.
    if settings.min_seen < 1 or settings.whole or not data.seen.all():
        fields["mask"] = np.isfinite(y)
    return Trajectories(
        data.grid.times(settings.length), np.nan_to_num(y), z_e, u=u if data.names.inputs else None, **fields
    )


def chunks_of(data: Measured) -> tuple[dict[str, np.ndarray], dict[str, float] | None]:
    """The chunks (N, 2) of the three sets, and the thresholds of a quantity.

    Raises:
        InputError: a set has too few chunks.
    """
    labels, thresholds = divide(data)
    more = _off_grid_or(data, data.source.more)
    return choose_chunks(data.source.split, candidates(data, labels), data.settings, more), thresholds


class Divided(NamedTuple):
    """The three sets, their chunks (series, first point), (N, 2), and the thresholds of a quantity."""

    sets: dict[str, Trajectories]
    rows: dict[str, np.ndarray]
    thresholds: dict[str, float] | None


def sets_of(data: Measured) -> Divided:
    """Cut measurements into chunks and divide them into sets.

    Raises:
        InputError: a set has too few chunks.
    """
    rows, thresholds = chunks_of(data)
    data.warn_of_late(rows.values())
    return Divided({name: trajectories_of(data, of) for name, of in rows.items()}, rows, thresholds)


def _fewer_seen(data: Measured, labels: list[np.ndarray]) -> str:
    """What would help where no chunk has enough measured: the share that the most complete one has."""
    any_share = replace(data, settings=data.settings.model_copy(update={"min_seen": 0.0}))
    points = data.grid.step * np.arange(data.settings.length)
    shares = [
        np.isfinite(data.grid.series[series].y[first + points][:, data.seen]).mean() / data.grid.share
        for series, first in _apart(any_share, labels, "train", 1 if data.grid.share < 1 else data.settings.stride)
    ]
    if not shares:
        return "give shorter chunks"
    return f"the most complete chunk has {math.floor(100 * max(shares)) / 100:g}: give that or less, or shorter chunks"


def all_chunks(data: Measured) -> Trajectories:
    """Chunks of everything, not divided into sets, ``stride`` points from one to the next.

    Raises:
        InputError: there is none.
    """
    _refuse_too_long(data)
    labels = [np.where(trajectory.usable, 0, -1) for trajectory in data.grid.series]
    rows = candidates(data, labels)["train"]
    if not len(rows):
        also = ", its first point and all known inputs" if data.names.inputs else ", and its first point"
        problem = f"no chunk has {data.settings.min_seen:g} of its values measured{also}"
        remedy = _off_grid_or(data, _fewer_seen(data, labels))
        raise InputError(f"{WHERE}.min_seen", problem, remedy)
    data.warn_of_late([rows])
    return trajectories_of(data, thin_out(rows, data.settings.limit("train")))

"""What measurements hold: rate, gaps, ranges and noise of their columns, as text and as a picture."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from expertaug import plotting
from expertaug.errors import InputError
from expertaug.measurements.cut import Measured, measured
from expertaug.measurements.guess import Guess, guess
from expertaug.measurements.names import Names
from expertaug.measurements.paths import list_files
from expertaug.measurements.settings import MeasurementSettings, TableKeys, column_of
from expertaug.measurements.table import EMPTY, Table, count_cells, read_table
from expertaug.measurements.time_order import check_one_row_a_time, check_seconds, check_sortable
from expertaug.measurements.trajectory import times_of

COMMA = re.compile(r"[-+]?\d+(,\d+)?([eE][-+]?\d+)?")
SHOWN, POINTS = 6, 4000  # trajectories of a picture, and points of each


class Inspection:
    """Tables, and what they seem to hold.

    Arguments:
        paths: files or globs.
        names: of the system whose components the columns are; None: each column is one of its own.
        time, trajectory: columns that are known.
        units: column → unit, where they are known.

    Attributes:
        files: in natural order.
        guess: which column is what.
        settings: that read all of it; what is out of order or double is put up with.
        data: as these settings read it.
        remarks: what was put up with, and what the reader has to name.

    Raises:
        InputError: a file is no table, or holds no times.
    """

    def __init__(
        self,
        paths: Sequence[str],
        names: Names | None,
        time: str | None = None,
        trajectory: str | None = None,
        units: Mapping[str, str] | None = None,
    ) -> None:
        self.files = list_files(list(paths), "FILE")
        self.keys, self.table = _first(self.files[0])
        self.guess: Guess = guess(self.table, names, time, trajectory, units)
        self.names = names or Names(dict.fromkeys(self.guess.columns, ""), {})
        self.remarks: list[str] = []
        if self.names.inputs:
            self.remarks.append(f"to be named under inputs, with their columns: {', '.join(self.names.inputs)}")
            self.names = Names(self.names.state, self.names.parameters)
        if not self.guess.columns:
            raise InputError(self.files[0], "no column of numbers beside the times", "give a table of measurements")
        if self.guess.time.unit is None:
            check_seconds(self.table, self.guess.time.name, self.table.numbers(self.guess.time.name))
        self.settings, self.data = self._read(list(paths))

    def _read(self, paths: list[str]) -> tuple[MeasurementSettings, Measured]:
        """The strictest settings that read the files."""
        given: dict[str, object] = {
            **self.keys,
            "paths": paths,
            "time": self.guess.time,
            "trajectory": self.guess.trajectory,
            "columns": self.guess.columns,
            "length": 2,
            "stride": 1,
            "evaluation_stride": 1,
            "min_chunks": 1,
        }
        mends = [
            ({"unordered": "sort"}, "goes back", "rows are not in order of time"),
            ({"duplicates": "mean"}, "another row has its time", "rows of one time differ"),
            ({"uneven": "own"}, "off a grid", "the rows' times fit no grid"),
        ]
        while True:
            settings = MeasurementSettings.from_mapping(given)
            try:
                return settings, measured(settings, self.names, {self.files[0]: self.table})
            except InputError as error:
                mend = next((m for m in mends if m[1] in str(error)), None)
                if mend is None:
                    raise
                self._check_order(settings)
                mends.remove(mend)
                given |= mend[0]
                self.remarks.append(mend[2])

    def _check_order(self, settings: MeasurementSettings) -> None:
        """Rows are not sorted, nor averaged, where that would mix what does not belong together.

        Raises:
            InputError: the file, the row, and what to do.
        """
        used = {self.guess.time.name, *(column.name for column in self.guess.columns.values())}
        for path in self.files:
            table = read_table(path, settings)
            t = times_of(table, settings)
            if self.guess.trajectory is None:
                groups = [np.arange(len(table))]
            else:
                ids = table.texts(self.guess.trajectory)
                groups = [np.flatnonzero(ids == name) for name in dict.fromkeys(ids)]
            if self.guess.trajectory is None:
                check_one_row_a_time(table, t, used)
            check_sortable(table, t, groups)

    def lines(self) -> Iterator[str]:
        """What a reader wants to know, line by line."""
        grid, rows = self.data.grid, [one.rows for one in self.data.grid.series]
        counts = [len(one.t) for one in rows]
        spans = [float(one.t[-1] - one.t[0]) for one in rows]
        yield f"{_count(len(self.files), 'file')}, {_count(len(rows), 'trajectory')}, {_count(sum(counts), 'row')}"
        yield f"columns: {', '.join(self.table.names)}"
        unit = self.guess.time.unit or "taken as s: no unit is told"
        yield f"times: '{self.guess.time.name}' ({unit}), trajectories: {self._told()}"
        yield f"rows of a trajectory: {min(counts)} to {max(counts)}, {min(spans):.6g} to {max(spans):.6g} s"
        yield f"step: {grid.row_s:.6g} s ({1 / grid.row_s:.6g} Hz)"
        gaps = np.concatenate([np.diff(one.t) for one in rows]) / grid.row_s
        long = gaps[gaps > 1.5]
        if len(long):
            yield f"gaps: {len(long)}, up to {long.max() * grid.row_s:.4g} s ({round(long.max()) - 1} points)"
        if repeated := sum(one.repeated for one in rows):
            yield f"rows of a time that another row has: {repeated}"
        yield from self.remarks
        for k, name in enumerate(self.names.state):
            if name in self.settings.columns:
                yield self._component(k, name, np.concatenate([one.y[:, k] for one in rows]))
        if self.guess.left:
            yield f"not used: {', '.join(self.guess.left)}"
        if self.guess.unread:
            yield f"not read, as most of their cells are no numbers: {', '.join(self.guess.unread)}"

    def _component(self, k: int, name: str, values: np.ndarray) -> str:
        known, noise = values[np.isfinite(values)], self.data.noise[k]
        column = column_of(self.settings.columns[name])
        text = f"{name} (column '{column.name}'): {known.min():.6g} to {known.max():.6g}"
        text = f"{text} {self.names.state[name]}".rstrip()
        if self.names.state[name] and column.unit is None:
            text += " (taken as that: no unit is told)"
        text += f", {len(values) - len(known)} empty cells" if len(known) < len(values) else ""
        text += f", noise about {noise:.2g}" if np.isfinite(noise) else ""
        if self.data.grid.error is not None:
            text += f", interpolation from every other row is off by {self.data.grid.error[k]:.2g} (rms)"
        return text

    def _told(self) -> str:
        return "a file each" if self.guess.trajectory is None else f"by '{self.guess.trajectory}'"

    def draw(self, output: Path) -> None:
        """A picture of the first trajectories: every component against time."""
        series = self.data.grid.series[:SHOWN]
        shown = [k for k, name in enumerate(self.names.state) if name in self.settings.columns]
        with plotting.styled():
            figure = plotting.new_figure(0.6 + 1.5 * len(shown))
            axes = figure.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
            for axis, k in zip(axes, shown, strict=True):
                for one in series:
                    t, y = one.rows.t[:POINTS], one.rows.y[:POINTS, k]
                    axis.plot(t - one.rows.t[0], y, linewidth=0.6, marker=".", markersize=2)
                name = list(self.names.state)[k]
                axis.set_ylabel(plotting.quantity(name, self.names.state[name]))
            axes[-1].set_xlabel("t [s]")
            plotting.save(figure, output)


def _first(path: Path) -> tuple[dict[str, object], Table]:
    """The first file, and the keys that read it: one without a header gets names, one of 0,5 for 1/2 its comma."""
    keys: dict[str, object] = {}
    try:
        table = read_table(path, TableKeys())
    except InputError as error:
        if "holds numbers" not in str(error):
            raise
        keys["names"] = [f"c{k}" for k in range(1, count_cells(path) + 1)]
        table = read_table(path, TableKeys.from_mapping(keys))
    if any(_has_commas(cells) for cells in table.cells.values()):
        keys["decimal"] = ","
        table = read_table(path, TableKeys.from_mapping(keys))
    return keys, table


def _has_commas(cells: np.ndarray) -> bool:
    """Whether a column's cells are numbers whose fraction follows a comma."""
    if cells.dtype.kind not in "OU":
        return False
    texts = (text for cell in cells if (text := str(cell).strip()).lower() not in EMPTY)
    several = False
    for text in texts:
        if not COMMA.fullmatch(text):
            return False
        several |= "," in text
    return several


def _count(number: int, what: str) -> str:
    several = f"{what.removesuffix('y')}ies" if what.endswith("y") else f"{what}s"
    return f"{number} {what if number == 1 else several}"

"""What measurements hold: rate, gaps, ranges and noise of their columns, as text and as a picture."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from expertaug import plotting
from expertaug.errors import InputError
from expertaug.measurements import sensors
from expertaug.measurements.cut import Measured, measure
from expertaug.measurements.grid import LYING, describe_uneven
from expertaug.measurements.guess import Guess, guess
from expertaug.measurements.layout import recognise
from expertaug.measurements.names import Names
from expertaug.measurements.paths import list_files
from expertaug.measurements.settings import MeasurementSettings, TableKeys, column_of
from expertaug.measurements.table_files import read_table
from expertaug.measurements.time_order import check_one_row_a_time, check_repeats, check_seconds, check_sortable
from expertaug.measurements.trajectory import Rows, times_of
from expertaug.measurements.units import conversion, parse, time_unit

SHOWN, POINTS = 6, 4000  # trajectories of a picture, and points of each
ON = 0.95  # part of the rows on a grid, below which they are better kept at their own times
SETTABLE = {*TableKeys.model_fields, "time_format", "date", "angles", "unordered", "duplicates", "uneven"}
SETTABLE |= {"step_s", "tolerance", "longest_gap", "min_seen"}
SPARSE = 30  # rows of a trajectory, at uneven times, up to which all of them are one chunk
MOST_POINTS = 5000  # of a grid on which so few rows keep their times exactly
LARGEST_MULTIPLE = 10  # of the last digit of the times that a usual step may be, for rows to keep their times exactly


class Inspection:
    """Tables, and what they seem to hold.

    Arguments:
        paths: files or globs.
        names: of the system whose components the columns are; None: each column is one of its own.
        time, trajectory: columns that are known.
        units: column → unit, where they are known.
        given: keys of :class:`MeasurementSettings` that are known, of :data:`SETTABLE`.

    Attributes:
        files: in natural order.
        guess: which column is what.
        settings: that read all of it; what is out of order or double is put up with.
        data: as these settings read it.
        noise: standard deviation of each component's noise, (K,), at least that of its sensor's resolution.
        resolution: the step of each component's sensor, (K,), NaN where it is finer than the noise or not known.
        slopes: columns that are not the slope of the column whose rate of change they are.
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
        overrides: Mapping[str, object] | None = None,
    ) -> None:
        self.given = dict(overrides or {})
        for key in self.given:
            if key not in SETTABLE:
                raise InputError("--set", f"no key '{key}'", f"known: {', '.join(sorted(SETTABLE))}")
        self.files = list_files(list(paths), "FILE")
        single = next(iter(names.state)) if names and len(names.state) == 1 and not names.inputs else None
        layout = recognise(self.files[0], self.given, single, (time, trajectory))
        self.keys, self.table, self.remarks = layout.keys, layout.table, list(layout.remarks)
        date, time_format = (self.given.get(key) for key in ("date", "time_format"))
        self.guess: Guess = guess(self.table, names, time, trajectory, units, date, time_format)  # type: ignore[arg-type]
        self.names = names or Names(dict.fromkeys(self.guess.columns, ""), {})
        self._take_times_as_they_are()
        if self.guess.date is not None:
            self.remarks.append(f"the times are '{self.guess.date}' and '{self.guess.time.name}' together")
        if without := [name for name in self.names.inputs if name not in self.guess.inputs]:
            self.remarks.append(f"to be named under inputs, with their columns: {', '.join(without)}")
            found = {name: unit for name, unit in self.names.inputs.items() if name in self.guess.inputs}
            self.names = replace(self.names, inputs=found)
        if not self.guess.columns:
            for name in self.guess.unread:
                self.table.numbers(name)  # says which cell is none
            raise InputError(self.files[0], "no column of numbers beside the times", "give a table of measurements")
        if self.guess.time.unit is None:
            check_seconds(self.table, self.guess.time.name, self.table.numbers(self.guess.time.name))
        self._marks: list[float] = []
        self.settings, self.data = self._read(list(paths))
        self._look_at_sensors()
        if angles := self._angles():
            self.settings = self.settings.model_copy(update={"angles": angles})
            self.data = measure(self.settings, self.names, {self.files[0]: self.table})
        assert self.data.noise is not None and self.data.resolution is not None
        self.noise, self.resolution = self.data.noise, self.data.resolution
        self.slopes = self.data.slopes_off()

    def _leave_out(self, marks: Mapping[float, str]) -> None:
        """Take numbers that stand for nothing measured, and the column of each, out of the columns."""
        listed = ", ".join(f"{mark:.10g} (in '{name}')" for mark, name in marks.items())
        self.remarks.append(f"taken for marks of what was not measured (missing): {listed}; if not: --set missing=[]")
        self._marks += [mark for mark in marks if mark not in self._marks]
        self.keys["missing"] = self._marks
        self.table = replace(self.table, keys=self.table.keys.model_copy(update={"missing": self._marks}))

    def _read(self, paths: list[str]) -> tuple[MeasurementSettings, Measured]:
        """The strictest settings that read the files."""
        keys: dict[str, object] = {
            **{k: v for k, v in self.given.items() if k not in TableKeys.model_fields},
            **self.keys,
            "paths": paths,
            "time": self.guess.time,
            "trajectory": self.guess.trajectory,
            "columns": self.guess.columns,
            "inputs": self.guess.inputs,
            "length": 2,
            "stride": 1,
            "evaluation_stride": 1,
            "min_chunks": 1,
        }
        if self.guess.date is not None:
            keys["date"] = self.guess.date
        mends = [
            ({"unordered": "sort"}, "goes back", "rows are not in order of time"),
            ({"duplicates": "mean"}, "another row has its time", "rows of one time differ"),
            ({"uneven": "own"}, "off a grid", "the rows' times fit no grid"),
        ]
        while True:
            settings = MeasurementSettings.from_mapping(keys)
            try:
                data = self._without_marks(settings)
                settings = data.settings
            except InputError as error:
                mend = next((m for m in mends if m[1] in str(error) and not m[0].keys() & self.given.keys()), None)
                if mend is None:
                    raise
                self._check_order(settings, "duplicates" in mend[0])
                mends.remove(mend)
                keys |= mend[0]
                self.remarks.append(f"{mend[2]}: {error.found}" if "uneven" in mend[0] else mend[2])
                if "uneven" in mend[0]:
                    keys |= self._finest_step()
                continue
            said = describe_uneven(data.grid)
            if said:
                self.remarks.append(said)
            if data.grid.lying >= (ON if data.grid.broken else LYING) or "uneven" in keys or self.names.held:
                return self._with_fewer_seen(data)
            keys |= {"uneven": "own"} | self._finest_step()

    def _without_marks(self, settings: MeasurementSettings) -> Measured:
        """What these settings read, without what a column of any of the files has in place of measured numbers."""
        while True:
            try:
                return measure(settings, self.names, {self.files[0]: self.table})
            except sensors.Marked as error:
                self._leave_out(error.marks)
                keys = settings.model_dump(exclude_unset=True) | {"missing": self._marks}
                settings = MeasurementSettings.from_mapping(keys)

    def _with_fewer_seen(self, data: Measured) -> tuple[MeasurementSettings, Measured]:
        """The same with a ``min_seen`` that the most complete chunks have, where sensors have rates of their own."""
        shares = data.shares_seen()
        total = sum(shares.values()) / len(shares)
        if total >= data.settings.min_seen or "min_seen" in self.given:
            return data.settings, data
        least = float(f"{0.9 * total:.1g}")
        listed = ", ".join(f"{name} in {100 * share:.0f} %" for name, share in shares.items())
        self.remarks.append(f"measured is {listed} of the rows: min_seen is {least:g}")
        settings = data.settings.model_copy(update={"min_seen": least})
        return settings, replace(data, settings=settings)

    def _finest_step(self) -> dict[str, float]:
        """The key ``step_s`` of rows that keep their times: the last digit of these, where that is not too fine."""
        column = self.guess.time
        if "step_s" in self.given or column.unit == "datetime":
            return {}
        values = self.table.numbers(column.name)
        digit = sensors.last_digit(np.unique(values))
        of = self.guess.trajectory
        groups = [slice(None)] if of is None else list(self.table.kinds(of).rows().values())
        apart = np.concatenate([np.diff(np.unique(values[rows])) for rows in groups])
        if digit is None or not len(apart) or np.median(apart) < 2 * digit:
            return {}
        sparse = max(len(np.unique(values[rows])) for rows in groups) <= SPARSE
        longest = max(np.ptp(values[rows]) for rows in groups)
        if longest > MOST_POINTS * digit if sparse else np.median(apart) > LARGEST_MULTIPLE * digit:
            return {}
        factor, _ = conversion(column.unit, "s", "time")
        return {"step_s": float(f"{digit * column.factor * factor:.9g}")}

    def _check_order(self, settings: MeasurementSettings, averages: bool) -> None:
        """Rows are not sorted, nor averaged, where that would mix what does not belong together.

        Raises:
            InputError: the file, the row, and what to do.
        """
        used = {self.guess.time.name, *(column.name for column in self.guess.columns.values())}
        used |= {self.guess.date} if self.guess.date is not None else set()
        for path in self.files:
            table = read_table(path, settings)
            t = times_of(table, settings)
            if self.guess.trajectory is None:
                groups = [np.arange(len(table))]
            else:
                groups = list(table.kinds(self.guess.trajectory).rows().values())
            if self.guess.trajectory is None:
                check_one_row_a_time(table, t, used)
            check_sortable(table, t, groups)
            if averages:
                check_repeats(table, t, [table.measured(column.name) for column in self.guess.columns.values()])

    def _look_at_sensors(self) -> None:
        """Remark what is odd."""
        for k, name in enumerate(self.names.state):
            if name not in self.settings.columns:
                continue
            column = column_of(self.settings.columns[name]).name
            each: dict[Path, list[Rows]] = {}
            for trajectory in self.data.grid.series:
                each.setdefault(trajectory.rows.path, []).append(trajectory.rows)
            for path, trajectories in each.items():
                values = np.concatenate([rows.y[:, k] for rows in trajectories])
                line = np.concatenate([rows.line for rows in trajectories])
                self.remarks += self._oddities(f"'{column}'", values, line, f" in {path.name}" if len(each) > 1 else "")

    @staticmethod
    def _oddities(column: str, values: np.ndarray, line: np.ndarray, where: str) -> Iterator[str]:
        """What is odd about a column's numbers (n,) of the rows ``line`` of a file."""
        if held := sensors.rows_held(values):
            yield (
                f"{column} changes every {held} rows alone{where}, as one that is held between its readings: leave the "
                "repeated cells empty"
            )
            return
        stuck = sensors.rows_stuck(values)
        if stuck is not None:
            yield (
                f"{column} stays at {stuck[1]:.6g}, an end of its range{where}, for up to {stuck[0]} rows: if its "
                "sensor is saturated there, leave these cells empty"
            )
        if (frozen := sensors.rows_frozen(values)) and (stuck is None or stuck[1] != frozen[2]):
            yield (
                f"{column} stays at {frozen[2]:.6g} for {frozen[0]} rows from row {line[frozen[1]]} on{where}, and "
                "hardly ever elsewhere: if its sensor or logger stood still, leave these cells empty"
            )
        if not sensors.is_wrapped([values]) and len(places := sensors.spikes(values)):
            yield (
                f"{column} is far from the rows beside it in {_count(len(places), 'row')}{where}, first in row "
                f"{line[places[0]]} ({values[places[0]]:.6g}): if these are glitches, leave the cells empty"
            )

    def _angles(self) -> list[str]:
        """Components that jump by whole turns."""
        if "angles" in self.given:
            return []
        angles = []
        for k, name in enumerate(self.names.state):
            if name not in self.settings.columns:
                continue
            series, unit = [trajectory.rows.y[:, k] for trajectory in self.data.grid.series], self.names.state[name]
            if unit == "rad" and sensors.jumps_by_turns(series, math.pi):
                remark = f"{name} stays within half a turn and jumps from end to end, as the direction of a rod does"
                self.remarks.append(f"{remark}: make it continuous, or give the direction of one of its ends")
            elif unit in ("rad", "") and sensors.jumps_by_turns(series):
                angles.append(name)
                self.remarks.append(f"{name} jumps by whole turns: it is unwrapped (angles)")
            elif unit == "" and sensors.jumps_by_turns(series, 360.0):
                remark = f"'{name}' jumps by 360, as an angle in degrees does"
                self.remarks.append(f"{remark}: name a system that has it in rad (--system), and angles takes them out")
            elif counts := sensors.starts_again_at(series):
                remark = f"'{name}' jumps by {counts:g}, as a counter does that starts again"
                mend = f"give its column the formula 2 * pi * x / {counts:g} and name it under angles"
                self.remarks.append(f"{remark}: where that is a turn, {mend}; else unwrap it")
        return angles

    def lines(self) -> Iterator[str]:
        """What a reader wants to know, line by line."""
        grid, rows = self.data.grid, [trajectory.rows for trajectory in self.data.grid.series]
        counts = [len(trajectory.t) for trajectory in rows]
        spans = [float(trajectory.t[-1] - trajectory.t[0]) for trajectory in rows]
        yield f"{_count(len(self.files), 'file')}, {_count(len(rows), 'trajectory')}, {_count(sum(counts), 'row')}"
        yield f"columns: {', '.join(self.table.names)}"
        unit = self.guess.time.unit or f"s is assumed: no unit is given{self._another_unit()}"
        if self.settings.time_format is not None:
            unit = f"as {self.settings.time_format}"
        yield f"times: '{self.guess.time.name}' ({unit}), trajectories: {self._told()}"
        rows_each = _range(*(f"{of(counts)}" for of in (min, max)))
        yield f"rows per trajectory: {rows_each}, over {_range(*(f'{of(spans):.4g}' for of in (min, max)))} s"
        yield f"step: {grid.row_s:.6g} s ({1 / grid.row_s:.6g} Hz)"
        gaps = np.concatenate([np.diff(trajectory.t) for trajectory in rows]) / grid.row_s
        long = gaps[gaps > 1.5]
        if len(long):
            missing = _count(round(long.max()) - 1, "missing row")
            yield f"gaps: {len(long)}, up to {long.max() * grid.row_s:.4g} s ({missing})"
        if repeated := sum(trajectory.repeated for trajectory in rows):
            yield f"rows whose time another row has too: {repeated}"
        yield from self.remarks
        yield from (mismatch.says(self.settings) for mismatch in self.slopes)
        for k, name in enumerate(self.names.state):
            if name in self.settings.columns:
                yield self._component(k, name, np.concatenate([trajectory.y[:, k] for trajectory in rows]))
        yield from self._told_still()
        if self.guess.left:
            yield f"not used: {', '.join(self.guess.left)}"
        if self.guess.unread:
            yield f"not read, as most of their cells are no numbers: {', '.join(self.guess.unread)}"

    def _take_times_as_they_are(self) -> None:
        """Leave times in a unit that the system's own rates have, too, as they are: else these would not fit them."""
        unit = self.guess.time.unit
        named = {name: said for name, unit_of in self.names.parameters.items() if (said := time_unit(unit_of))}
        if unit is None or not named or any(parse(said) != parse(unit) for said in named.values()):
            return
        self.guess = replace(self.guess, time=self.guess.time.model_copy(update={"unit": "s"}))
        name = next(iter(named))
        remark = f"times are in {unit} and {name} is in {self.names.parameters[name]}: they stay as they are (unit: s)"
        self.remarks.append(f"{remark}, so read {unit} where keys and figures say s")

    def _another_unit(self) -> str:
        """What is said of times without a unit where the system's rates are in another than the second."""
        for name, unit in self.names.parameters.items():
            if other := time_unit(unit):
                return f"; {name} is in {unit}: if the times are in {other}, read {other} where keys and figures say s"
        return ""

    def _told_still(self) -> Iterator[str]:
        """What is said of columns that do not change along any trajectory."""
        for name, column in self.settings.inputs.items():
            unit = f" [{self.names.inputs[name]}]" if self.names.inputs[name] else ""
            yield f"{name}{unit}, known: column '{column_of(column).name}'"
        if left := [name for name in self.guess.still if name in self.guess.left]:
            remark = f"the same in all rows of a trajectory, so no component: {', '.join(left)}"
            yield f"{remark}; what the system knows of it belongs under inputs (a covariate) or z_e (a parameter)"
        for name, column in self.settings.columns.items():
            if column_of(column).name in self.guess.still:
                remark = f"{name} is the same in all rows of a trajectory, as if it had been measured not to move"
                yield f"{remark}: if it is known at the first of them alone, leave the other cells empty"

    def _component(self, k: int, name: str, values: np.ndarray) -> str:
        finite, noise = values[np.isfinite(values)], self.noise[k]
        column = column_of(self.settings.columns[name])
        unit = f" {self.names.state[name]}".rstrip()
        text = f"{name} (column '{column.name}'): {finite.min():.4g} to {finite.max():.4g}{unit}"
        if self.names.state[name] and column.unit is None:
            text += " (assumed: no unit is given)"
        text += f", {len(values) - len(finite)} empty cells" if len(finite) < len(values) else ""
        if np.isfinite(self.resolution[k]):
            text += f", noise at least {noise:.2g}{unit}, from steps of {self.resolution[k]:.4g}{unit} (step / √12)"
        elif np.isfinite(noise):
            text += f", noise about {noise:.2g}{unit}"
        if self.data.grid.error is not None:
            text += f", interpolation from every other row is off by {self.data.grid.error[k]:.2g} (rms)"
        return text

    def _told(self) -> str:
        return "one per file" if self.guess.trajectory is None else f"by '{self.guess.trajectory}'"

    def draw(self, output: Path) -> None:
        """A picture of the first trajectories: every component against time."""
        series = self.data.grid.series[:SHOWN]
        shown = [k for k, name in enumerate(self.names.state) if name in self.settings.columns]
        with plotting.use_style():
            figure = plotting.new_figure(0.6 + 1.5 * len(shown))
            axes = figure.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
            for axis, k in zip(axes, shown, strict=True):
                for trajectory in series:
                    t, y = trajectory.rows.t[:POINTS], trajectory.rows.y[:POINTS, k]
                    axis.plot(t - trajectory.rows.t[0], y, linewidth=0.6, marker=".", markersize=2)
                name = list(self.names.state)[k]
                axis.set_ylabel(plotting.quantity(name, self.names.state[name]))
            of_all = len(self.data.grid.series)
            axes[0].set_title(f"the first {len(series)} of {_count(of_all, 'trajectory')}")
            axes[-1].set_xlabel("t [s]")
            plotting.save(figure, output)


def _range(low: str, high: str) -> str:
    """Two numbers as they are printed, or one where these do not differ."""
    return low if low == high else f"{low} to {high}"


def _count(number: int, what: str) -> str:
    several = f"{what.removesuffix('y')}ies" if what.endswith("y") else f"{what}s"
    return f"{number} {what if number == 1 else several}"

"""Trajectories from tables: rows told apart, in order of time, each time once, in the units of the system."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from expertaug.errors import InputError
from expertaug.measurements import expression
from expertaug.measurements.names import Names
from expertaug.measurements.sensors import check_marks
from expertaug.measurements.settings import Column, MeasurementSettings, column_of, label_of
from expertaug.measurements.table import Table
from expertaug.measurements.table_files import read_table
from expertaug.measurements.time_order import check_seconds, check_sortable
from expertaug.measurements.units import Unit, conversion, parse, parse_header, unsure

WHERE = "data.files"


@dataclass(frozen=True)
class Rows:
    """The rows of one trajectory, in order of time.

    Attributes:
        name: of the trajectory: its file's, and the column's value where one tells trajectories apart.
        path: its file.
        line: numbers of the rows in the file, (n,).
        t: times in s, (n,), strictly increasing.
        y: states, (n, K), NaN where nothing was measured.
        u: known inputs, (n, U), NaN where not known; U = 0 of a system without.
        z_e: parameters, (P,), NaN where not known.
        level: the quantity that divides the pieces, (n,), or None.
        label: texts (n,) of the column that divides the pieces, or None.
        repeated: rows that were left out or averaged since others have their time.
    """

    name: str
    path: Path
    line: np.ndarray
    t: np.ndarray
    y: np.ndarray
    u: np.ndarray
    z_e: np.ndarray
    level: np.ndarray | None
    label: np.ndarray | None
    repeated: int


def read(
    files: Sequence[Path], settings: MeasurementSettings, names: Names, tables: Mapping[Path, Table] | None = None
) -> list[Rows]:
    """Every trajectory of the files, in their order.

    Arguments:
        tables: of files that were read already, as these settings read them.

    Raises:
        InputError: a setting names what the system or a file does not have; a row cannot be used; two files have one
            name.
    """
    _check_names(settings, names)
    stems = _short_names(files)
    trajectories: list[Rows] = []
    units: dict[str, tuple[Unit, str, Path]] = {}
    for path, stem in zip(files, stems, strict=True):
        table = tables[path] if tables and path in tables else read_table(path, settings)
        _refuse_other_units(table, units)
        trajectories += _of_table(table, stem, settings, names)
    return trajectories


def _refuse_other_units(table: Table, units: dict[str, tuple[Unit, str, Path]]) -> None:
    """Columns whose units this file's row of units tells otherwise than an earlier file's."""
    for name, text in table.units.items():
        unit = parse(text)
        if unit is None:
            continue
        of, before, path = units.setdefault(name, (unit, text, table.path))
        if of != unit:
            problem = f"column '{name}' is in {text}, and in {before} in {path.name}"
            raise InputError(table.path, problem, "write it in one unit, or read the files one by one")


def check_half_told(table: Table, columns: Mapping[str, Column], state: Mapping[str, str], remedy: str) -> None:
    """Refuse an angle that is told to be in degrees where nothing is told of its speed, or the other way round: neither
    reading of the other is safe, and 57 times lies between them.

    Arguments:
        columns: of components.
        state: component → its unit.
        remedy: with {column} and {unit}.

    Raises:
        InputError: the two columns.
    """
    kinds = {name: parse(state[name]) for name in columns}
    angular = [name for name, kind in kinds.items() if kind and kind.kind in ("angle", "angular speed")]
    said = {name: columns[name].unit or _unit_told(table, columns[name].name) for name in angular}
    other = [name for name in angular if (unit := parse(said[name] or "rad")) and unit.factor != 1.0]
    silent = [n for n in angular if said[n] is None and columns[n].is_plain]
    if other and silent:
        column = columns[silent[0]].name
        problem = f"'{columns[other[0]].name}' is in {said[other[0]]}, and '{column}' has no unit"
        told_how = remedy.format(column=column, component=silent[0], unit=state[silent[0]])
        raise InputError(table.path, problem, f"say which: {told_how}, or another")


def _unit_told(table: Table, name: str) -> str | None:
    """The unit that a column's header or the row of units tells for certain."""
    header = parse_header(name, table.units.get(name))
    sure = header.unit and (header.sure or not unsure(header.unit)) and parse(header.unit) is not None
    return header.unit if sure else None


def _short_names(files: Sequence[Path]) -> list[str]:
    """Names of files without suffix, with as many folders as tell them apart."""
    for depth in range(1, 20):
        names = ["/".join(path.with_suffix("").parts[-depth:]) for path in files]
        if len(set(names)) == len(names):
            return names
    raise InputError(f"{WHERE}.paths", f"two files are called {files[0].stem}", "rename one")


def _check_names(settings: MeasurementSettings, names: Names) -> None:
    for where, entries, allowed, what in (
        ("columns", settings.columns, names.state, "component of the state"),
        ("z_e", settings.z_e, names.parameters, "expert parameter"),
        ("inputs", settings.inputs, names.inputs, "known input"),
        ("angles", settings.angles, settings.columns, "component with a column"),
    ):
        for name in entries:
            if name not in allowed:
                remedy = f"known: {', '.join(allowed) or 'none'}"
                raise InputError(f"{WHERE}.{where}.{name}", f"'{name}' is no {what}", remedy)
    for name in names.inputs:
        if name not in settings.inputs:
            raise InputError(f"{WHERE}.inputs.{name}", "missing, the system is driven by it", "name its column")
    if names.held and settings.uneven != "mask":
        problem = f"{settings.uneven}, the system's inputs hold their values between the rows"
        raise InputError(f"{WHERE}.uneven", problem, "give rows on a grid, with mask")
    for parameter, named in settings.z_e.items():
        start = label_of(named).start
        if start is not None and start not in settings.columns:
            where = f"{WHERE}.z_e.{parameter}.start"
            raise InputError(where, f"'{start}' has no column", f"known: {', '.join(settings.columns)}")


def _of_table(table: Table, stem: str, settings: MeasurementSettings, names: Names) -> list[Rows]:
    columns = {name: column_of(settings.columns[name]) for name in names.state if name in settings.columns}
    check_marks(table, [column.name for column in columns.values()])
    t, y = times_of(table, settings), np.full((len(table), len(names.state)), np.nan)
    for k, (component, unit) in enumerate(names.state.items()):
        if component in settings.columns:
            y[:, k] = _column(table, column_of(settings.columns[component]), unit, f"columns.{component}")
            if not np.isfinite(y[:, k]).any():
                column = column_of(settings.columns[component]).name
                problem = f"column {column} holds no number"
                raise InputError(table.path, problem, f"leave {WHERE}.columns.{component} out if nobody measured it")
    check_half_told(table, columns, names.state, "set data.files.columns.{component}.unit to {unit}")
    named = ((column_of(settings.inputs[name]), unit, f"inputs.{name}") for name, unit in names.inputs.items())
    u = np.array([_column(table, *arguments) for arguments in named]).reshape(len(names.inputs), len(table)).T
    labels = np.full((len(table), len(names.parameters)), np.nan)
    for k, (parameter, unit) in enumerate(names.parameters.items()):
        label = label_of(settings.z_e[parameter]) if parameter in settings.z_e else None
        if label is not None and label.name is not None:
            labels[:, k] = _column(table, Column(name=label.name, unit=label.unit), unit, f"z_e.{parameter}")
    level = _level(table, y, settings, names)
    texts = table.texts(settings.split.column) if settings.split.by == "column" else None
    if settings.trajectory is None:
        parts = {stem: np.arange(len(table))}
    else:
        parts = {f"{stem}/{text}": rows for text, rows in table.kinds(settings.trajectory).rows().items()}
    each = []
    for name, index in parts.items():
        kept, repeated, of = _in_order(table, t, np.column_stack((y, u)) if u.shape[1] else y, index, settings)
        y_of, u_of = of[:, : y.shape[1]], of[:, y.shape[1] :]
        z_e = np.array([_one_value(table, labels[kept, k], kept, p) for k, p in enumerate(names.parameters)])
        of_level, of_told = (None if v is None else v[kept] for v in (level, texts))
        line, t_of = (table.line, t) if len(kept) == len(t) else (table.line[kept], t[kept])
        if settings.unordered == "sort" or settings.pivot is not None:
            line, t_of = table.line[kept], t[kept]
        each.append(Rows(name, table.path, line, t_of, y_of, u_of, z_e, of_level, of_told, repeated))
    return each


def times_of(table: Table, settings: MeasurementSettings) -> np.ndarray:
    """Times (n,) of a table's rows in s.

    Raises:
        InputError: a cell is no time, or empty.
    """
    column = column_of(settings.time)
    if column.unit == "datetime" or settings.time_format is not None or settings.date is not None:
        t = table.times(column.name, settings.time_format, settings.date)
        return t * column.factor + column.offset
    t = _column(table, column, "s", "time")
    if column == Column(name=column.name) and _unit_told(table, column.name) is None:
        check_seconds(table, column.name, t)
    table._refuse(column.name, np.isnan(t), "is no time", "every row needs a time")
    return t


def _column(table: Table, column: Column, to: str, where: str) -> np.ndarray:
    place = f"{WHERE}.{where}.unit"
    if column.unit is None and column.is_plain:
        _refuse_another_unit(table, column.name, to, place)
    factor, summand = conversion(column.unit, to, place)
    numbers = table.numbers(column.name) if where == "time" else table.measured(column.name)
    if column.formula is not None:
        numbers = _calibrated(table, column.name, numbers, column.formula, f"{WHERE}.{where}.formula")
    return (numbers * column.factor + column.offset) * factor + summand


def _calibrated(table: Table, name: str, numbers: np.ndarray, formula: str, where: str) -> np.ndarray:
    """A formula's values at a column's numbers (n,), as x.

    Raises:
        InputError: it is none, or not defined where the column has a number.
    """
    values = expression.value(formula, {"x": numbers}, where)
    if (undefined := np.flatnonzero(np.isnan(values) & ~np.isnan(numbers))).size:
        row = undefined[0]
        problem = f"'{formula}' is not defined at {numbers[row]:g} (row {table.line[row]} of column '{name}')"
        raise InputError(table.path, problem, f"correct {where}, or say which numbers are none ({WHERE}.missing)")
    return values


def _refuse_another_unit(table: Table, name: str, to: str, place: str) -> None:
    """Numbers whose header tells another unit than the one that they would be taken for."""
    header = parse_header(name, table.units.get(name))
    if not header.unit or not to or not (header.sure or not unsure(header.unit)):
        return
    unit, own = parse(header.unit), parse(to)
    if unit is None and ("[" in name or table.units.get(name)):
        raise InputError(place, f"the unit '{header.unit}' of column '{name}' is not understood", f"give it, as {to}")
    if unit is not None and own is not None and unit != own:
        kind = "" if unit.dimension == own.dimension else f", a unit of {unit.kind}"
        remedy = f"set unit to {header.unit}, or to {to} if the header is wrong"
        raise InputError(place, f"missing: column '{name}' tells {header.unit}{kind}, the system has {to}", remedy)


def _level(table: Table, y: np.ndarray, settings: MeasurementSettings, names: Names) -> np.ndarray | None:
    """The quantity that divides the pieces, in every row."""
    split, where = settings.split, f"{WHERE}.split.quantity"
    if split.by != "quantity":
        return None
    columns = {name: y[:, k] for k, name in enumerate(names.state) if name in settings.columns}
    for name in expression.names(split.quantity, where):
        if name not in columns:
            if name not in table.cells:
                raise InputError(
                    where, f"'{split.quantity}' names '{name}'", f"known: {', '.join([*columns, *table.names])}"
                )
            columns[name] = table.measured(name)
    level = expression.value(split.quantity, columns, where)
    if not np.isfinite(level).any():
        raise InputError(where, f"'{split.quantity}' is no number in any row of {table.path}", "correct it")
    return level


def _in_order(
    table: Table, t: np.ndarray, y: np.ndarray, index: np.ndarray, settings: MeasurementSettings
) -> tuple[np.ndarray, int, np.ndarray]:
    """Rows in order of time, each time once: their places in the table, how many others there were, their states and
    inputs, as y has them."""
    back = np.flatnonzero(np.diff(t[index]) < 0)
    if len(back) and settings.pivot is None and settings.unordered == "sort":
        check_sortable(table, t, [index], apart=True)
    if len(back) and settings.unordered == "refuse" and settings.pivot is None:
        row, before = index[back[0] + 1], index[back[0]]
        problem = f"row {table.line[row]}: the time goes back from {t[before]:g} to {t[row]:g} s"
        remedy = f"name the column that tells trajectories apart ({WHERE}.trajectory); of one: set unordered to sort"
        raise InputError(table.path, problem, remedy)
    index = index[np.argsort(t[index], kind="stable")]
    first = np.concatenate(([True], np.diff(t[index]) > 0))
    if first.all():
        return index, 0, y[index]
    group, starts = np.cumsum(first) - 1, np.flatnonzero(first)
    states = y[index]
    same = states == states[starts][group]
    differs = ~(same | (np.isnan(states) & np.isnan(states[starts][group]))).all(1)
    if differs.any() and settings.duplicates == "refuse":
        row = index[int(np.argmax(differs))]
        problem = f"row {table.line[row]}: another row has its time, {t[row]:g} s, and other values"
        raise InputError(table.path, problem, f"set {WHERE}.duplicates to first or mean, or name the trajectory column")
    kept = states[starts]
    if settings.duplicates == "mean":
        present = np.isfinite(states)
        total, count = np.zeros_like(kept), np.zeros_like(kept)
        np.add.at(total, group, np.where(present, states, 0.0))
        np.add.at(count, group, present)
        kept = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    return index[starts], int((~first).sum()), kept


def _one_value(table: Table, values: np.ndarray, rows: np.ndarray, parameter: str) -> float:
    """What the rows of a trajectory say of a parameter; NaN where they say nothing."""
    places = np.flatnonzero(np.isfinite(values))
    if not len(places):
        return np.nan
    first = values[places[0]]
    other = np.flatnonzero(np.abs(values[places] - first) > 1e-6 * max(abs(first), 1e-12))
    if len(other):
        lines = table.line[rows[places[0]]], table.line[rows[places[other[0]]]]
        problem = f"{parameter} is {first:g} in row {lines[0]} and {values[places[other[0]]]:g} in row {lines[1]}"
        raise InputError(table.path, problem, "a parameter is constant within a trajectory")
    return float(first)

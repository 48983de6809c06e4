"""Tables with a row for each value, or with runs beside each other, as tables with a row for each time of each run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from expertaug.errors import InputError
from expertaug.measurements.settings import Beside, Pivot

if TYPE_CHECKING:
    from expertaug.measurements.table import Table


def put_below(table: Table, beside: Beside) -> Table:
    """A table with runs beside each other, a column for each, with the runs below each other.

    Raises:
        InputError: a column is not there, or one is called as the new ones are.
    """
    for name in beside.columns:
        table.column(name)
    rest = [name for name in table.names if name not in beside.columns]
    refuse_twins(table.path, [*rest, beside.name, beside.value])
    runs, rows = len(beside.columns), len(table)
    cells = {name: np.concatenate([table.cells[name]] * runs) for name in rest}
    cells[beside.name] = np.repeat(np.array(beside.columns, dtype=object), rows)
    values = [table.cells[name] for name in beside.columns]
    if len({cells_of.dtype.kind in "biuf" for cells_of in values}) > 1:  # numbers beside texts
        values = [table.texts(name) for name in beside.columns]
    cells[beside.value] = np.concatenate(values)
    units = {name: unit for name, unit in table.units.items() if name in rest}
    of_runs = {table.units[name] for name in beside.columns if name in table.units}
    if len(of_runs) == 1:
        units[beside.value] = of_runs.pop()
    return replace(table, cells=cells, line=np.concatenate([table.line] * runs), units=units, reread=None)


def pivot_table(table: Table, pivot: Pivot) -> Table:
    """A table in long format with a column for each sensor, and a row for each moment.

    Raises:
        InputError: a column is not there, or a sensor has two values of one moment.
    """
    import pandas as pd

    aside = {pivot.name, pivot.value, *([pivot.unit] if pivot.unit else [])}
    by = pivot.by or [name for name in table.names if name not in aside]
    for name in (*aside, *by):
        table.column(name)
    if not by:
        raise InputError(table.path, "no column tells the moments", "a long table has columns of time, name and value")
    moments = pd.MultiIndex.from_arrays([table.texts(name) for name in by])
    row, _ = pd.factorize(moments)
    sensor, sensors = pd.factorize(table.texts(pivot.name))
    refuse_twins(table.path, [*by, *sensors])
    twice = pd.Series(row.astype(np.int64) * len(sensors) + sensor).duplicated().to_numpy()
    if twice.any():
        at = int(np.argmax(twice))
        moment = ", ".join(f"{name} {table.texts(name)[at]}" for name in by)
        problem = f"row {table.line[at]}: another row has {pivot.name} {sensors[sensor[at]]} at {moment}"
        raise InputError(table.path, problem, "name all that tells rows apart in data.files.pivot.by, or a trajectory")
    first = np.flatnonzero(~pd.Series(row).duplicated().to_numpy())
    values, cells = table.cells[pivot.value], {name: table.cells[name][first] for name in by}
    for k, name in enumerate(sensors):
        own = sensor == k
        empty = np.full(len(first), np.nan) if values.dtype.kind in "biuf" else np.full(len(first), "", dtype=object)
        empty[row[own]] = values[own]
        cells[str(name)] = empty
    units = {} if pivot.unit is None else dict(zip(table.texts(pivot.name), table.texts(pivot.unit), strict=True))
    units |= {name: unit for name, unit in table.units.items() if name in by}
    return replace(table, cells=cells, line=table.line[first], units=units, reread=None)


def refuse_twins(path: Path, names: Sequence[str]) -> None:
    twin = next((name for k, name in enumerate(names) if name and name in names[:k]), None)
    if twin is not None:
        raise InputError(path, f"two columns are called '{twin}'", "rename one, or name all in data.files.names")

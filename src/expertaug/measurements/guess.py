"""What the columns of a table seem to be: times, trajectories, and components of a system's state by their names."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from expertaug.errors import InputError
from expertaug.measurements.dates import may_be_minutes
from expertaug.measurements.names import Names
from expertaug.measurements.settings import Column
from expertaug.measurements.table import Table
from expertaug.measurements.time_order import is_since_1970
from expertaug.measurements.trajectory import check_half_told
from expertaug.measurements.units import Told, conversion, parse, parse_header, unsure

TIMES = ("t", "time", "times", "zeit", "seconds", "timestamp", "datetime", "elapsed")
TRAJECTORIES = ("trial", "trajectory", "run", "experiment", "series", "episode", "sample", "id", "rep", "replicate")
# What columns of these components are often called.
ALSO = {
    "theta": ("angle", "phi", "position"),
    "omega": (
        *("speed", "velocity", "angular velocity", "angular speed", "angular rate", "v", "w", "rate", "gyro"),
        *("thetadot", "theta dot", "dtheta", "dtheta dt", "phidot", "phi dot", "dphi", "dphi dt", "angle rate"),
    ),
    "U": ("voltage", "u", "v"),
    "I": ("current", "i"),
    "x": ("position", "displacement", "elongation"),
    "v": ("velocity", "speed"),
}
DATES = ("date", "day", "datum", "tag", "fecha", "giorno", "jour")
ALIKE = 0.8  # of two names, by difflib
# What a column beside the measured one is called: theta_ref, theta_std.
OTHERS = {
    "ref",
    "reference",
    "set",
    "setpoint",
    "target",
    "cmd",
    "command",
    "goal",
    "desired",
    "sim",
    "std",
    "sigma",
    "err",
}
# What dates begin with, as 2024-05-31 or 31.05.2024, and times of day, as 10:59:50 or 10:59 pm.
MOMENT = re.compile(r"\s*(\d{4}[./-]\d{1,2}[./-]\d{1,2}|\d{1,2}([./-])\d{1,2}\2\d{2,4}|\d{1,3}:\d{2})(?!\d)")
CLOCK_TIME = re.compile(r"\s*\d{1,2}:\d{2}(:\d{2}([.,]\d*)?)?(\s*[AaPp]\.?[Mm]\.?)?\s*$")
MANY = 200  # trajectories told apart by a column, at most


@dataclass(frozen=True)
class Guess:
    """Which column is what.

    Attributes:
        time, trajectory: names of columns; the second may be None.
        columns: component → column.
        certain: components whose column was told by its name, not by its place.
        left: columns of numbers that stand for nothing.
        unread: columns in which most cells are no numbers, and none is a number.
        still: columns whose numbers are the same in all rows of each trajectory: no motion, but a known number.
        date: the column of dates, where the times are times of day.
        inputs: known input or covariate → column, of those that a column is called as.
    """

    time: Column
    trajectory: str | None
    columns: dict[str, Column]
    certain: set[str] = field(default_factory=set)
    left: list[str] = field(default_factory=list)
    unread: list[str] = field(default_factory=list)
    still: list[str] = field(default_factory=list)
    date: str | None = None
    inputs: dict[str, Column] = field(default_factory=dict)


def guess(
    table: Table,
    names: Names | None,
    time: str | None = None,
    trajectory: str | None = None,
    units: Mapping[str, str] | None = None,
    date: str | None = None,
    time_format: str | None = None,
) -> Guess:
    """Say what each column seems to be.

    Arguments:
        names: of the system; None: every further column of numbers is a component of its own.
        time, trajectory, date: columns that are known.
        units: column → unit, where they are known.
        time_format: how dates and times are written, where that is known.

    Raises:
        InputError: no column can be the times, they may be read in two ways, a unit is not understood, or a column that
            is said to be known does not exist.
    """
    numbers = {}
    for name in table.names:  # a cell that is no number is told when the column is read
        values = table.mostly(name)
        if values is not None:
            numbers[name] = values
    for option, name in {"--time": time, "--trajectory": trajectory}.items():
        if name is not None and name not in table.names:
            raise InputError(option, f"no column '{name}'", f"its columns are {', '.join(table.names)}")
    trajectory = trajectory or _trajectory(numbers, table)
    time_name = time or _time(numbers, table, trajectory)
    date = date or _date(table, time_name)
    taken = (time_name, trajectory, date)
    rest = {name: values for name, values in numbers.items() if name not in taken}
    known_units = units or {}
    for name in known_units:
        if name not in table.names:
            raise InputError("--unit", f"no column '{name}'", f"its columns are {', '.join(table.names)}")
    moments = time_name not in numbers or date is not None or time_format is not None
    if moments and date is None and time_format is None:
        _refuse_two_readings(table, time_name)
    of_time = Column(name=time_name, unit="datetime" if moments else unit_of(time_name, table, "s", known_units))
    unread = [name for name in table.names if name not in (*taken, *numbers) and not _is_empty(table, name)]
    if names is None:
        each = {_plain_name(name): Column(name=name) for name in rest}
        return Guess(of_time, trajectory, each, set(rest), [], unread, [], date)
    still, inputs = _still(rest, table, trajectory), _inputs(list(rest), table, names, known_units)
    free = [name for name in rest if name not in {column.name for column in inputs.values()}]
    columns, certain = _components(free, table, names, known_units, still)
    left = [name for name in free if name not in {column.name for column in columns.values()}]
    return Guess(of_time, trajectory, columns, certain, left, unread, still, date, inputs)


def _inputs(rest: Sequence[str], table: Table, names: Names, units: Mapping[str, str]) -> dict[str, Column]:
    """Columns that are called as a known input or covariate is, and not as a component."""
    components = {name.lower() for name in names.state}
    columns: dict[str, Column] = {}
    for name, unit in names.inputs.items():
        called = [column for column in rest if bare(column) == bare(name) and bare(column) not in components]
        if called:
            columns[name] = Column(name=called[0], unit=unit_of(called[0], table, unit, units))
    return columns


def _still(rest: Mapping[str, np.ndarray], table: Table, trajectory: str | None) -> list[str]:
    """Columns of numbers (n,) that are the same in all rows of each trajectory, as a mass is, or stand in one of them
    alone, as a dose does; none where there are no others."""
    groups = np.zeros(len(table), dtype=int) if trajectory is None else table.kinds(trajectory).of_row
    order = np.argsort(groups, kind="stable")
    begins = np.flatnonzero(np.diff(groups[order], prepend=-1))
    still = []
    for name, values in rest.items():
        ranged = values[order]
        low, high = (f.reduceat(ranged, begins) for f in (np.fmin, np.fmax))
        several = np.add.reduceat(np.isfinite(ranged).astype(int), begins) > 1
        once = not several.any() and (np.bincount(groups) > 1).any() and np.isfinite(values).any()
        if once or (several.any() and (low == high)[several].all()):
            still.append(name)
    return still if len(still) < len(rest) else []


def _is_empty(table: Table, name: str) -> bool:
    """Whether a column without a name holds nothing, as at the right of what a spreadsheet writes."""
    cells = table.cells[name]
    return name.startswith("column ") and cells.dtype.kind in "OU" and not any(str(cell).strip() for cell in cells)


def _refuse_two_readings(table: Table, name: str) -> None:
    cells = table.cells[name]
    if cells.dtype.kind in "OU" and may_be_minutes(cells):
        problem = f"column '{name}': '{cells[0]}' may be hours and minutes, or minutes and seconds"
        raise InputError(table.path, problem, "say which: --set time_format=%H:%M or --set time_format=%M:%S")


def unit_of(name: str, table: Table, to: str, units: Mapping[str, str]) -> str | None:
    """The unit of a column that stands for something in ``to``, as the user, its header or the row of units says it;
    None where none does.

    Arguments:
        units: column → unit, from the user.

    Raises:
        InputError: what is said is no unit, or one of another kind.
    """
    if name in units:
        conversion(units[name], to, f"--unit {name}")
        return units[name]
    header = _header(name, table)
    if not header.unit or header.fits(to):
        return header.unit or None
    unit, own = parse(header.unit), parse(to)
    if not header.sure and unsure(header.unit):
        return None
    remedy = f"say which unit it is: --unit '{name}={to or 1}'"
    if unit is None:
        raise InputError(table.path, f"column '{name}': the unit '{header.unit}' is not understood", remedy)
    problem = f"column '{name}': '{header.unit}' is a unit of {unit.kind}, {to or 'a pure number'} is expected"
    raise InputError(table.path, problem, remedy if own else f"{remedy}; '{to}' is not known")


def bare(name: str) -> str:
    """A name without its unit, in small letters."""
    return re.sub(r"[^a-z0-9]+", " ", parse_header(name).name.lower()).strip()


def _plain_name(name: str) -> str:
    return re.sub(r"\W+", "_", name).strip("_") or "column"


def _time(numbers: Mapping[str, np.ndarray], table: Table, trajectory: str | None) -> str:
    for name in table.names:
        if bare(name) in TIMES and name != trajectory:
            return name
    dates = [name for name in table.names if name not in (*numbers, trajectory) and _holds(table, name, MOMENT)]
    if dates:
        return dates[0]
    parts = [name for name, values in numbers.items() if name != trajectory and _is_of_time(name, values)]
    if len(parts) > 1:
        problem = f"'{parts[0]}' and '{parts[1]}' are parts of the time, or times of several kinds"
        raise InputError(table.path, problem, "join them in one column, or name the time by --time")
    for name, values in numbers.items():
        steps = np.diff(values)
        if name != trajectory and len(steps) and np.isfinite(values).all() and (steps > 0).mean() > 0.9:
            return name
    listed = ", ".join(table.names)
    raise InputError(table.path, "no column is called time, and none increases", f"name it by --time: {listed}")


def _date(table: Table, time: str) -> str | None:
    """The column of dates beside one of times of day, where they are of more than one day."""
    if table.cells[time].dtype.kind not in "OU" or not _holds(table, time, CLOCK_TIME):
        return None
    dates = [name for name in table.names if name != time and bare(name) in DATES and _holds(table, name, MOMENT)]
    return next((name for name in dates if len(set(table.cells[name].tolist())) > 1), None)


def _holds(table: Table, name: str, pattern: re.Pattern[str]) -> bool:
    """Whether a column's first cells are texts of that form."""
    cells = table.cells[name]
    return cells.dtype.kind in "OU" and all(pattern.match(str(cell)) for cell in cells[:100])


def _trajectory(numbers: Mapping[str, np.ndarray], table: Table) -> str | None:
    """A column that is called so, or whole numbers that stay the same for many rows."""
    for name in table.names:
        if bare(name) in TRAJECTORIES and len(table.kinds(name).texts) < max(len(table), 2):
            return name  # where each row has its own it counts the rows
    for name, values in numbers.items():
        if np.isfinite(values).all() and (values == np.rint(values)).all() and not _is_of_time(name, values):
            several, blocks = len(np.unique(values)), 1 + int((np.diff(values) != 0).sum())
            if several == blocks <= min(MANY, len(values) // 10):
                return name
    return None


def _is_of_time(name: str, values: np.ndarray) -> bool:
    """Whether a column of whole numbers is a time or a part of one, as tv_sec beside tv_usec."""
    words = [word for word in re.split(r"[\W_]+", name.lower()) if word]
    units = [parse(word) for word in words if (len(word) > 1 and not unsure(word)) or words == ["s"]]
    of_time = any(unit is not None and unit.kind == "time" for unit in units)
    return of_time or bare(name) in TIMES or is_since_1970(float(values[0])) is not None


def _components(
    rest: Sequence[str], table: Table, names: Names, units: Mapping[str, str], still: Sequence[str]
) -> tuple[dict[str, Column], set[str]]:
    """Columns of components: by names first, then by the units, and what is left by its place; of those that stand
    ``still`` by names alone."""
    scores = sorted(
        ((likeness(component, column), component, column) for component in names.state for column in rest),
        key=lambda match: -match[0],
    )
    matches: dict[str, str] = {}
    for score, component, column in scores:
        if score >= ALIKE and component not in matches and column not in matches.values():
            matches[component] = column
    for component, unit in names.state.items():  # a column called deg/s, or one of its kind alone
        if component not in matches:
            free = [c for c in rest if c not in matches.values() and c not in still]
            fitting = [c for c in free if _header(c, table).fits(unit) and unit]
            if len(fitting) == 1:
                matches[component] = fitting[0]
    certain = set(matches)
    free = [column for column in rest if column not in matches.values() and column not in still]
    for component in names.state:
        if component not in matches and free and not certain:
            matches[component] = free.pop(0)
    columns = {
        component: Column(name=matches[component], unit=unit_of(matches[component], table, unit, units))
        for component, unit in names.state.items()
        if component in matches
    }
    check_half_told(table, columns, names.state, "--unit '{column}={unit}'")
    return columns, certain


def _header(name: str, table: Table) -> Told:
    return parse_header(name, table.units.get(name))


def likeness(component: str, column: str) -> float:
    """How much a column is called as a component: 2 and 1.5 for its name and what it is often called, less than 1 where
    only a part or most letters are the same."""
    plain = bare(column)
    words = plain.split()
    if OTHERS & set(words):
        return 0.0
    number = re.sub(r".*?(\d*)$", r"\1", component)
    others = ALSO.get(component, ALSO.get(re.sub(r"\d+$", "", component), ()))
    candidates = [component.lower(), *(f"{other}{number}".lower() for other in others)]
    best = max(difflib.SequenceMatcher(None, candidate, plain).ratio() for candidate in candidates)
    if plain in candidates or plain.replace(" ", "") in candidates:
        return 2.0 if plain == component.lower() else 1.5
    ends = re.search(r"\d+$", plain)
    if (ends[0] if ends else "") != number or len(plain) < 3:
        return 0.0
    return max(
        best, 0.9 if any(len(candidate) > 2 and f" {candidate} " in f" {plain} " for candidate in candidates) else 0.0
    )

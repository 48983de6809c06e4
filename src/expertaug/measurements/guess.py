"""What the columns of a table seem to be: times, trajectories, and components of a system's state by their names."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from expertaug.errors import InputError
from expertaug.measurements.names import Names
from expertaug.measurements.settings import Column
from expertaug.measurements.table import Table
from expertaug.measurements.units import conversion, known, plain

TIMES = ("t", "time", "times", "zeit", "seconds", "timestamp", "datetime", "elapsed")
TRAJECTORIES = ("trial", "trajectory", "run", "experiment", "series", "episode", "sample", "id", "rep", "replicate")
# What columns of these components are often called.
ALSO = {
    "theta": ("angle", "phi", "position"),
    "omega": ("speed", "velocity", "angular velocity", "v", "w", "thetadot", "dtheta"),
    "U": ("voltage", "u", "v"),
    "I": ("current", "i"),
    "x": ("position", "displacement", "elongation"),
    "v": ("velocity", "speed"),
}
ALIKE = 0.6  # of two names, by difflib
MANY = 200  # trajectories told apart by a column, at most


@dataclass(frozen=True)
class Guess:
    """Which column is what.

    Attributes:
        time, trajectory: names of columns; the second may be None.
        columns: component → column.
        certain: components whose column was told by its name, not by its place.
        left: columns of numbers that stand for nothing.
    """

    time: Column
    trajectory: str | None
    columns: dict[str, Column]
    certain: set[str] = field(default_factory=set)
    left: list[str] = field(default_factory=list)


def guess(table: Table, names: Names | None, time: str | None = None, trajectory: str | None = None) -> Guess:
    """Say what each column seems to be.

    Arguments:
        names: of the system; None: every further column of numbers is a component of its own.
        time, trajectory: columns that are known.

    Raises:
        InputError: no column can be the times.
    """
    numbers = {}
    for name in table.names:  # a cell that is no number is told when the column is read
        values = table.mostly(name)
        if values is not None:
            numbers[name] = values
    trajectory = trajectory or _trajectory(numbers, table)
    found = time or _time(numbers, table, trajectory)
    rest = {name: values for name, values in numbers.items() if name not in (found, trajectory)}
    unit = unit_of(found, table)
    if found not in numbers:
        unit = "datetime"
    elif unit is not None and not _fits(unit, "s"):
        unit = None
    of_time = Column(name=found, unit=unit if unit != "s" else None)
    if names is None:
        return Guess(of_time, trajectory, {_plain_name(name): Column(name=name) for name in rest}, set(rest))
    columns, certain = _components(list(rest), table, names)
    left = [name for name in rest if name not in {column.name for column in columns.values()}]
    return Guess(of_time, trajectory, columns, certain, left)


def unit_of(name: str, table: Table) -> str | None:
    """The unit that a column's name or the row of units says; None where neither does."""
    given = table.units.get(name) or ""
    match = re.search(r"[\[(]([^\])]+)[\])]\s*$", name) or re.search(r"_([A-Za-z/°%]+)$", name)
    for text in (given, match[1] if match else ""):
        if text and known(text):
            return plain(text)
    return None


def _fits(unit: str, to: str) -> bool:
    try:
        conversion(unit, to, "")
    except InputError:
        return False
    return True


def _bare(name: str) -> str:
    """A name without its unit, in small letters."""
    name = re.sub(r"[\[(][^\])]*[\])]\s*$", "", name)
    head, _, tail = name.rpartition("_")
    name = head if head and known(tail) else name
    return re.sub(r"[^a-z0-9]+", " ", name.lower()).strip()


def _plain_name(name: str) -> str:
    return re.sub(r"\W+", "_", name).strip("_") or "column"


def _time(numbers: Mapping[str, np.ndarray], table: Table, trajectory: str | None) -> str:
    for name in table.names:
        if _bare(name) in TIMES and name != trajectory:
            return name
    for name, values in numbers.items():
        steps = np.diff(values)
        if name != trajectory and len(steps) and np.isfinite(values).all() and (steps > 0).mean() > 0.9:
            return name
    listed = ", ".join(table.names)
    raise InputError(table.path, "no column is called time, and none increases", f"name it by --time: {listed}")


def _trajectory(numbers: Mapping[str, np.ndarray], table: Table) -> str | None:
    """A column that is called so, or whole numbers that stay the same for many rows."""
    for name in table.names:
        if _bare(name) in TRAJECTORIES:
            return name
    for name, values in numbers.items():
        if np.isfinite(values).all() and (values == np.rint(values)).all() and _bare(name) not in TIMES:
            several, blocks = len(np.unique(values)), 1 + int((np.diff(values) != 0).sum())
            if several == blocks <= min(MANY, len(values) // 10):
                return name
    return None


def _components(rest: Sequence[str], table: Table, names: Names) -> tuple[dict[str, Column], set[str]]:
    """Columns of components: by names first, then by the units, and what is left by its place."""
    scores = sorted(
        ((_likeness(component, column), component, column) for component in names.state for column in rest),
        key=lambda one: -one[0],
    )
    found: dict[str, str] = {}
    for score, component, column in scores:
        if score >= ALIKE and component not in found and column not in found.values():
            found[component] = column
    certain = set(found)
    free = [column for column in rest if column not in found.values()]
    for component in names.state:
        if component not in found and free and not certain:
            found[component] = free.pop(0)
    columns = {}
    for component, unit in names.state.items():
        if component in found:
            told = unit_of(found[component], table)
            fits = told is not None and plain(told) != plain(unit) and _fits(told, unit)
            columns[component] = Column(name=found[component], unit=told if fits else None)
    return columns, certain


def _likeness(component: str, column: str) -> float:
    bare = _bare(column)
    number = re.sub(r".*?(\d*)$", r"\1", component)
    others = ALSO.get(component, ALSO.get(re.sub(r"\d+$", "", component), ()))
    candidates = [component.lower(), *(f"{one}{number}".lower() for one in others)]
    best = max(difflib.SequenceMatcher(None, one, bare).ratio() for one in candidates)
    if bare in candidates or bare.replace(" ", "") in candidates:
        return 2.0 if bare == component.lower() else 1.5
    ends = re.search(r"\d+$", bare)
    return 0.0 if (ends[0] if ends else "") != number or len(bare) < 3 else best

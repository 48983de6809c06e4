"""Rows of tables as frozen dataclasses: the columns of a file follow from the fields, here and nowhere else.

A field is a text, a whole number, a number, whether something holds, or numbers apart by blanks; or it is a
dataclass of these, which has a column for each: the first is called as the field, others ``field_name``.  An empty cell
is None where that may be, else of numbers NaN.  A field that is None unless it is given has columns only where a row
has it.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, is_dataclass
from functools import cache
from pathlib import Path
from types import NoneType
from typing import TYPE_CHECKING, Any, TypeVar, get_args, get_type_hints

from expertaug import files
from expertaug.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

Row = TypeVar("Row")
Key = TypeVar("Key", bound=Hashable)
READ: Mapping[Any, Callable[[str], Any]] = {
    str: str,
    int: int,
    float: lambda text: float(text or "nan"),
    bool: {"True": True, "False": False}.__getitem__,
    tuple[int, ...]: lambda text: tuple(map(int, text.split())),
    tuple[float, ...]: lambda text: tuple(map(float, text.split())),
}


@dataclass(frozen=True)
class Column:
    """A column of a table.

    Attributes:
        name: in files.
        field: of the row.
        kind: of its values.
        empty: whether they may be None.
        needed: whether every table has it.
        part, whole: of a field that is a dataclass: its own field, and its class.
    """

    name: str
    field: str
    kind: type
    empty: bool
    needed: bool
    part: str = ""
    whole: type | None = None

    def value(self, row: object) -> object:
        """The cell of a row."""
        value = getattr(row, self.field)
        if self.part and value is not None:
            value = getattr(value, self.part)
        return " ".join(map(str, value)) if isinstance(value, tuple) else value

    def read(self, text: str) -> Any:
        """What a cell says.

        Raises:
            ValueError: it cannot be read.
        """
        try:
            return None if self.empty and not text else READ[self.kind](text)
        except (ValueError, KeyError) as error:
            raise ValueError(f"{self.name} is {text!r}") from error


@cache
def columns(kind: type) -> tuple[Column, ...]:
    """The columns of rows of a class, in order."""
    hints, made = get_type_hints(kind), []
    for field in fields(kind):
        hint, needed = hints[field.name], field.default is MISSING
        empty = NoneType in get_args(hint)
        plain = next(option for option in get_args(hint) if option is not NoneType) if empty else hint
        if is_dataclass(plain):
            names = [field.name, *(f"{field.name}_{inner.name}" for inner in columns(plain)[1:])]
            parts = zip(names, columns(plain), strict=True)
            made += [Column(name, field.name, c.kind, c.empty, needed, c.field, plain) for name, c in parts]
        else:
            made.append(Column(field.name, field.name, plain, empty, needed))
    return tuple(made)


def cells(kind: type[Row], rows: Sequence[Row]) -> dict[str, list[Any]]:
    """The cells of a table by column."""
    values = {column: [column.value(row) for row in rows] for column in columns(kind)}
    return {c.name: each for c, each in values.items() if c.needed or any(cell is not None for cell in each)}


def group_by(rows: Iterable[Row], key: Callable[[Row], Key]) -> dict[Key, list[Row]]:
    """Rows by what they have in common, in order of appearance."""
    groups: dict[Key, list[Row]] = {}
    for row in rows:
        groups.setdefault(key(row), []).append(row)
    return groups


def frame(kind: type[Row], rows: Sequence[Row]) -> pd.DataFrame:
    """Rows as a table in memory."""
    import pandas as pd

    return pd.DataFrame(cells(kind, rows))


def write_csv(path: str | Path, kind: type[Row], rows: Sequence[Row]) -> None:
    """Write a CSV file, numbers in full precision.

    Raises:
        InputError: it cannot be written.
    """
    table = cells(kind, rows)
    with files.atomic(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as stream:
        lines = csv.writer(stream, lineterminator="\n")
        lines.writerow(table)
        for row in zip(*table.values(), strict=True):
            lines.writerow("" if cell != cell else cell for cell in row)  # NaN alone is not itself


def read_csv(path: str | Path, kind: type[Row], remedy: str) -> list[Row]:
    """Rows of a CSV file; columns that the class does not know are left alone.

    Raises:
        InputError: the file is missing, empty or broken, or lacks a column.
    """
    try:
        with Path(path).open(encoding="utf-8", newline="") as stream:
            lines = list(csv.DictReader(stream))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(path, f"cannot be read ({error})", remedy) from error
    if not lines:
        raise InputError(path, "no rows", remedy)
    return [_row(path, number, line, kind) for number, line in enumerate(lines, 2)]


def _row(path: str | Path, number: int, line: Mapping[str, str | None], kind: type[Row]) -> Row:
    values: dict[str, Any] = {}
    for column in columns(kind):
        text = line.get(column.name)
        if text is None and column.needed:
            names = ", ".join(c.name for c in columns(kind) if c.needed)
            raise InputError(path, f"line {number} has no {column.name!r}", f"columns {names}")
        try:
            value = None if text is None else column.read(text)
        except ValueError as error:
            raise InputError(path, f"line {number}: {error}", f"a column of type {column.kind.__name__}") from error
        if column.whole is None:
            values[column.field] = value
        elif column.field not in values:  # its first part: without it there is none
            values[column.field] = {column.part: value} if text else None
        elif values[column.field] is not None:
            values[column.field][column.part] = value
    wholes = {c.field: c.whole for c in columns(kind) if c.whole is not None and values[c.field] is not None}
    return kind(**values | {name: whole(**values[name]) for name, whole in wholes.items()})

"""A table of measurements as named columns."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from expertaug.errors import InputError
from expertaug.measurements import dates
from expertaug.measurements.settings import TableKeys

LARGEST = 1e30  # of any number: single precision must hold it
MARKED = "or what data.files.missing names"
EMPTY = {"", "nan", "na", "n/a", "#n/a", "null", "none", "-", "–", "."}
FORTRAN = re.compile(r"(?<=[\d.])[dD](?=[-+]?\d+$)")  # the letter before an exponent
MANY_TEXTS = 2**16  # different ones, of which none is looked for among the others


@dataclass(frozen=True)
class Kinds:
    """The different texts of a column, in order of appearance, and the place among them of each row's, (n,)."""

    texts: list[str]
    of_row: np.ndarray

    def rows(self) -> dict[str, np.ndarray]:
        """The rows of each text, in order."""
        order = np.argsort(self.of_row, kind="stable")
        ends = np.cumsum(np.bincount(self.of_row, minlength=len(self.texts)))[:-1]
        return dict(zip(self.texts, np.split(order, ends), strict=True))


@dataclass(frozen=True)
class Table:
    """Columns of one file, each (n,).

    Attributes:
        path: of the file.
        cells: column → texts (a CSV's) or numbers, times or texts (n,), as the file has them.
        line: the number of each row, as an editor counts lines (a CSV) or from 1.
        units: column → unit, where the file has a row of them.
        keys: how numbers are written in texts, and what is written where nothing was measured.
        reread: the texts of a column whose cells are numbers already, (n,); None where there are none.
    """

    path: Path
    cells: dict[str, np.ndarray]
    line: np.ndarray
    units: dict[str, str] = field(default_factory=dict)
    keys: TableKeys = field(default_factory=TableKeys)
    reread: Callable[[str], np.ndarray] | None = None

    @property
    def names(self) -> list[str]:
        return list(self.cells)

    def __len__(self) -> int:
        return len(self.line)

    def texts(self, name: str) -> np.ndarray:
        """A column as texts (n,); rows of one text share it."""
        kinds = self.kinds(name)
        return np.array(kinds.texts, dtype=object)[kinds.of_row]

    def kinds(self, name: str) -> Kinds:
        """The different texts of a column."""
        cells = self.column(name)
        numbers = cells if cells.dtype.kind == "f" else self.parsed(cells)
        if (numbers == np.rint(numbers)).all() and np.abs(numbers).max(initial=0) < 2**53:  # 3.0e+00 is 3
            return _whole_kinds(numbers.astype(np.int64))
        if self.reread is not None:
            cells = self.reread(name)
        places: dict[str, int] = {}
        of_row = np.fromiter((places.setdefault(str(cell).strip(), len(places)) for cell in cells), int, len(cells))
        return Kinds(list(places), of_row)

    def numbers(self, name: str) -> np.ndarray:
        """A column as numbers (n,), NaN where a cell is empty.

        Raises:
            InputError: there is no such column, or a cell holds no number that can be used.
        """
        values = self._numbers(name)
        self._refuse(name, np.abs(values) > LARGEST, "is out of range", "expected numbers")
        return values

    def measured(self, name: str) -> np.ndarray:
        """The same, NaN also where a cell says by one of the keys' ``missing`` that nothing was measured (n,).

        Raises:
            InputError: as :meth:`numbers`.
        """
        values = self._without_missing(self._numbers(name))
        self._refuse(name, np.abs(values) > LARGEST, "is out of range", f"expected numbers, {MARKED}")
        return values

    def _numbers(self, name: str) -> np.ndarray:
        cells = self.column(name)
        if cells.dtype.kind in "biuf":
            return cells.astype(float, copy=False)
        values = self.parsed(cells)
        self._refuse(name, np.isneginf(values), "is no number", self._remedy(cells, np.isneginf(values)))
        return values

    def _without_missing(self, values: np.ndarray) -> np.ndarray:
        numbers = [mark for mark in self.keys.missing or () if not isinstance(mark, str)]
        return np.where(np.isin(values, numbers), np.nan, values) if numbers else values

    def parsed(self, cells: np.ndarray) -> np.ndarray:
        """Numbers of texts (n,): NaN where a cell is empty, −inf where it is none."""
        texts = {mark.strip().lower() for mark in self.keys.missing or () if isinstance(mark, str)}
        decimal, thousands, empty = self.keys.decimal, self.keys.thousands, EMPTY | texts
        parsed: dict[str, float] = {}
        numbers = np.empty(len(cells))
        for k, text in enumerate(map(str, cells)):
            number = parsed.get(text)
            if number is None:
                number = number_of(text, decimal, thousands, empty)
                if len(parsed) < MANY_TEXTS:
                    parsed[text] = number
            numbers[k] = number
        return numbers

    def mostly(self, name: str) -> np.ndarray | None:
        """The numbers of a column in which most cells that are not empty are some, (n,), else NaN; None of others."""
        cells = self.column(name)
        if cells.dtype.kind == "f":
            return self._without_missing(cells) if np.isfinite(cells).any() else None
        values = cells.astype(float) if cells.dtype.kind in "biuf" else self.parsed(cells)
        none = np.isneginf(values)
        numbers = np.where(none, np.nan, values) if np.isfinite(values).sum() > none.sum() else None
        return numbers if numbers is None else self._without_missing(numbers)

    def times(self, name: str, pattern: str | None = None, date: str | None = None) -> np.ndarray:
        """A column of dates and times, or of durations, (n,) as seconds, from the first of them on.

        Arguments:
            pattern: how they are written, as strptime says it; None: as :func:`dates.seconds` tells.
            date: the column of dates, where this one is of times of day.

        Raises:
            InputError: a cell is none, or may be read in two ways.
        """
        cells = self.column(name)
        if cells.dtype.kind in "iuf":
            cells = self.texts(name)
        if date is not None:
            cells = dates.join_texts(self.texts(date), self.texts(name))
        seconds, none = dates.seconds(self.path, name, cells, pattern)
        remedy = dates.CLOCK if pattern is None else f"data.files.time_format is '{pattern}'"
        if none.any() and date is not None:
            row = int(np.argmax(none))
            raise InputError(self.path, f"row {self.line[row]}: '{cells[row]}' is no date and time", remedy)
        self._refuse(name, none, "is no date and time", remedy)
        return seconds

    def _remedy(self, cells: np.ndarray, bad: np.ndarray) -> str:
        cell = str(cells[int(np.argmax(bad))])
        if re.fullmatch(r"\s*[-+]?\d+,\d+\s*", cell):
            return "for numbers with a comma set data.files.decimal to ','"
        if re.match(r"\s*(\d{1,4}[./:-]\d{1,2}[./:-]|\d{1,2}:\d\d)", cell):
            return "for dates and times set data.files.time to {name: …, unit: datetime}"
        if re.fullmatch(r"\s*[-+\N{MINUS SIGN}]?\d+\.?\d*\s*[^\W\d_°%]*[°%]?\s*", cell):
            return "write units in the header: a cell holds a number alone"
        return f"expected a number, or nothing where none was measured, {MARKED}"

    def column(self, name: str) -> np.ndarray:
        if name not in self.cells:
            listed = ", ".join(f"'{n}'" for n in self.names)
            raise InputError(self.path, f"no column '{name}'", f"its columns are {listed}")
        return self.cells[name]

    def _refuse(self, name: str, bad: np.ndarray, why: str, remedy: str) -> None:
        if bad.any():
            row = int(np.argmax(bad))
            cells = self.cells[name] if self.reread is None else self.reread(name)
            problem = f"row {self.line[row]}, column {name}: '{cells[row]}' {why}"
            raise InputError(self.path, problem, remedy)


def _whole_kinds(numbers: np.ndarray) -> Kinds:
    """Of whole numbers (n,), which often stay the same for many rows."""
    begins = np.flatnonzero(np.diff(numbers, prepend=numbers[:1] - 1))
    values, first, place = np.unique(numbers[begins], return_index=True, return_inverse=True)
    order = np.argsort(first)
    of_value = np.empty(len(values), dtype=int)
    of_value[order] = np.arange(len(values))
    of_row = np.repeat(of_value[place], np.diff(begins, append=len(numbers)))
    return Kinds([str(value) for value in values[order]], of_row)


def number_of(
    cell: object, decimal: str, thousands: str | None = None, empty: Collection[str] = frozenset(EMPTY)
) -> float:
    """A cell's number; NaN where it is empty, −inf where it is none."""
    text = str(cell).strip()
    if text.lower() in empty:
        return np.nan
    if thousands is not None and thousands in text:
        if not re.fullmatch(rf"[-+]?\d{{1,3}}({re.escape(thousands)}\d{{3}})+({re.escape(decimal)}\d*)?", text):
            return -np.inf
        text = text.replace(thousands, "")
    text = FORTRAN.sub("e", text.replace("\N{MINUS SIGN}", "-"))
    try:
        number = float(text.replace(decimal, ".") if decimal != "." else text)
    except ValueError:
        return -np.inf
    return number if np.isfinite(number) and "_" not in text else (np.nan if np.isnan(number) else -np.inf)

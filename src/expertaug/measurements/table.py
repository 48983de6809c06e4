"""A table of measurements as named columns: CSV with any common separator, Parquet, or NPZ."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from expertaug.errors import InputError
from expertaug.files import read_npz
from expertaug.measurements.settings import TableKeys

LARGEST = 1e30  # of any number: single precision must hold it
COMMENTS = ("#", "%")
EMPTY = {"", "nan", "na", "n/a", "#n/a", "null", "none", "-", "–", "."}
SEPARATORS = (",", ";", "\t", "|")
LARGE, HEAD = (
    2**20,
    2**16,
)  # bytes of a text that is not read line by line, and of what is read of it to see its columns
# Lines that are a comment or blank, letters of an encoding, and what else than \n may end a line.
_NOT_PLAIN = re.compile(rb"[\r\x0b\x0c\x1c-\x1e\0\x80-\xff]|^[ \t]*(?:[#%]|$)", re.MULTILINE)


@dataclass(frozen=True)
class Table:
    """Columns of one file, each (n,).

    Attributes:
        path: of the file.
        cells: column → texts (a CSV's) or numbers, times or texts (n,), as the file has them.
        line: the number of each row, as an editor counts lines (a CSV) or from 1.
        units: column → unit, where the file has a row of them.
        decimal: what separates a number's fraction in texts.
        reread: the texts of a column whose cells are numbers already, (n,); None where there are none.
    """

    path: Path
    cells: dict[str, np.ndarray]
    line: np.ndarray
    units: dict[str, str] = field(default_factory=dict)
    decimal: str = "."
    reread: Callable[[str], np.ndarray] | None = None

    @property
    def names(self) -> list[str]:
        return list(self.cells)

    def __len__(self) -> int:
        return len(self.line)

    def texts(self, name: str) -> np.ndarray:
        """A column as texts (n,)."""
        cells = self._column(name)
        numbers = cells if cells.dtype.kind == "f" else np.array([_number(cell, self.decimal) for cell in cells])
        if (numbers == np.rint(numbers)).all() and np.abs(numbers).max(initial=0) < 2**53:  # 3.0e+00 is 3
            cells = numbers.astype(np.int64)
        elif self.reread is not None:
            cells = self.reread(name)
        return np.array([str(cell).strip() for cell in cells], dtype=object)

    def numbers(self, name: str) -> np.ndarray:
        """A column as numbers (n,), NaN where a cell is empty.

        Raises:
            InputError: there is no such column, or a cell holds no number that can be used.
        """
        cells = self._column(name)
        if cells.dtype.kind in "biuf":
            values = cells.astype(float, copy=False)
        else:
            values = np.array([_number(cell, self.decimal) for cell in cells])
            self._refuse(name, np.isneginf(values), "is no number", self._remedy(cells, np.isneginf(values)))
        self._refuse(name, np.abs(values) > LARGEST, "is out of range", "expected numbers")
        return values

    def mostly(self, name: str) -> np.ndarray | None:
        """The numbers of a column in which most cells that are not empty are some, (n,), else NaN; None of others."""
        cells = self._column(name)
        if cells.dtype.kind == "f":
            return cells if np.isfinite(cells).any() else None
        values = (
            cells.astype(float) if cells.dtype.kind in "biuf" else np.array([_number(c, self.decimal) for c in cells])
        )
        none = np.isneginf(values)
        return np.where(none, np.nan, values) if np.isfinite(values).sum() > none.sum() else None

    def times(self, name: str) -> np.ndarray:
        """A column of dates and times (n,) as seconds, from the first of them on.

        Raises:
            InputError: a cell is none.
        """
        import pandas as pd

        cells = self._column(name)
        found = pd.to_datetime(pd.Series(cells), errors="coerce", utc=True, format="mixed")
        self._refuse(name, found.isna().to_numpy(), "is no date and time", "write them as 2024-05-31T12:00:00.25")
        return (found - found.iloc[0]).dt.total_seconds().to_numpy() if len(found) else np.zeros(0)

    def _remedy(self, cells: np.ndarray, bad: np.ndarray) -> str:
        cell = str(cells[int(np.argmax(bad))])
        if re.fullmatch(r"\s*[-+]?\d+,\d+\s*", cell):
            return "for numbers with a comma set data.files.decimal to ','"
        return "expected a number, or nothing where none was measured"

    def _column(self, name: str) -> np.ndarray:
        if name not in self.cells:
            listed = ", ".join(f"'{n}'" for n in self.names)
            raise InputError(self.path, f"no column '{name}'", f"its columns are {listed}")
        return self.cells[name]

    def _refuse(self, name: str, bad: np.ndarray, why: str, remedy: str) -> None:
        if bad.any():
            row = int(np.argmax(bad))
            cells = self.cells[name] if self.reread is None else self.reread(name)
            found = f"row {self.line[row]}, column {name}: '{cells[row]}' {why}"
            raise InputError(self.path, found, remedy)


def _number(cell: object, decimal: str) -> float:
    """A cell's number; NaN where it is empty, −inf where it is none."""
    text = str(cell).strip()
    if text.lower() in EMPTY:
        return np.nan
    try:
        found = float(text.replace(decimal, ".") if decimal != "." else text)
    except ValueError:
        return -np.inf
    return found if np.isfinite(found) and "_" not in text else (np.nan if np.isnan(found) else -np.inf)


def read_table(path: str | Path, keys: TableKeys) -> Table:
    """Read a table; nothing is converted or left out yet.

    Raises:
        InputError: the file is missing, empty or no table of its kind.
    """
    path = Path(path)
    kinds: dict[str, Callable[[Path, TableKeys], Table]] = {".npz": _read_npz, ".parquet": _read_parquet}
    table = kinds.get(path.suffix.lower(), _read_text)(path, keys)
    if not len(table):
        raise InputError(path, "holds no rows", "give a table with a row for each time")
    return table


def count_cells(path: Path) -> int:
    """Cells of the first row of a text file.

    Raises:
        InputError: it has none.
    """
    first = next((one for one in _text_of(path).splitlines() if _counts(one)), None)
    if first is None:
        raise InputError(path, "holds no rows", "give a table with a row for each time")
    separator = _separator(first)
    return len(first.split() if separator == " " else next(csv.reader([first], delimiter=separator)))


def _counts(line: str) -> bool:
    return bool(line.strip()) and not line.lstrip().startswith(COMMENTS)


def _read_text(path: Path, keys: TableKeys) -> Table:
    if path.is_file() and path.stat().st_size > LARGE:
        table = _read_large(path, keys)
        if table is not None:
            return table
    return _table_of(path, _text_of(path), keys)


def _read_large(path: Path, keys: TableKeys) -> Table | None:
    """A text of many rows by pandas' parser, which rounds numbers as Python does; None where it might read a cell in
    another way than line by line, or where there is something to complain of."""
    import pandas as pd

    data = path.read_bytes()
    if b"\r" in data:
        data = data.replace(b"\r\n", b"\n")
    end = len(data)
    while data[end - 1 : end] == b"\n":
        end -= 1
    head = data[: HEAD + 1].rpartition(b"\n")[0]
    try:
        first = _table_of(path, head.decode("utf-8-sig"), keys)
    except (InputError, UnicodeDecodeError):
        return None
    if not len(first):
        return None
    begin = 0
    for _ in range(first.line[0] - 1):
        begin = data.index(b"\n", begin) + 1
    separator = _separator(head[begin:].partition(b"\n")[0].decode()) if keys.separator is None else keys.separator
    header = head[: max(begin - 1, 0)].decode("utf-8-sig").splitlines()[keys.skip_lines :]
    if keys.separator is None and any(map(_counts, header)):
        separator = _separator(next(filter(_counts, header)))
    rows = data.count(b"\n", begin, end) + 1
    if len(separator.encode()) > 1 or _NOT_PLAIN.search(data, begin, end):
        return None
    given = {
        "header": None,
        "sep": r"\s+" if separator == " " else separator,
        "decimal": keys.decimal,
        "float_precision": "round_trip",
        "keep_default_na": False,
        "skip_blank_lines": False,
        "skipinitialspace": True,
        "nrows": rows,
    }
    empty = [form for text in EMPTY for form in {text, text.upper(), text.capitalize()} if form.isascii()]
    try:
        stream = io.BytesIO(data)  # of the same bytes, not of a copy
        stream.seek(begin)
        frame = pd.read_csv(stream, names=range(len(first.names)), na_values=[*empty, "NaN"], **given)
    except (ValueError, OverflowError):  # cells too many, or numbers too large
        return None
    if len(frame) != rows or _cells(data, begin, end, separator) != rows * len(first.names):
        return None

    skipped = int(first.line[0]) - 1

    def texts(name: str) -> np.ndarray:
        place = first.names.index(name)
        of_one = {"usecols": [place], "dtype": str, "na_filter": False, "skiprows": skipped}
        read = pd.read_csv(path, names=range(len(first.names)), **given | of_one)
        return read[place].str.strip().to_numpy(dtype=object)

    cells = {}
    for k, name in enumerate(first.names):
        column = frame.pop(k)
        if column.dtype.kind not in "iuf":
            cells[name] = texts(name)
            continue
        cells[name] = column.to_numpy(dtype=float)
        if not np.abs(cells[name][~np.isnan(cells[name])]).max(initial=0.0) <= min(LARGEST, 2.0**53):
            return None
    return Table(path, cells, first.line[0] + np.arange(rows), first.units, keys.decimal, texts)


def _cells(data: bytes, begin: int, end: int, separator: str) -> int:
    """How many cells the lines have in all."""
    if separator != " ":
        return data.count(separator.encode(), begin, end) + data.count(b"\n", begin, end) + 1
    count, before = 0, True
    for start in range(begin, end, HEAD):
        blank = np.isin(np.frombuffer(data, np.uint8, min(HEAD, end - start), start), (9, 10, 32))
        count += int((~blank & np.concatenate(([before], blank[:-1]))).sum())
        before = bool(blank[-1])
    return count


def _table_of(path: Path, text: str, keys: TableKeys) -> Table:
    """A table of a text, line by line."""
    lines = [(k, line) for k, line in enumerate(text.splitlines(), 1) if k > keys.skip_lines]
    lines = [(k, line) for k, line in lines if _counts(line)]
    if not lines:
        raise InputError(path, "holds no rows", "give a table with a row for each time")
    separator = _separator(lines[0][1]) if keys.separator is None else keys.separator
    split = str.split if separator == " " else lambda line: next(csv.reader([line], delimiter=separator))
    try:
        rows = [(k, [cell.strip() for cell in split(line)]) for k, line in lines]
    except csv.Error as error:
        raise InputError(path, f"no table ({error})", "set data.files.separator") from error
    if keys.names is None:
        names, rows = _header(path, rows[0], keys.decimal), rows[1:]
    else:
        names = list(keys.names)
    units: dict[str, str] = {}
    if rows and keys.names is None and not any(_is_value(cell, keys.decimal) for cell in rows[0][1]):
        units, rows = dict(zip(names, rows[0][1], strict=False)), rows[1:]
    for k, cells in rows:
        if len(cells) != len(names):
            of = "data.files.names has" if keys.names is not None else "the header has"
            remedy = "every row needs a cell for each column"
            if keys.names is not None:
                remedy = "name every column, in order"
            raise InputError(path, f"row {k} has {len(cells)} cells, {of} {len(names)}", remedy)
    columns = zip(*(cells for _, cells in rows), strict=True) if rows else [[] for _ in names]
    cells = {name: np.array(list(column), dtype=object) for name, column in zip(names, columns, strict=True)}
    return Table(path, cells, np.array([k for k, _ in rows], dtype=int), units, keys.decimal)


def _text_of(path: Path) -> str:
    try:
        data = path.read_bytes()
    except FileNotFoundError as error:
        raise InputError(path, "no such file", "correct data.files.paths") from error
    except OSError as error:
        raise InputError(path, f"cannot be read ({error.strerror})", "give a readable table") from error
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        try:
            return data.decode("utf-16")
        except UnicodeDecodeError as error:
            raise InputError(path, f"no text ({error.reason})", "save it as UTF-8") from error
    if b"\0" in data:
        raise InputError(path, "no text: it holds zero bytes", "give a CSV, a Parquet file or an NPZ by its suffix")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")  # only names of columns can be touched by that


def _separator(line: str) -> str:
    """What separates the cells of a line: the most frequent of the common ones outside of quotes, else blanks."""
    bare = re.sub(r'"[^"]*"', "", line)
    counts = {one: bare.count(one) for one in SEPARATORS}
    if counts[";"]:
        return ";"
    best = max(SEPARATORS, key=lambda one: counts[one])
    return best if counts[best] else " "


def _header(path: Path, row: tuple[int, list[str]], decimal: str) -> list[str]:
    number, names = row
    if all(_is_value(name, decimal) for name in names):
        found = f"row {number} holds numbers where the names of the columns are expected"
        raise InputError(path, found, f"name the {len(names)} columns in data.files.names")
    _refuse_twins(path, names)
    return [name or f"column {k}" for k, name in enumerate(names, 1)]


def _refuse_twins(path: Path, names: Sequence[str]) -> None:
    twin = next((name for k, name in enumerate(names) if name and name in names[:k]), None)
    if twin is not None:
        raise InputError(path, f"two columns are called '{twin}'", "rename one, or name all in data.files.names")


def _is_value(cell: str, decimal: str) -> bool:
    return any(not np.isneginf(_number(cell, one)) for one in {decimal, ","})


def _read_parquet(path: Path, keys: TableKeys) -> Table:
    try:
        from pyarrow import parquet
    except ImportError as error:
        raise InputError(path, "Parquet needs the package pyarrow", "install it, or save a CSV") from error
    if not path.is_file():
        raise InputError(path, "no such file", "correct data.files.paths")
    try:
        frame = parquet.read_table(path).to_pandas()
    except Exception as error:  # pyarrow raises a dozen kinds
        raise InputError(path, f"not a Parquet file ({error})", "write it again") from error
    frame.columns = [str(name) for name in frame.columns]
    _refuse_twins(path, list(frame.columns))
    cells = {name: frame[name].to_numpy() for name in frame.columns}
    return Table(path, cells, np.arange(1, len(frame) + 1))


def _read_npz(path: Path, keys: TableKeys) -> Table:
    cells = read_npz(path, "file of arrays", "save it with numpy.savez: an array (n,) for each column")
    lengths = {name: array.shape for name, array in cells.items()}
    if not lengths:
        raise InputError(path, "holds no array", "save it with numpy.savez: an array (n,) for each column")
    first = next(iter(lengths))
    for name, shape in lengths.items():
        if len(shape) != 1 or shape != lengths[first]:
            found = f"array {name} has shape {shape}, {first} {lengths[first]}"
            raise InputError(path, found, "arrays are columns: (n,), all of one length; trajectories follow each other")
    return Table(path, dict(cells), np.arange(1, lengths[first][0] + 1))

"""Tables of files: CSV with any common separator, Parquet, or NPZ."""

from __future__ import annotations

import codecs
import csv
import io
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from expertaug.errors import InputError
from expertaug.files import read_npz
from expertaug.measurements.reshape import pivot_table, put_below, refuse_twins
from expertaug.measurements.settings import TableKeys
from expertaug.measurements.table import EMPTY, LARGEST, MANY_TEXTS, Table, number_of

COMMENTS = ("#", "%")
# A number with its thousands told apart: by what, and what then begins the fraction.
THOUSANDS = re.compile(
    r"[-+]?[1-9]\d{0,2}(?:(?P<thousands>[.,'\u0020\u00a0\u2009\u202f])\d{3})(?:(?P=thousands)\d{3})*(?:(?P<decimal>[.,])\d+)?"
)
SEPARATORS = (",", ";", "\t", "|")
LOOKED_AT = 1000  # lines, to find where a table begins
ROWS_AT_ONCE = 2**16  # of a large text, that the parser holds beside what it found
LARGE, HEAD = 2**20, 2**16  # bytes of a text that is not read line by line, and of what tells its columns
# Lines that are a comment or hold nothing, letters of an encoding, and what else than \n may end a line.
_NOT_PLAIN = re.compile(rb"[\r\x0b\x0c\x1c-\x1e\0\x80-\xff]|^[ \t,;|]*(?:[#%]|$)", re.MULTILINE)


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
    table = table if keys.beside is None else put_below(table, keys.beside)
    return table if keys.pivot is None else pivot_table(table, keys.pivot)


def head_of(path: Path, keys: TableKeys) -> Table:
    """The first rows of a text file as a table; of other files all.

    Raises:
        InputError: `read_table`.
    """
    if path.suffix.lower() in (".npz", ".parquet"):
        return read_table(path, keys.model_copy(update={"pivot": None, "beside": None}))
    return _table_of(path, beginning(path), keys)


def beginning(path: Path) -> str:
    """The first lines of a text file.

    Raises:
        InputError: it cannot be read, or is no text.
    """
    text = _text_of(path, 4 * HEAD)
    return text if path.stat().st_size <= 4 * HEAD else text.rpartition("\n")[0]


def count_cells(path: Path, keys: TableKeys) -> int:
    """Cells of the first row of a text file.

    Raises:
        InputError: it has none.
    """
    first = next((line for line in beginning(path).splitlines()[keys.skip_lines :] if _counts(line)), None)
    if first is None:
        raise InputError(path, "holds no rows", "give a table with a row for each time")
    return len(_split(first, _separator(first) if keys.separator is None else keys.separator))


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
    if keys.thousands is not None or len(separator.encode()) > 1 or _NOT_PLAIN.search(data, begin, end):
        return None
    options = {
        "header": None,
        "sep": r"\s+" if separator == " " else separator,
        "decimal": keys.decimal,
        "float_precision": "round_trip",
        "keep_default_na": False,
        "skip_blank_lines": False,
        "skipinitialspace": True,
        "nrows": rows,
    }
    if _cells(data, begin, end, separator) != rows * len(first.names):
        return None
    empty = [form for text in EMPTY for form in {text, text.upper(), text.capitalize()} if form.isascii()]
    places, shared = range(len(first.names)), dict[str, str]()
    of_words = [bool(np.isneginf(first.parsed(cells)).any()) for cells in first.cells.values()]
    worded = {k: np.empty(rows, dtype=object) for k in places if of_words[k]}
    parsed = {k: np.empty(rows) for k in places if not of_words[k]}
    kinds = {"na_values": {k: [*empty, "NaN"] for k in parsed}, "dtype": dict.fromkeys(worded, object)}
    read_rows = 0
    try:
        stream = io.BytesIO(data)  # of the same bytes, not of a copy
        stream.seek(begin)
        for part in pd.read_csv(stream, names=places, chunksize=ROWS_AT_ONCE, **kinds, **options):
            here = slice(read_rows, read_rows + len(part))
            for k in [k for k in parsed if part[k].dtype.kind not in "iuf"]:
                del parsed[k]
            for k, column in parsed.items():
                column[here] = part[k]
            for k, column in worded.items():
                column[here] = _share_texts(part[k], shared)
            read_rows += len(part)
    except (ValueError, OverflowError):  # cells too many, or numbers too large
        return None
    if read_rows != rows:
        return None
    del data, stream

    skipped = int(first.line[0]) - 1

    def texts(name: str) -> np.ndarray:
        k = first.names.index(name)
        of_one = {"usecols": [k], "dtype": object, "na_filter": False, "skiprows": skipped, "chunksize": ROWS_AT_ONCE}
        parts = pd.read_csv(path, names=places, **options | of_one)
        return np.concatenate([_share_texts(part[k], shared) for part in parts])

    cells = {}
    for k, name in enumerate(first.names):
        if k not in parsed:
            cells[name] = worded.pop(k) if k in worded else texts(name)
            continue
        cells[name] = parsed.pop(k)
        if max(np.nanmax(cells[name], initial=0.0), -np.nanmin(cells[name], initial=0.0)) > min(LARGEST, 2.0**53):
            return None
    return Table(path, cells, first.line[0] + np.arange(rows), first.units, keys, texts)


def _share_texts(column: Any, shared: dict[str, str]) -> np.ndarray:
    """A column (n,) of texts without blanks around them, of which those that come again are one object.

    Arguments:
        column: pandas' Series.
        shared: the texts before these, to which new ones are added.
    """
    import pandas as pd

    place, texts = pd.factorize(column.to_numpy(dtype=object))
    for k, text in enumerate(map(str.strip, texts)):
        texts[k] = shared.setdefault(text, text) if len(shared) < MANY_TEXTS else shared.get(text, text)
    return texts[place]


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


def lines_above(text: str) -> int:
    """Lines of a text that come before its table: what loggers write above the names of the columns.

    The table is what the last of the first lines belong to: rows of as many cells, most of them numbers.
    """
    lines = text.splitlines()[:LOOKED_AT]
    counted = [k for k, line in enumerate(lines) if _counts(line)]
    best, begins = 0, 0
    for separator in (*SEPARATORS, " "):
        cells = {k: [c.strip() for c in _split(lines[k], separator)] for k in counted}
        rows = [k for k in counted if len(cells[k]) > 1 and _mostly_numbers(cells[k])]
        while rows and (len(cells[rows[0]]) != len(cells[rows[-1]]) or not _without_a_pause(rows, counted)):
            rows = rows[1:]
        header = [k for k in counted if rows and k < rows[0]]
        if len(rows) < 3 or not header or len(rows) * len(cells[rows[-1]]) <= best:
            continue
        place, two, width = header[-1], header[-2:], len(cells[rows[0]])
        if len(two) > 1 and {len(cells[k]) for k in two} == {width} and 2 * sum(map(bool, cells[two[0]])) > width:
            place = two[0]  # names, and a row of units below
        if len(cells[place]) >= len(cells[rows[-1]]):
            best, begins = len(rows) * len(cells[rows[-1]]), place
    return begins


def _without_a_pause(rows: list[int], counted: list[int]) -> bool:
    """Whether every line from the first of these rows on is one of them."""
    return len(rows) == len(counted) - counted.index(rows[0])


def _mostly_numbers(cells: list[str]) -> bool:
    filled = [cell for cell in cells if cell]
    return (
        2 * sum(any(char.isdigit() for char in cell) for cell in filled) >= len(filled) > 0
        and not filled[0][0].isalpha()
    )


def _split(line: str, separator: str) -> list[str]:
    return line.split() if separator == " " else next(csv.reader([line], delimiter=separator), [])


def _table_of(path: Path, text: str, keys: TableKeys) -> Table:
    """A table of a text, line by line."""
    lines = [(k, line) for k, line in enumerate(text.splitlines(), 1) if k > keys.skip_lines]
    lines = [(k, line) for k, line in lines if _counts(line)]
    if not lines:
        raise InputError(path, "holds no rows", "give a table with a row for each time")
    separator = _separator(lines[0][1]) if keys.separator is None else keys.separator
    if keys.names is None and lines[0][1].count('"') % 2:
        problem = f"row {lines[0][0]}: the quoted name of a column goes on in the next line"
        raise InputError(path, problem, "write each name in one line, or set data.files.skip_lines and names")
    try:
        rows = [(k, [cell.strip() for cell in _split(line, separator)]) for k, line in lines]
    except csv.Error as error:
        raise InputError(path, f"no table ({error})", "set data.files.separator") from error
    if keys.names is None:
        names, rows = _header(path, rows[0], keys.decimal), rows[1:]
    else:
        names = list(keys.names)
    units: dict[str, str] = {}
    if rows and keys.names is None and not any(_is_value(cell, keys.decimal) for cell in rows[0][1]):
        units, rows = dict(zip(names, rows[0][1], strict=False)), rows[1:]
    rows = [(k, cells) for k, cells in rows if any(cells)]  # a spreadsheet ends in rows of nothing
    most = max((len(cells) for _, cells in rows), default=0)
    if keys.names is None and 1 < most < len(names):  # the last columns, of comments, may be left out throughout
        rows = [(k, cells + [""] * (len(names) - most)) for k, cells in rows]
    for k, cells in rows:
        if len(cells) != len(names):
            of = "data.files.names has" if keys.names is not None else "the header has"
            remedy = "every row needs a cell for each column"
            if keys.names is not None:
                remedy = "name every column, in order"
            elif above := lines_above(text):
                remedy = f"for the {above} lines above the table set data.files.skip_lines to {above}"
            raise InputError(path, f"row {k} has {len(cells)} cells, {of} {len(names)}", remedy)
    columns = zip(*(cells for _, cells in rows), strict=True) if rows else [[] for _ in names]
    cells = {name: np.array(list(column), dtype=object) for name, column in zip(names, columns, strict=True)}
    return Table(path, cells, np.array([k for k, _ in rows], dtype=int), units, keys)


def _text_of(path: Path, most: int = -1) -> str:
    """A file's text, or that of its first bytes."""
    try:
        with path.open("rb") as stream:
            data = stream.read(most)
    except FileNotFoundError as error:
        raise InputError(path, "no such file", "correct data.files.paths") from error
    except OSError as error:
        raise InputError(path, f"cannot be read ({error.strerror})", "give a readable table") from error
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        try:
            return data[: len(data) // 2 * 2].decode("utf-16")
        except UnicodeDecodeError as error:
            raise InputError(path, f"no text ({error.reason})", "save it as UTF-8") from error
    if b"\0" in data:
        raise InputError(path, "no text: it holds zero bytes", "give a CSV, a Parquet file or an NPZ by its suffix")
    try:
        return data.decode("utf-8-sig") if most < 0 else codecs.getincrementaldecoder("utf-8-sig")().decode(data)
    except UnicodeDecodeError:
        return data.decode("latin-1")  # only names of columns can be touched by that


def _separator(line: str) -> str:
    """What separates the cells of a line: the most frequent of the common ones outside of quotes, else blanks."""
    bare = re.sub(r'"[^"]*"', "", line)
    counts = {separator: bare.count(separator) for separator in SEPARATORS}
    if counts[";"]:
        return ";"
    best = max(SEPARATORS, key=lambda separator: counts[separator])
    return best if counts[best] else " "


def _header(path: Path, row: tuple[int, list[str]], decimal: str) -> list[str]:
    number, names = row
    if all(_is_value(name, decimal) for name in names):
        problem = f"row {number} holds numbers where the names of the columns are expected"
        raise InputError(path, problem, f"name the {len(names)} columns in data.files.names")
    refuse_twins(path, names)
    return [name or f"column {k}" for k, name in enumerate(names, 1)]


def _is_value(cell: str, decimal: str) -> bool:
    return bool(THOUSANDS.fullmatch(cell)) or any(
        not np.isneginf(number_of(cell, separator)) for separator in {decimal, ","}
    )


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
    refuse_twins(path, list(frame.columns))
    cells = {name: frame[name].to_numpy() for name in frame.columns}
    return Table(path, cells, np.arange(1, len(frame) + 1), keys=keys)


def _read_npz(path: Path, keys: TableKeys) -> Table:
    cells = read_npz(path, "file of arrays", "save it with numpy.savez: an array (n,) for each column")
    lengths = {name: array.shape for name, array in cells.items()}
    if not lengths:
        raise InputError(path, "holds no array", "save it with numpy.savez: an array (n,) for each column")
    first = next(iter(lengths))
    for name, shape in lengths.items():
        if len(shape) != 1 or shape != lengths[first]:
            problem = f"array {name} has shape {shape}, {first} {lengths[first]}"
            raise InputError(
                path, problem, "arrays are columns: (n,), all of one length; trajectories follow each other"
            )
    return Table(path, dict(cells), np.arange(1, lengths[first][0] + 1), keys=keys)

"""How a table is laid out, found from the file itself: the keys that read it, and what a reader should know of them."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from expertaug.errors import InputError
from expertaug.measurements.guess import TRAJECTORIES, bare, likeness
from expertaug.measurements.settings import TableKeys
from expertaug.measurements.table import EMPTY, Table
from expertaug.measurements.table_files import (
    THOUSANDS,
    beginning,
    count_cells,
    head_of,
    lines_above,
    read_table,
)
from expertaug.measurements.units import parse_header

COMMA = re.compile(r"[-+]?\d+(,\d+)?([eE][-+]?\d+)?")
BLANKS = "\u0020\u00a0\u2009\u202f"  # of every width: French tables have a narrow one
WHOLE = re.compile(rf"[-+]?\d{{1,3}}|[-+]?[1-9]\d{{0,2}}([.,'{BLANKS}]\d{{3}})+")  # as 987 and 1.234, and never 1.2
# What tells runs apart in the names of their columns, as Latest, Run 2 and #3.
RUN = re.compile(r"\b(latest|run|trial|data set|dataset|series|serie|lauf|versuch|messung)\b|\d+")
TIMES = ("t", "time", "zeit", "temps", "tiempo", "tempo")
SEVERAL = 3  # numbers of each kind, or columns of a name, that are no coincidence
WELL = re.compile(r"[A-P](0?[1-9]|1\d|2[0-4])")  # of a plate
NUMBERED = re.compile(r"(?P<stem>.*[^\d\s].*?)\d+")
MOST_SENSORS = 200  # of a table in long format
# What the columns of such a table are often called.
SENSORS = ("sensor", "variable", "channel", "signal", "quantity", "parameter", "measurement", "name", "tag", "kind")
SENSORS += ("observable", "item", "metric", "component", "key", "type", "measure", "sensor id", "sensor name")
VALUES = ("value", "val", "values", "reading", "wert", "result", "data", "measured", "measured value")
UNITS = ("unit", "units", "einheit")


@dataclass(frozen=True)
class Layout:
    """How a file is read.

    Attributes:
        keys: of :class:`TableKeys`, what is not their default.
        table: the file as they read it.
        remarks: what was found that is not plain.
    """

    keys: dict[str, object]
    table: Table
    remarks: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Marks:
    """What separates thousands, what begins a fraction, and a number that has the first."""

    thousands: str
    decimal: str
    example: str


def recognise(
    path: Path,
    overrides: Mapping[str, object] | None = None,
    component: str | None = None,
    aside: Collection[str | None] = (),
) -> Layout:
    """Find how a file is laid out.

    Arguments:
        overrides: keys that are known.
        component: of a state that has no other, of which columns may be runs.
        aside: columns that are something else.

    Raises:
        InputError: it is no table.
    """
    keys = {k: v for k, v in (overrides or {}).items() if k in TableKeys.model_fields}
    remarks: list[str] = []

    def read(of: Callable[[Path, TableKeys], Table]) -> Table:
        return of(path, TableKeys.from_mapping({k: v for k, v in keys.items() if v is not None}))

    if path.suffix.lower() not in (".npz", ".parquet"):
        if "skip_lines" not in keys and (above := lines_above(beginning(path))) and not _is_table(read):
            keys["skip_lines"] = above
            remarks.append(f"lines above the table, which are skipped: {above}")
        if "names" not in keys and _has_no_header(read):
            keys["names"] = [f"c{k}" for k in range(1, count_cells(path, TableKeys.from_mapping(keys)) + 1)]
        if "thousands" not in keys and (marks := _thousands(read(head_of))):
            keys = {"thousands": marks.thousands, "decimal": marks.decimal} | keys
            remark = f"'{marks.thousands}' is taken for what separates thousands, as in {marks.example}"
            remarks.append(f"{remark}; if it begins a fraction: --set thousands=null")
    table = read(read_table)
    if "decimal" not in keys and any(_has_commas(cells) for cells in table.cells.values()):
        keys["decimal"] = ","
        table = read(read_table)
    _refuse_runs_beside(table)
    if "pivot" not in keys and (pivot := _long(table)):
        keys["pivot"] = pivot
        remarks.append(f"long format: the '{pivot['value']}' of each '{pivot['name']}' becomes a column")
        table = read(read_table)
    if component is not None and not {"beside", "pivot", "names"} & keys.keys():
        runs = _runs_beside(table, component, aside)
        if runs:
            told = [parse_header(name) for name in runs]
            units = {header.unit if header.sure else "" for header in told}
            unit = next(iter(units)) if len(units) == 1 else ""
            keys["beside"] = {"columns": runs, "value": f"{component} [{unit}]" if unit else component}
            named = f"{len(runs)} columns, '{runs[0]}' to '{runs[-1]}'"
            remarks.append(f"{named}, are taken for a run of {component} each (beside); if not: --set beside=null")
            table = read(read_table)
    return Layout({k: v for k, v in keys.items() if v is not None}, table, remarks)


def _is_table(read: Callable[[Callable], Table]) -> bool:
    """Whether the file is a table from its first line on, with several columns, most of which have a name."""
    try:
        names = read(head_of).names
    except InputError:
        return False
    unnamed = sum(bool(re.fullmatch(r"column \d+", name)) for name in names)
    return len(names) > 1 and 2 * unnamed < len(names)


def _has_no_header(read: Callable[[Callable], Table]) -> bool:
    try:
        read(head_of)
    except InputError as error:
        return "holds numbers" in str(error)  # what else is wrong is said when all of it is read
    return False


def _thousands(table: Table) -> Marks | None:
    """What separates the thousands of a column's numbers.

    Certain where a number has both separators or one of them twice; else where dots, or commas, stand before three
    digits throughout a column, and other numbers have none: 1.234 beside 987, never 1.2.
    """
    for cells in table.cells.values():
        if cells.dtype.kind not in "OU":
            continue
        texts = [text for cell in cells if (text := str(cell).strip()).lower() not in EMPTY]
        matches = [match for text in texts if (match := THOUSANDS.fullmatch(text))]
        for match in matches:
            mark, decimal = match["thousands"], match["decimal"]
            if decimal != mark and (decimal is not None or match[0].count(mark) > 1):
                marks = Marks(mark, decimal or ("," if mark == "." else "."), match[0])
                if all(_is_number(text, marks) for text in texts):
                    return marks
        several = min(len(matches), len(texts) - len(matches)) >= SEVERAL
        if several and all(map(WHOLE.fullmatch, texts)) and len({match["thousands"] for match in matches}) == 1:
            mark = matches[0]["thousands"]
            return Marks(mark, "," if mark == "." else ".", matches[0][0])
        if matches and matches[0]["thousands"] in f"'{BLANKS}" and all(map(WHOLE.fullmatch, texts)):
            return Marks(matches[0]["thousands"], ".", matches[0][0])  # nothing else stands so in a number
    return None


def _is_number(text: str, marks: Marks) -> bool:
    whole = rf"[-+]?(\d{{1,3}}({re.escape(marks.thousands)}\d{{3}})+|\d+)"
    return re.fullmatch(rf"{whole}({re.escape(marks.decimal)}\d*)?", text) is not None


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


def _refuse_runs_beside(table: Table) -> None:
    """Refuse a table in which runs stand beside each other, each with times of its own.

    Raises:
        InputError: the name of the times and another come again, apart from what tells runs apart.
    """
    bare = [re.sub(r"[^\w]+|_", " ", RUN.sub(" ", name.lower())).strip() for name in table.names]
    counts = Counter(bare)
    times = [name for name in counts if set(name.split()) & set(TIMES)]
    runs = counts[times[0]] if len(times) == 1 else 1
    if runs > 1 and any(count == runs for name, count in counts.items() if name not in times):
        these = ", ".join(f"'{name}'" for name, of in zip(table.names, bare, strict=True) if of in times)
        remedy = "save a file for each, or put them below each other with a column that names the run"
        raise InputError(table.path, f"has {runs} runs beside each other, with times {these}", remedy)


def _runs_beside(table: Table, component: str, aside: Collection[str | None]) -> list[str]:
    """Columns of numbers that are called alike but for a number, or as the wells of a plate, where no other column is
    the component and none tells runs apart."""
    families: dict[str, list[str]] = {}
    for name in table.names:
        if name in aside or table.mostly(name) is None:
            continue
        header = parse_header(name)
        match = NUMBERED.fullmatch(header.name if header.sure else name)
        stem = "" if WELL.fullmatch(name) else match["stem"].strip(" _.#-").lower() if match else None
        if stem is not None and stem != "column":
            families.setdefault(stem, []).append(name)
    largest = max(families.values(), key=len, default=[])
    others = [name for name in table.names if name not in largest]
    told = any(likeness(component, name) >= 1.5 or bare(name) in TRAJECTORIES for name in others)
    return [] if told or len(largest) < SEVERAL else largest


def _long(table: Table) -> dict[str, object] | None:
    """The key ``pivot`` where a table has a row for each moment and sensor: one column is called as values are, and
    beside it is one of few texts, which together with the others tells all rows apart."""
    called = {name: re.sub(r"[^a-z]+", " ", name.lower()).strip() for name in table.names}
    values = [name for name in table.names if called[name] in VALUES and table.mostly(name) is not None]
    if len(values) != 1:
        return None
    words = [n for n in table.names if table.cells[n].dtype.kind in "OU" and table.mostly(n) is None]
    units = [name for name in words if called[name] in UNITS]
    kinds = {name: len(set(table.cells[name].tolist())) for name in words if name not in units}
    few = [name for name, count in kinds.items() if 1 < count <= min(MOST_SENSORS, len(table) // 2)]
    sensors = [name for name in few if called[name] in SENSORS] or (few if len(few) == 1 else [])
    if not sensors:
        return None
    pivot: dict[str, object] = {"name": sensors[0], "value": values[0], **({"unit": units[0]} if units else {})}
    rest = [name for name in table.names if name not in (sensors[0], values[0], *units)]
    if called[sensors[0]] in SENSORS and _count_different(table, rest) == len(table):
        return pivot  # each sensor at times of its own
    for by in (rest, rest[:1]):  # what else a row says, as its number or quality, may differ from sensor to sensor
        if by and _count_different(table, [*by, sensors[0]]) == len(table) > _count_different(table, by):
            return pivot | ({} if by == rest else {"by": by})
    return None


def _count_different(table: Table, names: list[str]) -> int:
    """How many different rows these columns have."""
    import pandas as pd

    return len(pd.DataFrame({name: table.texts(name) for name in names}).drop_duplicates())

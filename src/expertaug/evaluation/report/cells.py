"""Tables as the page shows them: titles over columns, and rows of text in parts."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from expertaug.evaluation.formats import DASH

Cells = Sequence[str]


@dataclass(frozen=True)
class Table:
    """Cells of a table in HTML.

    Attributes:
        head: titles of the columns.
        parts: rows, each part of them under a title of its own (empty: without one).
        names: how many of the first columns say what a row is of; the others are numbers.
        spans: titles over neighbouring columns beyond the names, with the number of columns below each.
    """

    head: Cells
    parts: Sequence[tuple[str, Sequence[Cells]]]
    names: int = 1
    spans: Sequence[tuple[str, int]] = field(default=())

    @property
    def size(self) -> int:
        """How many rows there are."""
        return sum(len(rows) for _, rows in self.parts)


def spans(titles: Iterable[str]) -> list[tuple[str, int]]:
    """Titles over columns, of neighbours with the same title one."""
    found: list[tuple[str, int]] = []
    for title in titles:
        if found and found[-1][0] == title:
            found[-1] = (title, found[-1][1] + 1)
        else:
            found.append((title, 1))
    return found


def plain(value: object) -> str:
    """A value of a CSV file: numbers with four digits, a dash for none."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return str(value)
    if math.isnan(value):
        return DASH
    text = f"{value:.4g}" if not float(value).is_integer() or abs(value) >= 1e15 else f"{value:.0f}"
    return text.replace("-", "−")

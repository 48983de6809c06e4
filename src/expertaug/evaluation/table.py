"""Tables: one value, written as CSV, Markdown, LaTeX or HTML; and what a stage makes of its numbers."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from expertaug.errors import InputError, printable
from expertaug.evaluation.metrics import Metric
from expertaug.files import write_text

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

DASH = "–"
STAR = "*"  # behind a marked mean in HTML
FIGURES = (".png", ".pdf")


@dataclass(frozen=True)
class Cell:
    """A mean over seeds as it is printed: mean [low, high] where it has an interval, else mean ± standard deviation;
    – where there is none, as of parameters whose truth nobody knows.

    Attributes:
        metric: of which.
        mean, std: over the n seeds that have a finite value, of ``of``.
        low, high: ends of its interval; NaN where there is none.
        marked: whether it stands out: the best, or told apart from 0.
    """

    metric: Metric
    mean: float = math.nan
    std: float = math.nan
    n: int = 0
    of: int = 0
    low: float = math.nan
    high: float = math.nan
    marked: bool = False

    def text(self, star: bool = False) -> str:
        """Plain text; ``star`` marks the mean."""
        if self.of == 0:
            return DASH
        if self.n == 0:
            return f"not finite (0/{self.of})"
        mean, spread, few = self._numbers()
        mean += STAR if star and self.marked else ""
        if spread:
            mean += f" ± {spread[0]}" if len(spread) == 1 else f" [{', '.join(spread)}]"
        return mean.replace("-", "−") + few

    def markdown(self) -> str:
        return f"**{self.text()}**" if self.marked else self.text()

    def tex(self) -> str:
        """The ends of the interval as sub- and superscript."""
        if self.n == 0:
            return tex(self.text())
        mean, spread, few = self._numbers()
        mean = rf"\mathbf{{{mean}}}" if self.marked else mean
        if not spread:
            return f"${mean}$" + few
        if len(spread) == 1:
            return rf"${mean} \pm {spread[0]}$".replace(DASH, r"\text{--}") + few
        return f"${mean}_{{{spread[0]}}}^{{{spread[1]}}}$" + few

    def _numbers(self) -> tuple[str, list[str], str]:
        """Mean, ends of its interval or standard deviation (neither where seeds share a job's value), and how many of
        the seeds they are of, if not of all."""
        shown = self.metric.format(self.mean)

        def show(value: float) -> str:
            return shown(value if float(shown(value)) else 0.0)  # no −0.0

        few = f" ({self.n}/{self.of})" if self.n < self.of else ""
        if math.isfinite(self.low):
            return show(self.mean), [show(self.low), show(self.high)], few
        if self.metric.of_job and not self.std > 1e-9 * self.mean:
            return show(self.mean), [], few
        return show(self.mean), [DASH if math.isnan(self.std) else show(self.std)], few


Row = Sequence["str | Cell"]


@dataclass(frozen=True)
class Table:
    """A table.

    Attributes:
        head: titles of the columns.
        parts: rows, each part of them under a title of its own (empty: without one).
        names: how many of the first columns say what a row is of; the others are numbers.
        spans: titles over neighbouring columns beyond the names, with the number of columns below each.
        title, caption: above it; without a title it continues the table before.
        label: of the LaTeX table, and its title where that is not ``title``; without a label it is not in LaTeX.
        notes: lines below it.
        empty: what stands in its place where it has no rows.
    """

    head: Sequence[str]
    parts: Sequence[tuple[str, Sequence[Row]]]
    names: int = 1
    spans: Sequence[tuple[str, int]] = field(default=())
    title: str = ""
    caption: str = ""
    label: str = ""
    label_title: str = ""
    notes: Sequence[str] = ()
    empty: str = ""

    @property
    def size(self) -> int:
        """How many rows there are."""
        return sum(len(rows) for _, rows in self.parts)

    @property
    def html_parts(self) -> list[tuple[str, list[list[str]]]]:
        """Parts with cells as the report prints them."""
        return [
            (title, [[cell.text(True) if isinstance(cell, Cell) else cell for cell in row] for row in rows])
            for title, rows in self.parts
        ]

    def markdown(self) -> str:
        lines = [f"## {self.title}", ""] if self.title else []
        lines += [self.caption, ""] if self.caption else []
        if not self.size and self.empty:
            return "\n".join([*lines, self.empty])
        over = [""] * self.names + [title for title, width in self.spans for _ in range(width)]
        over += [""] * (len(self.head) - len(over))
        head = [f"{above}: {title}" if above else title for above, title in zip(over, self.head, strict=True)]
        rows = []
        for title, part in self.parts:
            rows += [[f"*{title}:*", *[""] * (len(self.head) - 1)]] if title and part else []
            rows += [[c.markdown() if isinstance(c, Cell) else escape(c) for c in row] for row in part]
        lines += grid(head, rows, self.names)
        return "\n".join([*lines, *(["", *self.notes] if self.notes else [])])

    def tex(self) -> str:
        """A rule stands between parts."""
        parts = [[[c.tex() if isinstance(c, Cell) else tex(c) for c in row] for row in part] for _, part in self.parts]
        rows: list[list[str]] = []
        for part in filter(None, parts):
            rows += [[], *part] if rows else part
        head = [*map(tex, self.head)]
        columns, over = "l" * self.names + "r" * (len(head) - self.names), []
        if self.spans:
            columns = "l" + "r" * (len(head) - 1)
            first = self.names + sum(width for title, width in self.spans if not title)
            spans, rules, column = [], [], first + 1
            for title, width in ((title, width) for title, width in self.spans if title):
                spans.append(rf"\multicolumn{{{width}}}{{c}}{{{tex(title)}}}")
                rules.append(rf"\cmidrule(lr){{{column}-{column + width - 1}}}")
                column += width
            over = ["    " + "& " * first + " & ".join(spans) + r" \\", "    " + " ".join(rules)]
        lines = [
            r"% needs \usepackage{booktabs,amsmath}",
            r"\begin{table}",
            r"  \centering\footnotesize\setlength{\tabcolsep}{3pt}",
            rf"  \caption{{\textbf{{{tex(self.label_title or self.title)}.}} {tex(self.caption)}}}",
            rf"  \label{{tab:{self.label}}}",
            rf"  \begin{{tabular}}{{{columns}}}",
            r"    \toprule",
            *over,
            "    " + " & ".join(head) + r" \\",
            r"    \midrule",
            *("    " + (" & ".join(row) + r" \\" if row else r"\midrule") for row in rows),
            r"    \bottomrule",
            r"  \end{tabular}",
            r"\end{table}",
        ]
        return "\n".join(lines) + "\n"


@dataclass(frozen=True)
class Study:
    """What a stage makes of its numbers: files of one name.

    Attributes:
        numbers: all of them, in full precision: the CSV.
        tables: those that are printed.
        figure: draws the figure, where there is one; it is drawn only where it is asked for.
        long: what a CSV whose name ends in ``_long`` has instead of ``numbers``.
        precision: of the CSV, as of :meth:`pandas.DataFrame.to_csv`; None: full.
    """

    numbers: pd.DataFrame
    tables: Sequence[Table]
    figure: Callable[[], Figure] | None = None
    long: pd.DataFrame | None = None
    precision: str | None = None

    def csv(self, output: Path) -> str:
        table = self.long if self.long is not None and output.stem.endswith("_long") else self.numbers
        return table.to_csv(index=False, float_format=self.precision)

    def markdown(self) -> str:
        return "\n\n".join(table.markdown() for table in self.tables) + "\n"

    def tex(self) -> str:
        return "\n".join(table.tex() for table in self.tables if table.label)

    def save(self, outputs: Iterable[str | Path]) -> None:
        """Write each output by its suffix: .csv, .md, .tex, and .png and .pdf where there is a figure.

        Raises:
            InputError: an output has another suffix; nothing is written then.
        """
        paths = [Path(output) for output in outputs]
        writers = {".csv": self.csv, ".md": lambda _: self.markdown(), ".tex": lambda _: self.tex()}
        drawn = [path for path in paths if self.figure is not None and path.suffix in FIGURES]
        for path in paths:
            if path not in drawn and path.suffix not in writers:
                raise InputError(path, f"suffix {path.suffix!r}", f"one of {', '.join(writers)}")
        for path in paths:
            if path not in drawn:
                write_text(path, writers[path.suffix](path))
        if drawn and self.figure is not None:
            from expertaug import plotting

            with plotting.use_style():
                plotting.save(self.figure(), drawn)


def spans(titles: Iterable[str]) -> list[tuple[str, int]]:
    """Titles over columns, of neighbours with the same title one."""
    merged: list[tuple[str, int]] = []
    for title in titles:
        if merged and merged[-1][0] == title:
            merged[-1] = (title, merged[-1][1] + 1)
        else:
            merged.append((title, 1))
    return merged


def plain(value: object) -> str:
    """A value of a CSV file: numbers with four digits, a dash for none."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return str(value)
    if math.isnan(value):
        return DASH
    text = f"{value:.4g}" if not float(value).is_integer() or abs(value) >= 1e15 else f"{value:.0f}"
    return text.replace("-", "−")


def grid(header: Sequence[str], rows: Sequence[Sequence[str]], texts: int) -> list[str]:
    """Lines of a Markdown table whose first ``texts`` columns are text and the others numbers."""
    rule = ["---" if i < texts else "---:" for i in range(len(header))]
    return ["| " + " | ".join(row) + " |" for row in (header, rule, *rows)]


def escape(text: str) -> str:
    """Text in a cell of a Markdown table: of one line, and nothing in it is HTML."""
    return re.sub(r"[|]|<(?=[A-Za-z/!?])", r"\\\g<0>", printable(text))


def tex(text: str) -> str:
    """Text in LaTeX."""
    text = printable(text)
    for plain, escaped in (
        ("\\", r"\textbackslash "),
        ("^", r"\textasciicircum "),
        ("~", r"\textasciitilde "),
        ("&", r"\&"),
        ("%", r"\%"),
        ("$", r"\$"),
        ("#", r"\#"),
    ):
        text = text.replace(plain, escaped)
    for plain, escaped in (("_", r"\_"), ("{", r"\{"), ("}", r"\}"), ("±", r"$\pm$"), ("−", "$-$"), (DASH, "--")):
        text = text.replace(plain, escaped)
    text = text.replace("⁺", "$^+$").replace("∈", r"$\in$").replace("→", r"$\to$")
    text = text.replace("⁻³", "$^{-3}$").replace("∇", r"$\nabla$").replace(" · ", r" $\cdot$ ")
    return text.replace("|estimate $-$ truth| / |truth|", r"$|\hat z - z| / |z|$").replace("(t1, t2]", "$(t_1, t_2]$")

"""Cells and tables as text, in Markdown and LaTeX."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from expertaug.errors import InputError
from expertaug.evaluation.metrics import metric_of
from expertaug.files import write_text

if TYPE_CHECKING:
    import pandas as pd

DASH = "–"
DRAWN = (".png", ".pdf")
KNOWN_FORM = "F_a of known form, which does not compete:"  # a title over rows
RUNAWAYS_NOTE = (
    "Runaways: forecasts that leave ten times the training set's largest values, or have no solution; they count with "
    "the error that they have at that bound."
)
COST_NOTE = (
    "Estimate: processor time in which one seed estimates the parameters and the start of one window, all windows at "
    "once, on one core; solving the equation follows, for a flow once for each of the draws that are forecast."
)


def cell_text(cell: Mapping | None, metric: str) -> str:
    """A row of :func:`expertaug.evaluation.summary.summarise`: mean [low, high] where it has an interval, else mean ±
    standard deviation; – where there is none, as of parameters whose truth nobody knows."""
    if cell is None or cell["of"] == 0:
        return DASH
    if cell["n"] == 0:
        return f"not finite (0/{cell['of']})"
    mean, spread, few = _numbers(cell, metric)
    if not spread:
        return mean.replace("-", "−") + few
    text = f"{mean} ± {spread[0]}" if len(spread) == 1 else f"{mean} [{', '.join(spread)}]"
    return text.replace("-", "−") + few


def cell_tex(cell: Mapping | None, metric: str, bold: bool = False) -> str:
    """The same in LaTeX, the ends of the interval as sub- and superscript."""
    if cell is None or cell["n"] == 0:
        return tex(cell_text(cell, metric))
    mean, spread, few = _numbers(cell, metric)
    mean = rf"\mathbf{{{mean}}}" if bold else mean
    if not spread:
        return f"${mean}$" + few
    if len(spread) == 1:
        return rf"${mean} \pm {spread[0]}$".replace(DASH, r"\text{--}") + few
    return f"${mean}_{{{spread[0]}}}^{{{spread[1]}}}$" + few


def _numbers(cell: Mapping, metric: str) -> tuple[str, list[str], str]:
    """Mean, ends of its interval or standard deviation (neither where seeds share a job's value), and how many of the
    seeds they are of, if not of all."""
    shown = metric_of(metric).format(cell["mean"])

    def show(value: float) -> str:
        return shown(value if float(shown(value)) else 0.0)  # no −0.0

    few = f" ({cell['n']}/{cell['of']})" if cell["n"] < cell["of"] else ""
    if math.isfinite(cell.get("low", math.nan)):
        return show(cell["mean"]), [show(cell["low"]), show(cell["high"])], few
    if metric_of(metric).of_job and not cell["std"] > 1e-9 * cell["mean"]:
        return show(cell["mean"]), [], few
    return show(cell["mean"]), [DASH if math.isnan(cell["std"]) else show(cell["std"])], few


def write_tables(outputs: Sequence[str | Path], texts: Mapping[str, Callable[[Path], str]]) -> None:
    """Write each output by its suffix.

    Arguments:
        texts: suffix → the text of an output.

    Raises:
        InputError: an output has another suffix; nothing is written then.
    """
    for output in map(Path, outputs):
        if output.suffix not in texts:
            raise InputError(output, f"suffix {output.suffix!r}", f"one of {', '.join(texts)}")
    for output in map(Path, outputs):
        write_text(output, texts[output.suffix](output))


def write_study(
    outputs: Sequence[str | Path],
    long: pd.DataFrame,
    table: tuple[Sequence[str], Sequence[Sequence[str]], int],
    caption: str,
    label: str,
    title: str,
    empty: str = "",
) -> list[Path]:
    """Write the tables of a study: all numbers as .csv, those that are printed as .md and .tex under a caption.

    Arguments:
        outputs: any of .csv, .md, .tex, .png and .pdf.
        table: header, rows of plain cells, and how many of the first columns are text.
        label: of the LaTeX table.
        empty: what stands in the .md instead of a table without rows.

    Returns:
        those of the outputs that are figures, which are left to the caller.

    Raises:
        InputError: an output has another suffix; nothing is written then.
    """
    header, rows, texts = table
    cells = grid(header, [[escape(cell) for cell in row] for row in rows], texts) if rows or not empty else [empty]
    drawn = [path for path in map(Path, outputs) if path.suffix in DRAWN]
    write_tables(
        [path for path in map(Path, outputs) if path not in drawn],
        {
            ".csv": lambda _: long.to_csv(index=False),
            ".md": lambda _: "\n".join([f"## {title}", "", caption, "", *cells]) + "\n",
            ".tex": lambda _: booktabs(header, rows, texts, caption, label, title),
        },
    )
    return drawn


def grid(header: Sequence[str], rows: Sequence[Sequence[str]], texts: int) -> list[str]:
    """Lines of a Markdown table whose first ``texts`` columns are text and the others numbers."""
    rule = ["---" if i < texts else "---:" for i in range(len(header))]
    return ["| " + " | ".join(row) + " |" for row in (header, rule, *rows)]


def escape(text: str) -> str:
    """Text in a cell of a Markdown table."""
    return text.replace("|", "\\|")


def tex(text: str) -> str:
    """Text in LaTeX."""
    for plain, escaped in (("\\", r"\textbackslash "), ("&", r"\&"), ("%", r"\%"), ("$", r"\$"), ("#", r"\#")):
        text = text.replace(plain, escaped)
    for plain, escaped in (("_", r"\_"), ("{", r"\{"), ("}", r"\}"), ("±", r"$\pm$"), ("−", "$-$"), (DASH, "--")):
        text = text.replace(plain, escaped)
    text = text.replace("⁺", "$^+$").replace("∈", r"$\in$").replace("→", r"$\to$")
    text = text.replace("⁻³", "$^{-3}$").replace("∇", r"$\nabla$").replace(" · ", r" $\cdot$ ")
    return text.replace("|estimate $-$ truth| / |truth|", r"$|\hat z - z| / |z|$").replace("(t1, t2]", "$(t_1, t_2]$")


def booktabs(
    header: Sequence[str], rows: Sequence[Sequence[str]], texts: int, caption: str, label: str, title: str
) -> str:
    """A LaTeX table of plain cells; an empty row becomes a rule."""
    head = ["    " + " & ".join(map(tex, header)) + r" \\"]
    body = [[tex(cell) for cell in row] for row in rows]
    return _table("l" * texts + "r" * (len(header) - texts), head, body, caption, label, title)


def spanned(
    first: Sequence[str],
    columns: Sequence[tuple[str, str]],
    rows: Sequence[Sequence[str]],
    caption: str,
    label: str,
    title: str,
) -> str:
    """A LaTeX table whose columns are grouped.

    Arguments:
        first: titles of the first columns, the first of them of text.
        columns: group and title of each of the others.
        rows: cells, in LaTeX.
    """
    spans, rules, column = [], [], len(first) + 1
    for group in dict.fromkeys(group for group, _ in columns):
        width = sum(one == group for one, _ in columns)
        spans.append(rf"\multicolumn{{{width}}}{{c}}{{{tex(group)}}}")
        rules.append(rf"\cmidrule(lr){{{column}-{column + width - 1}}}")
        column += width
    head = [
        "    " + "& " * len(first) + " & ".join(spans) + r" \\",
        "    " + " ".join(rules),
        "    " + " & ".join(tex(text) for text in (*first, *(text for _, text in columns))) + r" \\",
    ]
    return _table("l" + "r" * (len(first) - 1 + len(columns)), head, rows, caption, label, title)


def _table(
    columns: str, head: Sequence[str], rows: Sequence[Sequence[str]], caption: str, label: str, title: str
) -> str:
    lines = [
        r"% needs \usepackage{booktabs,amsmath}",
        r"\begin{table}",
        r"  \centering\footnotesize\setlength{\tabcolsep}{3pt}",
        rf"  \caption{{\textbf{{{tex(title)}.}} {tex(caption)}}}",
        rf"  \label{{tab:{label}}}",
        rf"  \begin{{tabular}}{{{columns}}}",
        r"    \toprule",
        *head,
        r"    \midrule",
        *("    " + (" & ".join(row) + r" \\" if row else r"\midrule") for row in rows),
        r"    \bottomrule",
        r"  \end{tabular}",
        r"\end{table}",
    ]
    return "\n".join(lines) + "\n"

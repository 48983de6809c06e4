"""The tables of one experiment as Markdown and LaTeX."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import pandas as pd

from expertaug.evaluation import gains
from expertaug.evaluation.formats import (
    COST_NOTE,
    DASH,
    KNOWN_FORM,
    RUNAWAYS_NOTE,
    cell_tex,
    cell_text,
    escape,
    grid,
    spanned,
    tex,
)
from expertaug.evaluation.intervals import LEVEL, Interval
from expertaug.evaluation.metrics import CONVENTIONS, COST, DIVERGED, RELATIVE_ERROR, Shown, metric_of
from expertaug.evaluation.samples import Samples
from expertaug.evaluation.summary import (
    any_of,
    last_columns,
    order_sets,
    set_title,
    tabled_metrics,
)

Column = tuple[str, str]  # set and metric
BEST = "Bold: the best of each column, and those that are not told apart from it."


@dataclass(frozen=True)
class Printed:
    """What is printed of one experiment.

    Attributes:
        part: rows of the summary, in order, with ``row`` (method and preset), ``low`` and ``high``.
        settings: as of :func:`expertaug.evaluation.tables.tabulate`, with the parameters' ``units``.
        chosen: metrics of the first table.
        columns: its columns (set, metric).
        values: row of the summary by row, set and metric.
        best: those of these that are bold.
        known_form: rows of methods whose F_a has the form of the hidden term, which are last.
        gained: as of :func:`expertaug.evaluation.gains.gains`.
        resampled: what the intervals resample beside seeds.
    """

    part: pd.DataFrame
    settings: Mapping
    chosen: list[str]
    columns: list[Column]
    values: Mapping[tuple[str, str, str], pd.Series]
    best: set[tuple[str, str, str]]
    known_form: set[str]
    gained: Mapping[tuple[str, str, str, str], Interval]
    resampled: str

    @classmethod
    def of(cls, part: pd.DataFrame, settings: Mapping, samples: Samples, gained: Mapping) -> Printed:
        """The tables of one experiment."""
        chosen = tabled_metrics(part, settings.get("convention", "sum"))
        columns = [*_columns(part, chosen), *last_columns(part)]
        values = {(row["row"], row["set"], row["metric"]): row for _, row in part.iterrows()}
        resampled = "whole recordings" if samples.by_recording(part["experiment"].iloc[0]) else "samples"
        return cls(
            part,
            settings,
            chosen,
            columns,
            values,
            _best(part, columns, samples, (*settings.get("floors", ()), *settings.get("known_form", ()))),
            set(part.loc[part["method"].isin(settings.get("known_form", ())), "row"]),
            gained,
            resampled,
        )

    def markdown(self) -> str:
        """The log-MSE and the parameters' error, what augmentation gains, and the other metrics."""
        rows = []
        for row, label, count in self._rows():
            texts = [(cell_text(self.values.get((row, *c)), c[1]), (row, *c) in self.best) for c in self.columns]
            if row == self._first_of_known_form():
                rows.append([f"*{KNOWN_FORM}*", *[""] * (1 + len(self.columns))])
            rows.append([escape(label), str(count), *(_bold(text, best) for text, best in texts)])
        titles = [f"{name}: {metric}" for name, metric in self._titles(self.columns)]
        lines = [f"## {self.part['experiment'].iloc[0]}", "", f"{self._caption()} {BEST}", ""]
        lines += grid(["method", "seeds", *titles], rows, 1)
        for header, table, note in (self._gains_in_markdown(), self._further()):
            if table:
                lines += ["", note, "", *grid(header, table, 2)]
        return "\n".join(lines) + "\n"

    def latex(self) -> str:
        """The first two of these tables."""
        rows = []
        for row, label, count in self._rows():
            cells = [cell_tex(self.values.get((row, *c)), c[1], (row, *c) in self.best) for c in self.columns]
            if row == self._first_of_known_form():
                rows.append([])  # a rule
            rows.append([tex(label), str(count), *cells])
        name = self.part["experiment"].iloc[0]
        label, caption = name.replace("_", "-"), f"{self._caption()} {BEST}"
        texts = [spanned(["method", "seeds"], self._titles(self.columns), rows, caption, label, name)]
        columns, gained = self._gains()
        if gained:
            rows = [
                [tex(version), kind, *(cell_tex(gains.as_cell(g), c[1], _apart(g)) for g, c in found)]
                for version, kind, found in gained
            ]
            title = f"{name}, gains"
            texts.append(spanned(["method", ""], self._titles(columns), rows, gains.CAPTION, f"{label}-gains", title))
        return "\n".join(texts)

    def _rows(self) -> list[tuple[str, str, int]]:
        """Key, label and number of seeds of every row."""
        first = self.part.drop_duplicates("row")
        counts = [len(seeds.split()) for seeds in first["seeds"]]
        return list(zip(first["row"], first["label"], counts, strict=True))

    def _first_of_known_form(self) -> str | None:
        """Key of the first row of a method whose F_a has the form of the hidden term."""
        return next((row for row, *_ in self._rows() if row in self.known_form), None)

    def _titles(self, columns: Sequence[Column]) -> list[tuple[str, str]]:
        """Set and metric of columns, as printed."""
        units = self.settings["units"]
        return [(set_title(name, self.settings), metric_of(metric).heading(units)) for name, metric in columns]

    def _gains(self) -> tuple[list[Column], list[tuple[str, str, list[tuple[Interval | None, Column]]]]]:
        """Columns, and label, kind and differences with their columns of each row, of the second table."""
        differ = {(name, metric) for _, _, name, metric in self.gained}
        columns = [column for column in self.columns if column in differ]
        compared = {row for row, *_ in self.gained}
        shown = [(row, label, kind) for row, label, _ in self._rows() if row in compared for kind in gains.KINDS]
        rows = [(label, k, [(self.gained.get((row, k, *c)), c) for c in columns]) for row, label, k in shown]
        return columns, rows

    def _gains_in_markdown(self) -> tuple[list[str], list[list[str]], str]:
        columns, gained = self._gains()
        rows = [
            [escape(label), kind, *(_bold(cell_text(gains.as_cell(g), c[1]), _apart(g)) for g, c in found)]
            for label, kind, found in gained
        ]
        header = ["method", "", *(f"{name}: {metric}" for name, metric in self._titles(columns))]
        return header, rows, gains.CAPTION

    def _further(self) -> tuple[list[str], list[list[str]], str]:
        """The metrics that are not in the first table, a row for each and each method."""
        sets, units, rows = order_sets(self.part["set"]), self.settings["units"], []
        for metric in dict.fromkeys(self.part["metric"]):
            described = metric_of(metric)
            if metric in self.chosen or described.shown in (Shown.WHERE_ANY, Shown.LAST):
                continue
            title = described.heading(units) + (f" ({metric})" if described.is_log else "")
            for row, label, _ in self._rows():
                found = [self.values.get((row, name, metric)) for name in sets]
                if any(cell is not None for cell in found):
                    rows.append([title, escape(label), *(cell_text(cell, metric) for cell in found)])
        return ["metric", "method", *(set_title(s, self.settings) for s in sets)], rows, "Further metrics:"

    def _caption(self) -> str:
        """What every table says of itself: preset, seeds, spread, convention, units."""
        part, convention = self.part, self.settings.get("convention", "sum")
        parts = [f"Preset: {', '.join(dict.fromkeys(part['preset']))}.", self._spread()]
        if metric_of(self.chosen[0]).is_log:
            start = self.settings.get("from_s", "")
            named = {"": "the evaluated times", None: "the forecast window (t1, t2]"}
            times = named.get(start, f"times from {start} s on")
            parts.append(
                f"log-MSE (no unit): natural logarithm of the mean, over samples and {times}, of the squared error"
                f" {CONVENTIONS[convention]} (convention: {convention})."
            )
        if RELATIVE_ERROR.name in self.chosen:
            parts.append("Error: mean of |estimate − truth| / |truth| of the expert parameters, in %.")
            if (part["of"] == 0).any():
                parts.append(f"{DASH} there: nobody knows the truth.")
        if (part["n"] < part["of"]).any():
            parts.append("(a/b): only a of b seeds have a finite value, and only those are averaged.")
        if any_of(DIVERGED, part):
            parts.append(RUNAWAYS_NOTE)
        if (part["metric"] == COST.name).any():
            parts.append(COST_NOTE)
        return " ".join(parts)

    def _spread(self) -> str:
        """What stands beside a mean."""
        sizes = sorted({count for *_, count in self._rows()})
        counted = "1 seed" if sizes == [1] else f"{' or '.join(map(str, sizes))} seeds"
        deviation = f"standard deviation (n − 1) over {counted} per method; {DASH}: no value, or none of one seed."
        if not self.part["low"].notna().any():
            return f"Mean ± {deviation}"
        both = f"{self.resampled} alone" if sizes == [1] else f"seeds and {self.resampled} both"
        ends = f"Mean and the ends of its 95 % interval, for which {both} are resampled."
        return f"{ends} Where samples' errors are not kept, mean ± {deviation}"


def _columns(part: pd.DataFrame, metrics: Sequence[str]) -> list[Column]:
    """The columns (set, metric) that hold a value, set by set; shares of runaways where there are any."""
    told = part[(part["metric"] != DIVERGED.name) | part["set"].map(lambda s: any_of(DIVERGED, part[part["set"] == s]))]
    known = set(zip(told["set"], told["metric"], strict=True))
    return [(name, metric) for name in order_sets(part["set"]) for metric in metrics if (name, metric) in known]


def _best(
    part: pd.DataFrame, columns: Sequence[Column], samples: Samples, apart: Sequence[str] = ()
) -> set[tuple[str, str, str]]:
    """Of every column of errors with something to compare: the method with the smallest mean over all of its seeds, and
    those that a test on pairs of the same seed and samples does not tell apart from it."""
    found = set()
    for name, metric in columns:
        # The equation that made the data is a floor, no competitor; a method that is told its form is none either.
        column = part[
            ~part["method"].isin(apart)
            & (part["set"] == name)
            & (part["metric"] == metric)
            & (part["n"] == part["of"])
            & (part["of"] > 0)
        ]
        if len(column) < 2 or metric_of(metric).better is None:
            continue
        best = column.loc[column["mean"].idxmin() if metric_of(metric).better == "lower" else column["mean"].idxmax()]
        found.add((best["row"], name, metric))
        for _, other in column.iterrows():
            keys = [(row["experiment"], row["preset"], row["method"]) for row in (best, other)]
            difference = samples.difference(*keys, name, metric)
            if difference is not None and difference.p >= 1 - LEVEL:
                found.add((other["row"], name, metric))
    return found


def _apart(found: Interval | None) -> bool:
    return found is not None and found.told_apart


def _bold(text: str, best: bool) -> str:
    return f"**{text}**" if best else text

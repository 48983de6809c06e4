"""The stage compare: this run's numbers beside the paper's, with a verdict for each."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from expertaug.errors import InputError
from expertaug.evaluation.formats import DASH, booktabs, cell_text, escape, grid, write_tables
from expertaug.evaluation.summary import read_metrics, set_title, summarise

NUMBERS = Path(__file__).with_name("paper.csv")
# The paper's tables (labels of its source), by metric.
TITLES = {
    "log_mse_sum": "log-MSE (paper, table synth_log_mse)",
    "relative_error": "relative error of the expert parameters in % (paper, table param_acc)",
}
HEADER = ["experiment", "set", "method", "published", "ours", "seeds", "verdict"]
NO_VALUE = "not run"


@dataclass(frozen=True)
class Published:
    """One number of the paper: mean ± std over n runs, printed with ``decimals`` decimals."""

    table: str
    system: str
    label: str
    set: str
    metric: str
    mean: float
    std: float
    n: int
    decimals: int

    @property
    def spread(self) -> float:
        """One standard deviation; where it is printed as zero, the half of the last digit that it may still be."""
        return max(self.std, 0.5 * 10**-self.decimals)


def published_numbers(path: Path = NUMBERS) -> list[Published]:
    """The numbers of the paper's tables synth_log_mse and param_acc."""
    with Path(path).open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    return [
        Published(
            **{key: row[key] for key in ("table", "system", "label", "set", "metric")},
            mean=float(row["mean"]),
            std=float(row["std"]),
            n=int(row["n"]),
            decimals=len(row["mean"].partition(".")[2]),
        )
        for row in rows
    ]


def verdict(published: Published, mean: float) -> str:
    """within = at most one published standard deviation away, else better (lower) or worse; both metrics are errors."""
    if not math.isfinite(mean):
        return "worse"
    if abs(mean - published.mean) <= published.spread:
        return "within"
    return "better" if mean < published.mean else "worse"


def compare(metrics: Sequence[Path], outputs: Sequence[Path], settings: Mapping) -> None:
    """Write tables of published and own numbers.

    Arguments:
        metrics: metrics.csv of every method and group of seeds, of one experiment or of several.
        outputs: any of .csv (full precision), .md and .tex.
        settings: {published}: pairs of an experiment and the system that the paper's numbers are of.

    Raises:
        InputError: a file is broken, a system is unknown, or an output's suffix.
    """
    table = comparison(summarise(read_metrics(metrics)), settings)
    texts = {".csv": table.to_csv(index=False), ".md": _markdown(table), ".tex": _latex(table)}
    write_tables(outputs, {suffix: lambda output: texts[output.suffix] for suffix in texts})


def comparison(summary: pd.DataFrame, settings: Mapping) -> pd.DataFrame:
    """One row per published number and experiment that is compared with it, in the paper's order."""
    numbers = published_numbers()
    ours = {(row["experiment"], row["label"], row["set"], row["metric"]): row for _, row in summary.iterrows()}
    presets = dict(zip(summary["experiment"], summary["preset"], strict=True))
    rows = []
    for experiment, system in settings["published"]:
        found = [number for number in numbers if number.system == system]
        if not found:
            known = ", ".join(dict.fromkeys(number.system for number in numbers))
            raise InputError(f"published numbers of {experiment}", f"no system '{system}'", f"known: {known}")
        for one in found:
            cell = ours.get((experiment, one.label, one.set, one.metric))
            rows.append(
                {
                    "table": one.table,
                    "experiment": experiment,
                    "preset": presets.get(experiment),
                    "set": one.set,
                    "label": one.label,
                    "metric": one.metric,
                    "published_mean": one.mean,
                    "published_std": one.std,
                    "published_n": one.n,
                    "mean": math.nan if cell is None else cell["mean"],
                    "std": math.nan if cell is None else cell["std"],
                    "n": 0 if cell is None else int(cell["n"]),
                    "of": 0 if cell is None else int(cell["of"]),
                    "verdict": NO_VALUE if cell is None else verdict(one, float(cell["mean"])),
                }
            )
    return pd.DataFrame(rows)


def _parts(table: pd.DataFrame) -> list[tuple[str, pd.DataFrame]]:
    return [(metric, part) for metric in TITLES if len(part := table[table["metric"] == metric])]


def _rows(part: pd.DataFrame) -> list[list[str]]:
    """Printed cells; a number of ours has one digit more than the published one."""
    rows, decimals = [], {(n.metric, n.system): n.decimals for n in published_numbers()}
    digits = max(d for (metric, _), d in decimals.items() if metric == part["metric"].iloc[0])
    for _, row in part.iterrows():
        published = f"{row['published_mean']:.{digits}f} ± {row['published_std']:.{digits}f}".replace("-", "−")
        ours = cell_text(row, row["metric"]) if row["of"] else DASH
        name = set_title(row["set"], {})
        rows.append([row["experiment"], name, row["label"], published, ours, str(row["of"]), row["verdict"]])
    return rows


def _counts(part: pd.DataFrame) -> str:
    run = part[part["verdict"] != NO_VALUE]
    good = int(run["verdict"].isin(["within", "better"]).sum())
    return f"At or below the published mean plus one standard deviation: {good} of {len(run)}."


def _caption(part: pd.DataFrame) -> str:
    presets = ", ".join(f"{e}: {p}" for e, p in dict(zip(part["experiment"], part["preset"], strict=True)).items())
    runs = ", ".join(str(n) for n in sorted(set(part["published_n"])))
    return (
        f"Preset of {presets}. Published: mean ± standard deviation over {runs} runs; ours: over the seeds of the "
        "column. within = at most one published standard deviation from the published mean (where that is printed as "
        f"0, half a unit of the last digit); better = lower; worse = higher. {_counts(part)}"
    )


def _markdown(table: pd.DataFrame) -> str:
    lines = []
    for metric, part in _parts(table):
        rows = [[escape(cell) for cell in row] for row in _rows(part)]
        lines += [f"## {TITLES[metric]}", "", _caption(part), "", *grid(HEADER, rows, 3), ""]
    return "\n".join(lines)


def _latex(table: pd.DataFrame) -> str:
    texts = []
    for metric, part in _parts(table):
        rows: list[list[str]] = []
        previous = None
        for row in _rows(part):
            if previous not in (None, row[0]):
                rows.append([])
            rows.append(row)
            previous = row[0]
        label = part["table"].iloc[0]
        texts.append(booktabs(HEADER, rows, 3, _caption(part), label, TITLES[metric]))
    return "\n".join(texts)

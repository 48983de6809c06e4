"""Fills the tables of README.md and docs/*.md: ``python benchmarks/readme_tables.py [--check] [--root CHECKOUT]``.

They come from results/published.  A comment names a table's source, ``<!-- table: FOLDER NAME [VERSIONS] -->``; the
table below it is replaced; VERSIONS, if given, are its rows, apart by commas.  NAME is a table of the paper
(synth_log_mse, param_acc: ours, the published number in brackets) or an experiment (log-MSE of every method and set).
With ``--check`` nothing is written, and the exit status says whether all are as published.
"""

from __future__ import annotations

import argparse
import math
import re
import sys
from pathlib import Path

import pandas as pd
import yaml

from expertaug.evaluation.metrics import metric_of
from expertaug.evaluation.settings import Titles
from expertaug.evaluation.table import Cell, grid
from expertaug.files import write_text

CELL = ("mean", "std", "n", "low", "high")
PAPER = {"synth_log_mse": "log-MSE", "param_acc": "parameter error [%]"}
MARK = re.compile(r"(<!-- table: (\S+) (\S+)(?: (\S+))? -->\n)((?:\|.*\n)*)")


def of_paper(folder: Path, name: str) -> list[str]:
    """A table of the paper: a row for each experiment and set, a column for each method that was run."""
    experiments = yaml.safe_load((folder / "config.yaml").read_text(encoding="utf-8"))["experiments"]
    table = pd.read_csv(folder / "tables" / "published.csv")
    table = table[(table["table"] == name) & (table["n"] > 0)]
    digits = "{:.1f} ± {:.1f}" if name == "synth_log_mse" else "{:.0f} ± {:.0f}"
    labels = sorted(table["label"].unique(), key=lambda label: (label.rstrip("+"), label))
    rows = []
    for (experiment, one_set), part in table.groupby(["experiment", "set"], sort=False):
        titles = Titles(title=experiments[experiment]["evaluation"].get("title"))
        row = [titles.of_experiment(experiment), titles.of_set(one_set)]
        for label in labels:
            cell = part[part["label"] == label].iloc[0]
            theirs = digits.format(cell["published_mean"], cell["published_std"]).replace("-", "−")
            row.append(f"{Cell.of_row(metric_of(cell['metric']), cell).text()} ({theirs})")
        rows.append(row)
    return grid([PAPER[name], "set", *labels], rows, 2)


def of_experiment(folder: Path, name: str, versions: str | None) -> list[str]:
    """Log-MSE of every method on training, validation, IID (where there is one) and test set, in the experiment's
    convention; intervals where the run has them."""
    experiments = yaml.safe_load((folder / "config.yaml").read_text(encoding="utf-8"))["experiments"]
    metric = f"log_mse_{experiments[name]['evaluation'].get('convention', 'sum')}"
    table = pd.read_csv(folder / "tables" / f"{name}.csv")
    if versions is not None:
        table = table.set_index("method", drop=False).loc[versions.split(",")]
    sets = [s for s in ("train", "validation", "iid", "test") if f"{s}/{metric}/mean" in table]
    rows = []
    for _, line in table.iterrows():
        cells = [{k: line.get(f"{s}/{metric}/{k}", math.nan) for k in CELL} for s in sets]
        of = len(str(line["seeds"]).split())
        rows.append([line["label"], *(Cell.of_row(metric_of(metric), cell | {"of": of}).text() for cell in cells)])
    titles = {"iid": "IID test", "test": "test (OOD)"}
    return grid(["method", *(titles.get(s, s) for s in sets)], rows, 1)


def main() -> int:
    """Fill, or with --check compare; the exit status is 1 where a table is not as published."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--root", type=Path, default=Path(__file__).parents[1], help="of the checkout")
    options = parser.parse_args()

    def filled(match: re.Match) -> str:
        folder, name = options.root / "results" / "published" / match[2], match[3]
        lines = of_paper(folder, name) if name in PAPER else of_experiment(folder, name, match[4])
        return match[1] + "\n".join(lines) + "\n"

    stale = 0
    for page in (options.root / "README.md", *sorted((options.root / "docs").glob("*.md"))):
        text = page.read_text(encoding="utf-8")
        new = MARK.sub(filled, text)
        if new == text:
            continue
        stale = 1
        if not options.check:
            write_text(page, new)
    return stale if options.check else 0


if __name__ == "__main__":
    sys.exit(main())

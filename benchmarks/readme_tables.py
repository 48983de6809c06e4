"""Fills the tables of README.md and docs/*.md: ``python benchmarks/readme_tables.py [--check] [--root CHECKOUT]``.

They come from results/published.  A comment names the source of what stands behind it:

- ``<!-- table: FOLDER NAME [VERSIONS] -->``: the table below is replaced; VERSIONS, if given, are its rows, apart by
  commas.  NAME is a table of the paper (synth_log_mse, param_acc: ours, the published number in brackets) or an
  experiment (log-MSE of every method and set).
- ``<!-- beside the paper: FOLDER EXPERIMENT VERSIONS -->``: log-MSE of versions on the test sets, with the paper's
  number beside each and a mark where each window is fitted.
- ``<!-- seeds: FOLDER EXPERIMENT VERSIONS SET -->``: the log-MSE of each seed on a set, the worst bold.
- ``<!-- curves: FOLDER EXPERIMENT ALONG SET -->``: log-MSE on a set by what the study data_curves has ``along``.
- ``<!-- value: FOLDER TABLE VERSION SET METRIC [gain] -->…<!-- -->``, in a line: a cell, or its gain over the control.
- ``<!-- count: FOLDER WHAT -->…<!-- -->``: how many cells of the paper's tables are at_or_below, better or worse.
- ``<!-- alarm: FOLDER EXPERIMENT VERSION SCORE -->…<!-- -->``: a score's AUROC on the shifted test, mean over seeds.

With ``--check`` nothing is written, and the exit status says whether all are as published.
"""

from __future__ import annotations

import argparse
import math
import re
import sys
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import pandas as pd
import yaml

from expertaug.evaluation.data_curves import AXES, Point
from expertaug.evaluation.metrics import metric_of
from expertaug.evaluation.settings import Titles
from expertaug.evaluation.summary import TabledMean
from expertaug.evaluation.table import Cell, grid, plain
from expertaug.files import write_text
from expertaug.rows import group_by, read_csv
from expertaug.versions import Version, base

CELL = ("mean", "std", "n", "low", "high")
PAPER = {"synth_log_mse": "log-MSE", "param_acc": "parameter error [%]"}
MARK = re.compile(r"(<!-- table: (\S+) (\S+)(?: (\S+))? -->\n)((?:\|.*\n)*)")
BESIDE = re.compile(r"(<!-- beside the paper: (\S+) (\S+) (\S+) -->\n)((?:\|.*\n)*)")
SEEDS = re.compile(r"(<!-- seeds: (\S+) (\S+) (\S+) (\S+) -->\n)((?:\|.*\n)*)")
CURVES = re.compile(r"(<!-- curves: (\S+) (\S+) (\S+) (\S+) -->\n)((?:\|.*\n)*)")
VALUE = re.compile(r"(<!-- value: (\S+) (\S+) (\S+) (\S+) (\S+)( gain)? -->)[^<]*(<!-- -->)")
COUNT = re.compile(r"(<!-- count: (\S+) (\S+) -->)[^<]*(<!-- -->)")
ALARM = re.compile(r"(<!-- alarm: (\S+) (\S+) (\S+) (\S+) -->)[^<]*(<!-- -->)")


def of_paper(folder: Path, name: str) -> list[str]:
    """A table of the paper: a row for each experiment and set, a column for each method that was run."""
    experiments = _config(folder)["experiments"]
    table = _table(folder / "tables" / "published.csv")
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
            ours = {key: cell[key] for key in (*CELL, "of")}
            row.append(f"{Cell(metric_of(cell['metric']), **ours).text()} ({theirs})")
        rows.append(row)
    return grid([PAPER[name], "set", *labels], rows, 2)


def of_experiment(folder: Path, name: str, versions: str | None) -> list[str]:
    """Log-MSE of every method on training, validation, IID (where there is one) and test set, in the experiment's
    convention; intervals where the run has them."""
    metric = _log_mse(_config(folder), name)
    table = _table(folder / "tables" / f"{name}.csv")
    if versions is not None:
        table = table.set_index("method", drop=False).loc[versions.split(",")]
    sets = [s for s in ("train", "validation", "iid", "test") if f"{s}/{metric}/mean" in table]
    rows = []
    for _, line in table.iterrows():
        rows.append([line["label"], *(_cell(line, one_set, metric).text() for one_set in sets)])
    titles = {"iid": "IID test", "test": "test (OOD)"}
    titles |= _config(folder)["experiments"][name]["evaluation"].get("set_titles", {})
    return grid(["method", *(titles.get(s, s) for s in sets)], rows, 1)


def beside_paper(folder: Path, name: str, versions: str) -> list[str]:
    """Log-MSE of some versions on the experiment's test sets, each beside the paper's; which of them fit windows."""
    from expertaug.models.estimators import estimator  # loads torch, which other tables do not need

    config = _config(folder)
    metric = _log_mse(config, name)
    ours = _table(folder / "tables" / f"{name}.csv").set_index("method")
    paper = _table(folder / "tables" / f"{name}_published.csv").query("table == 'synth_log_mse'")
    paper = paper.set_index(["label", "set"])
    rows = []
    for version in versions.split(","):
        line = ours.loc[version]
        kind = estimator(config["methods"][base(version)]["kind"])
        row = [line["label"], "yes" if kind.fits_windows or Version.parse(version).is_refined else ""]
        for one_set in ("iid", "test"):
            row.append(_cell(line, one_set, metric).text())
            theirs = paper.loc[(line["label"], one_set)] if (line["label"], one_set) in paper.index else None
            shown = "" if theirs is None else f"{theirs['published_mean']:.1f} ± {theirs['published_std']:.1f}"
            row.append(shown.replace("-", "−"))
        rows.append(row)
    return grid(["method", "fits each window", "IID test", "paper", "shifted test", "paper"], rows, 2)


def of_seeds(folder: Path, name: str, versions: str, one_set: str) -> list[str]:
    """A column for each seed; the worst of a version is bold."""
    metric = _log_mse(_config(folder), name)
    long = read_csv(folder / "tables" / f"{name}_long.csv", TabledMean, "publish the run anew")
    found = {mean.method: mean for mean in long if (mean.set, mean.metric) == (one_set, metric)}
    rows = []
    for version in versions.split(","):
        each = found[version].values or sys.exit(f"{folder}: no values of seeds; publish the run anew")
        texts = [f"{value:.2f}".replace("-", "−") for value in each]
        worst = each.index(max(each))
        rows.append([found[version].label, *(f"**{t}**" if k == worst else t for k, t in enumerate(texts))])
    return grid(["method, seed", *map(str, found[versions.split(",")[0]].seeds)], rows, 1)


def of_curves(folder: Path, name: str, along: str, one_set: str) -> list[str]:
    """A row for each version, a column for each point."""
    metric = metric_of(_log_mse(_config(folder), name))
    points = read_csv(folder / "tables" / f"{name}_data_curves.csv", Point, "publish the run anew")
    points = [one for one in points if (one.along, one.set, one.metric) == (along, one_set, metric.name)]
    rows = [
        [label, *(Cell(metric, one.mean, math.nan, one.n, one.of, one.low, one.high).text() for one in part)]
        for label, part in group_by(points, lambda one: one.label).items()
    ]
    return grid([AXES[along], *(plain(value) for value in dict.fromkeys(one.value for one in points))], rows, 1)


@cache
def _table(path: Path) -> pd.DataFrame:
    return pd.read_csv(path)


@cache
def _config(folder: Path) -> dict[str, Any]:
    """The configuration of a published run."""
    text = (folder / "config.yaml").read_text(encoding="utf-8")
    return yaml.load(text, getattr(yaml, "CSafeLoader", yaml.SafeLoader))


def _log_mse(config: Mapping, name: str) -> str:
    """The log-MSE in an experiment's convention."""
    return f"log_mse_{config['experiments'][name]['evaluation'].get('convention', 'sum')}"


def _cell(line: pd.Series, one_set: str, metric: str, gain: bool = False) -> Cell:
    """A cell of an experiment's table, or the gain of a version over its control."""
    keys = {key: f"gain_{key}" if key != "mean" else "gain" for key in ("mean", "low", "high")} if gain else {}
    row = {key: line.get(f"{one_set}/{metric}/{keys.get(key, key)}", math.nan) for key in CELL}
    if math.isnan(row["mean"]):
        sys.exit(f"{line['label']}: no {'gain of ' if gain else ''}{metric} on the set {one_set!r}")
    counts = {"n": 0 if math.isnan(row["n"]) else int(row["n"]), "of": len(str(line["seeds"]).split())}
    return Cell(metric_of(metric), **row | counts)


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

    def beside(match: re.Match) -> str:
        folder = options.root / "results" / "published" / match[2]
        return match[1] + "\n".join(beside_paper(folder, match[3], match[4])) + "\n"

    def seeds(match: re.Match) -> str:
        folder = options.root / "results" / "published" / match[2]
        return match[1] + "\n".join(of_seeds(folder, match[3], match[4], match[5])) + "\n"

    def curves(match: re.Match) -> str:
        folder = options.root / "results" / "published" / match[2]
        return match[1] + "\n".join(of_curves(folder, match[3], match[4], match[5])) + "\n"

    def value(match: re.Match) -> str:
        table = _table(options.root / "results" / "published" / match[2] / "tables" / f"{match[3]}.csv")
        line = table.set_index("method").loc[match[4]]
        return match[1] + _cell(line, match[5], match[6], bool(match[7])).text() + match[8]

    def count(match: re.Match) -> str:
        cells = _table(options.root / "results" / "published" / match[2] / "tables" / "published.csv")
        cells = cells[cells["n"] > 0]
        chosen = cells["at_or_below"] if match[3] == "at_or_below" else cells["verdict"] == match[3]
        return f"{match[1]}{int(chosen.astype(bool).sum())} of {len(cells)}{match[4]}"

    def alarm(match: re.Match) -> str:
        table = _table(options.root / "results" / "published" / match[2] / "tables" / f"{match[3]}_alarm.csv")
        row = (table["method"] == match[4]) & (table["score"] == match[5]) & (table["set"] == "test")
        return f"{match[1]}{table.loc[row, 'auroc'].mean():.3f}{match[6]}"

    stale = 0
    for page in (options.root / "README.md", *sorted((options.root / "docs").glob("*.md"))):
        text = page.read_text(encoding="utf-8")
        new = VALUE.sub(value, BESIDE.sub(beside, MARK.sub(filled, text)))
        new = CURVES.sub(curves, new)
        new = SEEDS.sub(seeds, ALARM.sub(alarm, COUNT.sub(count, new)))
        if new == text:
            continue
        stale = 1
        if not options.check:
            write_text(page, new)
    return stale if options.check else 0


if __name__ == "__main__":
    sys.exit(main())

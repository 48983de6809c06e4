"""Tables of the page, made of the tidy CSV files of a run: nothing is read from what was printed."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from expertaug.errors import InputError
from expertaug.evaluation.formats import DASH, KNOWN_FORM, cell_text
from expertaug.evaluation.gains import FROM_BASE, OVER_CONTROL
from expertaug.evaluation.metrics import COST, DIVERGED, metric_of
from expertaug.evaluation.report.cells import Table, plain, spans
from expertaug.evaluation.summary import last_columns, order_sets, set_title, tabled_metrics
from expertaug.versions import SHOWN_SETS

SUMMARY = ("metric", "mean", "std", "n", "of")  # columns of a file of means over seeds
STAR = "*"  # told apart from 0
KINDS = {"gain": OVER_CONTROL, "difference": FROM_BASE}  # columns of a long table: what they are
RECORDING = {
    "recording": "recording",
    "duration_s": "duration [s]",
    "tracked_share": "tracked [%]",
    "usable_share": "usable [%]",
    "arm1_px": "arm 1 [px]",
    "arm2_px": "arm 2 [px]",
    "noise1_deg": "noise 1 [°]",
    "noise2_deg": "noise 2 [°]",
    "rate_hz": "rate [Hz]",
    "implied_rate_hz": "implied rate [Hz]",
    "refused": "left out",
}
# Columns that say nothing beside the others, or that a label says better.
UNSAID = ("experiment", "system", "preset", "method")


def read(path: Path) -> pd.DataFrame:
    """A CSV file of the run.

    Raises:
        InputError: it is missing or broken.
    """
    try:
        return pd.read_csv(path, dtype={"seeds": str, "refused": str})
    except FileNotFoundError as error:
        raise InputError(path, "no such file", "run the workflow to its end first") from error
    except (OSError, ValueError) as error:
        raise InputError(path, f"is no table ({error})", "make it again: delete it and run the workflow") from error


def read_long(path: Path) -> pd.DataFrame:
    """The long table of an experiment (:mod:`expertaug.evaluation.tables`).

    Raises:
        InputError: it is missing or broken.
    """
    table = read(path)
    if missing := [name for name in (*SUMMARY, "label", "set", "seeds", "low", "high") if name not in table]:
        raise InputError(path, f"no column {missing[0]!r}", "make it again: delete it and run the workflow")
    return table


def main(long: pd.DataFrame, settings: Mapping) -> Table:
    """An experiment's methods by sets and metrics, those that know the form of F_a in a part of their own.

    Arguments:
        long: see :func:`read_long`.
        settings: of :func:`expertaug.evaluation.tables.tabulate`.
    """
    shown = long[long["set"].isin(SHOWN_SETS)]
    metrics = tabled_metrics(shown, settings.get("convention", "sum"))
    told = shown[(shown["metric"] != DIVERGED.name) | (shown.groupby(["set", "metric"])["mean"].transform("max") > 0)]
    known = set(zip(told["set"], told["metric"], strict=True))
    columns = [(name, one) for name in order_sets(shown["set"]) for one in metrics if (name, one) in known]
    columns += last_columns(shown)
    values = by_cell(shown)
    competing, others = [], []
    for (method, label), rows in shown.groupby(["method", "label"], sort=False):
        cells = [cell_text(values.get((label, *column)), column[1]) for column in columns]
        row = [label, str(len(rows["seeds"].iloc[0].split())), *cells]
        (others if method in settings.get("known_form", ()) else competing).append(row)
    parts = [("", competing), *([(KNOWN_FORM.rstrip(":"), others)] if others else [])]
    head = ["method", "seeds", *(metric_of(metric).heading() for _, metric in columns)]
    over = [("", 1), *spans(set_title(name, settings) for name, _ in columns)]
    return Table(head, parts, 1, over)


def gains(long: pd.DataFrame, settings: Mapping) -> Table | None:
    """What augmented versions gain over their controls, and their difference from the base model."""
    if not {"gain", "difference"} & set(long):
        return None
    shown = long[long["set"].isin(SHOWN_SETS)]
    metrics = [name for name in tabled_metrics(shown, settings.get("convention", "sum")) if name != DIVERGED.name]
    rows, cells = [], by_cell(shown)
    columns = [
        (name, metric)
        for name in order_sets(shown["set"])
        for metric in metrics
        if any(gain(cells.get((label, name, metric)), key) for label in set(shown["label"]) for key in KINDS)
    ]
    for label in dict.fromkeys(shown["label"]):
        for key, said in KINDS.items():
            found = [gain(cells.get((label, *column)), key) for column in columns]
            if any(found):
                rows.append([label, said, *(text or DASH for text in found)])
    head = ["method", "", *(metric_of(metric).heading() for _, metric in columns)]
    over = spans(set_title(name, settings) for name, _ in columns)
    return Table(head, [("", rows)], 2, over) if rows else None


def gain(cell: Mapping | None, key: str = "gain") -> str:
    """A difference with its interval, a star behind one that is told apart from 0; empty where there is none."""
    if cell is None or key not in cell or pd.isna(cell[key]):
        return ""
    ends = {"mean": cell[key], "low": cell[f"{key}_low"], "high": cell[f"{key}_high"]}
    text = cell_text({**ends, "std": float("nan"), "n": 1, "of": 1}, cell["metric"])
    return text.replace(" [", f"{STAR} [") if ends["low"] > 0 or ends["high"] < 0 else text


def further(long: pd.DataFrame, settings: Mapping) -> Table:
    """All other metrics, a row for each and each method, a column for each set that is shown."""
    shown = long[long["set"].isin(SHOWN_SETS)]
    first = tabled_metrics(shown, settings.get("convention", "sum"))
    return by_metric(shown[~shown["metric"].isin([*first, COST.name])], settings)


def by_metric(summary: pd.DataFrame, settings: Mapping) -> Table:
    """A row for each metric and label, a column for each set."""
    sets, values, rows = order_sets(summary["set"]), by_cell(summary), []
    for metric in dict.fromkeys(summary["metric"]):
        for label in dict.fromkeys(summary.loc[summary["metric"] == metric, "label"]):
            cells = [cell_text(values.get((label, name, metric)), metric) for name in sets]
            title = metric_of(metric).heading() + (f" ({metric})" if metric_of(metric).is_log else "")
            rows.append([title, label, *cells])
    return Table(["metric", "method", *(set_title(name, settings) for name in sets)], [("", rows)], 2)


def by_label(summary: pd.DataFrame, settings: Mapping) -> Table:
    """A study's means: a row for each metric, set and what else its file tells apart, a column for each label."""
    shown = summary[summary["metric"].isin(tabled_metrics(summary, settings.get("convention", "sum")))]
    keys = ["metric", "set", *(c for c in shown if c not in (*SUMMARY, *UNSAID, "label", "set"))]
    names, rows = list(dict.fromkeys(shown["label"])), []
    for key, part in shown.groupby(keys, sort=False):
        values = {row["label"]: row for _, row in part.iterrows()}
        first = [metric_of(str(key[0])).heading(), set_title(str(key[1]), settings), *map(plain, key[2:])]
        rows.append([*first, *(cell_text(values.get(name), str(key[0])) for name in names)])
    return Table([*(key.replace("_", " ") for key in keys), *names], [("", rows)], len(keys))


def of_file(path: Path, settings: Mapping) -> Table:
    """The table of any CSV file of the run: means over seeds as such, others row by row, averaged over seeds.

    Raises:
        InputError: the file is missing or broken.
    """
    table = read(path)
    if set(SUMMARY) <= set(table) and "label" in table:
        return by_label(table, settings)
    kept = table.drop(columns=[c for c in UNSAID if c in table and "label" in table])
    kept = kept.dropna(axis="columns", how="all")
    if "seed" in kept:
        kept = _over_seeds(kept)
    if "set" in kept:
        kept["set"] = [set_title(str(name), settings) for name in kept["set"]]
    texts = [name for name in kept if not pd.api.types.is_numeric_dtype(kept[name])]
    columns = [*texts, *(name for name in kept if name not in texts)] if "label" in texts else list(kept)
    names = len(texts) if "label" in texts else 1
    head = [name.replace("label", "method").replace("_", " ") for name in columns]
    rows = [[plain(value) for value in row] for row in kept[columns].itertuples(index=False)]
    return Table(head, [("", rows)], names)


def published(path: Path, titles: Mapping[str, str]) -> Table:
    """This run's numbers beside the paper's (:mod:`expertaug.evaluation.published`), of the methods that were run.

    Arguments:
        titles: of the experiments.

    Raises:
        InputError: the file is missing or broken.
    """
    table, parts = read(path), []
    for (experiment, metric), part in table[table["of"] > 0].groupby(["experiment", "metric"], sort=False):
        digits = int((part["published_mean"] % 1 != 0).any())  # as printed in the paper's table of this metric
        rows = [
            [
                row["label"],
                set_title(row["set"], {}),
                f"{row['published_mean']:.{digits}f} ± {row['published_std']:.{digits}f}".replace("-", "−"),
                cell_text(row, metric),
                str(row["of"]),
                f"{row['p']:.3f}",
                row["verdict"],
            ]
            for _, row in part.iterrows()
        ]
        parts.append((f"{titles.get(experiment, experiment)}: {metric_of(metric).heading()}", rows))
    return Table(["method", "set", "published", "ours", "seeds", "p", "verdict"], parts, 2)


def recordings(path: Path) -> Table:
    """What was measured in each recording, a few columns of many.

    Raises:
        InputError: the file is missing or broken.
    """
    table = read(path)
    table = table.assign(**{name: 100 * table[name] for name in ("tracked_share", "usable_share") if name in table})
    shown = [name for name in RECORDING if name in table]
    rows = [[plain(value) for value in row] for row in table[shown].itertuples(index=False)]
    return Table([RECORDING[name] for name in shown], [("", rows)])


def by_cell(summary: pd.DataFrame) -> dict[tuple[str, str, str], pd.Series]:
    """Rows of a summary by label, set and metric."""
    return {(row["label"], row["set"], row["metric"]): row for _, row in summary.iterrows()}


def _over_seeds(table: pd.DataFrame) -> pd.DataFrame:
    """Means over seeds of the rows that differ in nothing else that is no number."""
    keys = [name for name in table if not pd.api.types.is_numeric_dtype(table[name])]
    means = table.drop(columns="seed").groupby(keys, sort=False, dropna=False).mean(numeric_only=True)
    return means.reset_index()[[name for name in table if name != "seed"]]

"""The stage tabulate: the tables of an experiment's metrics, and what augmented versions gain over their controls; the
report makes the same tables of what this stage wrote."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd

from expertaug.errors import InputError
from expertaug.evaluation.forecasts import Forecasts, read_forecasts
from expertaug.evaluation.intervals import LEVEL, Interval, interval
from expertaug.evaluation.metrics import COST, DIVERGED, RELATIVE_ERROR, Shown, metric_of
from expertaug.evaluation.samples import Samples
from expertaug.evaluation.settings import TabulateJob
from expertaug.evaluation.summary import (
    any_of,
    last_columns,
    order_sets,
    read_metrics,
    shown_metrics,
    summarise,
    tabled_metrics,
)
from expertaug.evaluation.table import DASH, Cell, Row, Study, Table, spans
from expertaug.versions import CONTROL, SHOWN_SETS, Version, ordered

Column = tuple[str, str]  # set and metric
Place = tuple[str, str, str]  # row, set and metric
KNOWN_FORM = "F_a of known form, which does not compete"  # a title over rows
BEST = "Bold: the best of each column, and those that are not told apart from it."
# Only the first is a gain of augmentation: an augmented version was also trained for longer than its base.
OVER_CONTROL, FROM_BASE = "gain over control", "difference from base"
KINDS = (OVER_CONTROL, FROM_BASE)
NAMES = {OVER_CONTROL: "gain", FROM_BASE: "difference"}  # of columns
ENDS = {"": "mean", "_low": "low", "_high": "high", "_p": "p"}  # of their names: what of an interval they hold
COLUMNS = [f"{name}{end}" for name in NAMES.values() for end in ENDS]
GAINS = (
    "Gain over control: how much lower the error is than that of the control, the same base model trained on for the "
    "same steps on the real data alone. Difference from base: how much lower it is than that of the base model, which "
    "had fewer steps: no gain of augmentation. Positive is better. Means over pairs of the same seed and the same "
    "samples with their 95 % intervals; bold: told apart from 0."
)


def tabulate(
    metrics: Sequence[Path],
    outputs: Sequence[Path],
    job: TabulateJob | None = None,
    forecasts: Sequence[Path] = (),
) -> None:
    """Write tables of means over seeds with their intervals; rows are methods, columns set × metric.  A second table
    has what augmented versions gain over their controls.

    Arguments:
        metrics: metrics.csv of every method and group of seeds, of one experiment or of several (one table each).
        outputs: any of ``….csv`` (wide), ``…_long.csv``, ``….md`` and ``….tex`` (booktabs).  CSV files hold all metrics
            in full precision, the long one of all sets; LaTeX the log-MSE, the parameters' error and the share of
            runaways where there are any, Markdown these and the others in a table of its own, of the shown sets.
        forecasts: forecasts.npz of the same runs: errors of every sample, from which the intervals come (without them
            standard deviations over seeds are printed), and the parameters' units.

    Raises:
        InputError: a file is broken, there are none of these metrics, or an output's suffix is unknown.
    """
    job, loaded = job or TabulateJob(labels=[]), read_forecasts(forecasts)
    units, samples = _units(loaded), Samples(loaded)
    long = _prepare(read_metrics(metrics), job, samples)
    if not shown_metrics(long, job.convention):
        known = ", ".join(dict.fromkeys(long["metric"]))
        raise InputError("metrics", "neither log-MSE nor parameter error is in the files", f"they hold {known}")
    long = with_columns(long, gains(long, samples))
    main = long[long["set"].isin(SHOWN_SETS)]
    parts = [part for _, part in main.groupby("experiment", sort=False)]
    tables = [table for part in parts for table in _tables(part, job, samples, units)]
    Study(_wide(main), tables, long=long.drop(columns="row")).save(outputs)


def _tables(part: pd.DataFrame, job: TabulateJob, samples: Samples, units: Mapping[str, str]) -> list[Table]:
    """The log-MSE and the parameters' error, what augmentation gains, and the other metrics, of one experiment."""
    name, columns = str(part["experiment"].iloc[0]), columns_of(part, job)
    best = _best(part, columns, samples, (*job.floors, *job.known_form))
    label, caption = name.replace("_", "-"), f"{_caption(part, job, samples)} {BEST}"
    tables = [main_table(part, job, best, name, caption, label)]
    gained = gains_table(
        part, job, lambda row, kind: row[f"{NAMES[kind]}_p"] < 1 - LEVEL, True, f"{name}, gains", f"{label}-gains"
    )
    known = [m.name for m in map(metric_of, dict.fromkeys(part["metric"])) if m.shown in (Shown.WHERE_ANY, Shown.LAST)]
    more = further_table(part, job, (*tabled_metrics(part, job.convention), *known), units)
    return [*tables, *([gained] if gained else []), *([more] if more.size else [])]


def main_table(
    part: pd.DataFrame,
    job: TabulateJob,
    best: Collection[Place] = (),
    title: str = "",
    caption: str = "",
    label: str = "",
) -> Table:
    """An experiment's methods by sets and metrics, those that know the form of F_a in a part of their own.

    Arguments:
        part: rows of the long table, of the sets that are shown.
        best: places of cells that are marked.
    """
    columns, values = columns_of(part, job), by_place(part)
    competing: list[Row] = []
    others: list[Row] = []
    for (row, method), rows in part.groupby([_row_of(part), "method"], sort=False):
        cells = [_cell(values, (str(row), *column), (str(row), *column) in best) for column in columns]
        count = str(len(str(rows["seeds"].iloc[0]).split()))
        (others if method in job.known_form else competing).append([rows["label"].iloc[0], count, *cells])
    parts = [("", competing), *([(KNOWN_FORM, others)] if others else [])]
    head = ["method", "seeds", *(metric_of(metric).heading() for _, metric in columns)]
    over = [("", 1), *spans(job.of_set(name) for name, _ in columns)]
    return Table(head, parts, 1, over, title, caption, label)


def columns_of(part: pd.DataFrame, job: TabulateJob) -> list[Column]:
    """The columns (set, metric) of the first table that hold a value, set by set; shares of diverged forecasts where
    there are any, and last what an estimate costs."""
    told = part[(part["metric"] != DIVERGED.name) | part["set"].map(lambda s: any_of(DIVERGED, part[part["set"] == s]))]
    known = set(zip(told["set"], told["metric"], strict=True))
    metrics = tabled_metrics(part, job.convention)
    columns = [(name, metric) for name in order_sets(part["set"]) for metric in metrics if (name, metric) in known]
    return [*columns, *last_columns(part)]


def gains_table(
    part: pd.DataFrame,
    job: TabulateJob,
    told_apart: Callable[[pd.Series, str], bool],
    all_kinds: bool,
    label_title: str = "",
    label: str = "",
) -> Table | None:
    """What augmented versions gain over their controls, and their difference from the base model; None where there is
    neither.

    Arguments:
        told_apart: row of the long table and kind → whether the difference is one from 0.
        all_kinds: whether versions with one of the two have a row for the other too.
    """
    values = by_place(part)

    def cell(place: Place, kind: str) -> Cell | None:
        row = values.get(place)
        return None if row is None else gain_cell(row, kind, told_apart(row, kind) if NAMES[kind] in row else False)

    if not {*NAMES.values()} & set(part):
        return None
    rows_of = dict(zip(_row_of(part), part["label"], strict=True))
    columns = [c for c in columns_of(part, job) if any(cell((r, *c), kind) for r in rows_of for kind in KINDS)]
    gained = part.loc[part[[name for name in NAMES.values() if name in part]].notna().any(axis=1)]
    compared, rows = set(_row_of(gained)), []
    for row, label_of_row in rows_of.items():
        for kind in KINDS:
            cells = [cell((row, *column), kind) for column in columns]
            if (all_kinds and row in compared) or any(cells):
                rows.append([label_of_row, kind, *(DASH if one is None else one for one in cells)])
    head = ["method", "", *(metric_of(metric).heading() for _, metric in columns)]
    over = spans(job.of_set(name) for name, _ in columns)
    return Table(head, [("", rows)], 2, over, "", GAINS, label, label_title) if rows else None


def gain_cell(row: pd.Series | Mapping, kind: str, marked: bool) -> Cell | None:
    """A difference of a row of the long table with its interval; None where there is none."""
    name = NAMES[kind]
    if name not in row or pd.isna(row[name]):
        return None
    ends = {"mean": float(row[name]), "low": float(row[f"{name}_low"]), "high": float(row[f"{name}_high"])}
    return Cell(metric_of(row["metric"]), **ends, n=1, of=1, marked=marked)


def further_table(
    part: pd.DataFrame, job: TabulateJob, left_out: Collection[str], units: Mapping[str, str] | None = None
) -> Table:
    """All other metrics, a row for each and each method, a column for each set."""
    sets, values, rows = order_sets(part["set"]), by_place(part), []
    labels = dict(zip(_row_of(part), part["label"], strict=True))
    for metric in map(metric_of, dict.fromkeys(part["metric"])):
        title = metric.heading(units) + (f" ({metric.name})" if metric.is_log else "")
        for row, label in labels.items() if metric.name not in left_out else ():
            places = [(row, name, metric.name) for name in sets]
            if any(place in values for place in places):
                rows.append([title, label, *(_cell(values, place) for place in places)])
    head = ["metric", "method", *(job.of_set(name) for name in sets)]
    return Table(head, [("", rows)], 2, caption="Further metrics:")


def by_place(part: pd.DataFrame) -> dict[Place, pd.Series]:
    """Rows of the long table by row (method and preset), set and metric."""
    keys = zip(_row_of(part), part["set"], part["metric"], strict=True)
    return dict(zip(keys, (row for _, row in part.iterrows()), strict=True))


def _row_of(part: pd.DataFrame) -> pd.Series:
    return (part["method"] + " " + part["preset"]).rename("row")


def _cell(values: Mapping[Place, pd.Series], place: Place, marked: bool = False) -> Cell:
    return Cell.of_row(metric_of(place[2]), values.get(place), marked)


def _caption(part: pd.DataFrame, job: TabulateJob, samples: Samples) -> str:
    """What every table says of itself: preset, seeds, spread, convention, units."""
    parts = [f"Preset: {', '.join(dict.fromkeys(part['preset']))}.", _spread(part, samples)]
    chosen = tabled_metrics(part, job.convention)
    if metric_of(chosen[0]).is_log:
        times = "the forecast window (t1, t2]" if job.from_s is None else f"times from {job.from_s} s on"
        times = times if "from_s" in job.model_fields_set else "the evaluated times"
        parts.append(
            f"log-MSE (no unit): natural logarithm of the mean, over samples and {times}, of the squared error"
            f" {job.convention_text} (convention: {job.convention})."
        )
    if RELATIVE_ERROR.name in chosen:
        parts.append("Error: mean of |estimate − truth| / |truth| of the expert parameters, in %.")
        if (part["of"] == 0).any():
            parts.append(f"{DASH} there: nobody knows the truth.")
    if (part["n"] < part["of"]).any():
        parts.append("(a/b): only a of b seeds have a finite value, and only those are averaged.")
    if any_of(DIVERGED, part):
        parts.append(DIVERGED.note)
    if (part["metric"] == COST.name).any():
        parts.append(COST.note)
    return " ".join(parts)


def _spread(part: pd.DataFrame, samples: Samples) -> str:
    """What stands beside a mean."""
    sizes = sorted({len(seeds.split()) for seeds in part["seeds"]})
    counted = "1 seed" if sizes == [1] else f"{' or '.join(map(str, sizes))} seeds"
    deviation = f"standard deviation (n − 1) over {counted} per method; {DASH}: no value, or none of one seed."
    if not part["low"].notna().any():
        return f"Mean ± {deviation}"
    resampled = "whole recordings" if samples.by_recording(part["experiment"].iloc[0]) else "samples"
    both = f"{resampled} alone" if sizes == [1] else f"seeds and {resampled} both"
    ends = f"Mean and the ends of its 95 % interval, for which {both} are resampled."
    return f"{ends} Where samples' errors are not kept, mean ± {deviation}"


def _best(part: pd.DataFrame, columns: Sequence[Column], samples: Samples, apart: Sequence[str]) -> set[Place]:
    """Of every column of errors with something to compare: the method with the best mean over all of its seeds, and
    those that a test on pairs of the same seed and samples does not tell apart from it."""
    found: set[Place] = set()
    for name, metric in columns:
        # The equation that made the data is a floor, no competitor; a method that is told its form is none either.
        column = part[
            ~part["method"].isin(apart)
            & (part["set"] == name)
            & (part["metric"] == metric)
            & (part["n"] == part["of"])
            & (part["of"] > 0)
        ]
        better = metric_of(metric).better
        if len(column) < 2 or better is None:
            continue
        best = column.loc[column["mean"].idxmin() if better == "lower" else column["mean"].idxmax()]
        found.add((best["row"], name, metric))
        for _, other in column.iterrows():
            keys = [(row["experiment"], row["preset"], row["method"]) for row in (best, other)]
            difference = samples.difference(*keys, name, metric)
            if difference is not None and difference.p >= 1 - LEVEL:
                found.add((other["row"], name, metric))
    return found


def references(version: str, known: Iterable[str]) -> dict[str, str]:
    """The versions with which an augmented one is compared, of those that were run, by :data:`KINDS`."""
    augmented, names = Version.parse(version), set(known)
    base = replace(augmented, step="", prior=None)
    wanted = {OVER_CONTROL: str(replace(base, step=CONTROL)), FROM_BASE: str(base)}
    return {kind: name for kind, name in wanted.items() if name in names}


def gains(long: pd.DataFrame, samples: Samples) -> dict[tuple[str, str, str, str], Interval]:
    """Differences of one experiment by row (method and preset), kind, set and metric; positive is better.

    Arguments:
        long: rows of a table (:func:`tabulate`) with columns experiment, preset, method, row, set and
            metric.
    """
    found = {}
    for (experiment, preset), part in long.groupby(["experiment", "preset"], sort=False):
        methods = list(dict.fromkeys(part["method"]))
        compared = {method: references(method, methods) for method in methods if Version.parse(method).is_augmented}
        for one in part[part["method"].isin(list(compared))].itertuples():
            for kind, reference in compared[one.method].items():
                keys = (experiment, preset, one.method), (experiment, preset, reference)
                interval = samples.difference(*keys, one.set, one.metric)
                if interval is not None:
                    found[one.row, kind, one.set, one.metric] = interval
    return found


def with_columns(long: pd.DataFrame, found: Mapping[tuple[str, str, str, str], Interval]) -> pd.DataFrame:
    """The rows with columns gain, gain_low, gain_high, gain_p and difference, difference_low, … where there are any."""
    keys = list(zip(long["row"], long["set"], long["metric"], strict=True))
    columns = {}
    for kind, name in NAMES.items():
        cells = [found.get((row, kind, *cell)) for row, *cell in keys]
        if any(cells):
            for end, key in ENDS.items():
                columns[f"{name}{end}"] = [float("nan") if cell is None else getattr(cell, key) for cell in cells]
    return long.assign(**columns)


def _units(forecasts: Sequence[Forecasts]) -> dict[str, str]:
    """Unit of each parameter by name."""
    return {
        name: unit for one in forecasts for name, unit in zip(one.parameter_names, one.parameter_units, strict=True)
    }


def _prepare(table: pd.DataFrame, job: TabulateJob, samples: Samples) -> pd.DataFrame:
    """The summary, sorted as printed, with seeds, ends of intervals, and a ``row`` for each method and preset; where
    one experiment has several presets, labels name theirs."""
    for _, group in table.groupby("experiment"):
        if group["preset"].nunique() > 1:
            table.loc[group.index, "label"] = group["label"] + " (" + group["preset"] + ")"
    keys = ["experiment", "preset", "method"]
    seeds = table.groupby(keys, sort=False)["seed"].agg(lambda s: sorted(set(s)))
    long = summarise(table)
    long["seeds"] = [" ".join(map(str, seeds[tuple(key)])) for key in long[keys].values]
    long["low"], long["high"] = zip(*(_ends(row, samples) for row in long.itertuples()), strict=True)
    long = _with_unknown_errors(long, samples)
    long["row"] = long["method"] + " " + long["preset"]
    methods, presets = ordered(long["method"], job.label_of), list(dict.fromkeys(long["preset"]))
    ranks = {
        "row": [f"{method} {preset}" for method in methods for preset in presets],
        "set": order_sets(long["set"]),
        "metric": list(dict.fromkeys(long["metric"])),
        "experiment": list(dict.fromkeys(long["experiment"])),
    }
    places = {key: {value: i for i, value in enumerate(values)} for key, values in ranks.items()}
    return long.sort_values(
        ["experiment", "row", "set", "metric"], key=lambda c: c.map(places[c.name]), ignore_index=True
    )


def _with_unknown_errors(long: pd.DataFrame, samples: Samples) -> pd.DataFrame:
    """The summary with a row of no seeds, printed as –, for each error of parameters that nobody can know."""
    keys = ["experiment", "preset", "method", "set"]
    each = long.drop_duplicates(keys)
    unknown = [
        samples.estimates_unknown((row.experiment, row.preset, row.method), row.set) for row in each.itertuples()
    ]
    told = long.loc[long["metric"] == RELATIVE_ERROR.name, keys].apply(tuple, axis=1)
    rows = each[unknown]
    rows = rows[~rows[keys].apply(tuple, axis=1).isin(set(told))]
    nothing = {"metric": RELATIVE_ERROR.name, "n": 0, "of": 0} | dict.fromkeys(("mean", "std", "low", "high"), math.nan)
    return pd.concat([long, rows.assign(**nothing)], ignore_index=True) if len(rows) else long


def _ends(row: Any, samples: Samples) -> tuple[float, float]:
    """Ends of the interval round a mean; NaN where no samples are kept."""
    found = samples.resampled((row.experiment, row.preset, row.method), row.set, row.metric)
    if found is None:
        return math.nan, math.nan
    not_negative = metric_of(row.metric).not_negative
    one = interval(found, not_negative)
    if not_negative:
        return one.low, one.high
    shift = row.mean - one.mean  # of a convention from the other
    return one.low + shift, one.high + shift


def _wide(long: pd.DataFrame) -> pd.DataFrame:
    """One row per method; columns <set>/<metric>/mean, /std, /n, /low, /high and those of gains."""
    rows = []
    values = ["mean", "std", "n", "low", "high", *(c for c in long if c in COLUMNS)]
    for _, part in long.groupby(["experiment", "row"], sort=False):
        row = {key: part.iloc[0][key] for key in ("experiment", "preset", "method", "label", "seeds")}
        for cell in part.itertuples():
            row |= {f"{cell.set}/{cell.metric}/{name}": getattr(cell, name) for name in values}
        rows.append(row)
    table = pd.DataFrame(rows)
    counts = [name for name in table if name.endswith("/n")]
    return table.astype(dict.fromkeys(counts, "Int64"))

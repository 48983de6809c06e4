"""The stage tabulate: one table of metrics per experiment, as CSV, Markdown and LaTeX."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from expertaug.errors import InputError
from expertaug.evaluation import gains
from expertaug.evaluation.forecast_file import Forecasts
from expertaug.evaluation.formats import write_tables
from expertaug.evaluation.intervals import interval
from expertaug.evaluation.metrics import RELATIVE_ERROR
from expertaug.evaluation.printed import Printed
from expertaug.evaluation.samples import Samples
from expertaug.evaluation.summary import order_sets, read_metrics, shown_metrics, summarise
from expertaug.versions import SHOWN_SETS, ordered


def tabulate(
    metrics: Sequence[Path],
    outputs: Sequence[Path],
    settings: Mapping | None = None,
    forecasts: Sequence[Path] = (),
) -> None:
    """Write tables of means over seeds with their intervals; rows are methods, columns set × metric.  A second table
    has what augmented versions gain over their controls (:mod:`expertaug.evaluation.gains`).

    Arguments:
        metrics: metrics.csv of every method and group of seeds, of one experiment or of several (one table each).
        outputs: any of ``….csv`` (wide), ``…_long.csv``, ``….md`` and ``….tex`` (booktabs).  CSV files hold all metrics
            in full precision, the long one of all sets; LaTeX the log-MSE, the parameters' error and the share of
            runaways where there are any, Markdown these and the others in a table of its own, of the shown sets.
        settings: all optional: ``convention`` ("sum" or "dim": of the log-MSE), ``labels`` (pairs of a method and its
            label: the order of the methods), ``set_titles`` (how sets are printed), ``from_s`` (as in evaluation: the
            log-MSE sees times from there on; null = the forecast window).
        forecasts: forecasts.npz of the same runs: errors of every sample, from which the intervals come (without them
            standard deviations over seeds are printed), and the parameters' units.

    Raises:
        InputError: a file is broken, there are none of these metrics, or an output's suffix is unknown.
    """
    settings = dict(settings or {})
    settings["units"], samples = _units(forecasts), Samples(forecasts)
    long = _prepare(read_metrics(metrics), settings, samples)
    if not shown_metrics(long, settings.get("convention", "sum")):
        known = ", ".join(dict.fromkeys(long["metric"]))
        raise InputError("metrics", "neither log-MSE nor parameter error is in the files", f"they hold {known}")
    gained = gains.gains(long, samples)
    long = gains.with_columns(long, gained)
    main = long[long["set"].isin(SHOWN_SETS)]
    tables = [Printed.of(part, settings, samples, gained) for _, part in main.groupby("experiment", sort=False)]

    def csv(output: Path) -> str:
        table = long if output.stem.endswith("_long") else _wide(main)
        return table.drop(columns="row", errors="ignore").to_csv(index=False)

    texts = {
        ".csv": csv,
        ".md": lambda _: "\n".join(table.markdown() for table in tables),
        ".tex": lambda _: "\n".join(table.latex() for table in tables),
    }
    write_tables(outputs, texts)


def _units(forecasts: Sequence[Path]) -> dict[str, str]:
    """Unit of each parameter by name."""
    files = [Forecasts.load(path) for path in forecasts]
    return {name: unit for file in files for name, unit in zip(file.parameter_names, file.parameter_units, strict=True)}


def _prepare(table: pd.DataFrame, settings: Mapping, samples: Samples) -> pd.DataFrame:
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
    methods, presets = ordered(long["method"], dict(settings.get("labels", ()))), list(dict.fromkeys(long["preset"]))
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
    one = interval(found)
    shift = row.mean - one.mean  # of a convention from the other
    return one.low + shift, one.high + shift


def _wide(long: pd.DataFrame) -> pd.DataFrame:
    """One row per method; columns <set>/<metric>/mean, /std, /n, /low, /high and those of gains."""
    rows = []
    values = ["mean", "std", "n", "low", "high", *(c for c in long if c in gains.COLUMNS)]
    for _, part in long.groupby(["experiment", "row"], sort=False):
        row = {key: part.iloc[0][key] for key in ("experiment", "preset", "method", "label", "seeds")}
        for cell in part.itertuples():
            row |= {f"{cell.set}/{cell.metric}/{name}": getattr(cell, name) for name in values}
        rows.append(row)
    table = pd.DataFrame(rows)
    counts = [name for name in table if name.endswith("/n")]
    return table.astype(dict.fromkeys(counts, "Int64"))

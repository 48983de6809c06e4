"""The stage tabulate: one table of metrics per experiment, as CSV, Markdown and LaTeX."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd

from expertaug.errors import InputError
from expertaug.evaluation.forecast_file import Forecasts
from expertaug.evaluation.formats import DASH, RUNAWAYS_NOTE, cell_text, escape, grid, metric_title, tex, write_tables
from expertaug.evaluation.summary import (
    CONVENTIONS,
    RUNAWAYS,
    has_runaways,
    order_sets,
    read_metrics,
    set_title,
    shown_metrics,
    summarise,
    tabled_metrics,
)
from expertaug.labels import MAIN_SETS, ordered


def tabulate(
    metrics: Sequence[Path],
    outputs: Sequence[Path],
    settings: Mapping | None = None,
    forecasts: Sequence[Path] = (),
) -> None:
    """Write tables of mean ± standard deviation over seeds; rows are methods, columns set × metric.

    Arguments:
        metrics: metrics.csv of every method and group of seeds, of one experiment or of several (one table each).
        outputs: any of ``….csv`` (wide), ``…_long.csv``, ``….md`` and ``….tex`` (booktabs).  CSV files hold all metrics
            in full precision, the long one of all sets; LaTeX the log-MSE, the parameters' error and the share of
            runaways where there are any, Markdown these and the others in a second table, of the main sets.
        settings: all optional: ``convention`` ("sum" or "dim": of the log-MSE), ``labels`` (pairs of a method and its
            label: the order of the methods), ``set_titles`` (how sets are printed), ``from_s`` (as in evaluation: the
            log-MSE sees times from there on; null = the forecast window).
        forecasts: forecasts.npz of the same runs; the units of the parameters are taken from there.

    Raises:
        InputError: a metrics file is broken or has none of these metrics, or an output's suffix is unknown.
    """
    settings = dict(settings or {})
    settings["units"] = _units(forecasts)
    long = _prepare(read_metrics(metrics), settings)
    if not shown_metrics(long, settings.get("convention", "sum")):
        known = ", ".join(dict.fromkeys(long["metric"]))
        raise InputError("metrics", "neither log-MSE nor parameter error is in the files", f"they hold {known}")
    main = long[long["set"].isin(MAIN_SETS)]

    def csv(output: Path) -> str:
        table = long if output.stem.endswith("_long") else _wide(main)
        return table.drop(columns="row", errors="ignore").to_csv(index=False)

    texts = {
        ".csv": csv,
        ".md": lambda _: "\n".join(_markdown(part, settings) for part in _experiments(main)),
        ".tex": lambda _: "\n".join(_latex(part, settings) for part in _experiments(main)),
    }
    write_tables(outputs, texts)


def _units(forecasts: Sequence[Path]) -> dict[str, str]:
    """Unit of each parameter by name."""
    files = [Forecasts.load(path) for path in forecasts]
    return {name: unit for file in files for name, unit in zip(file.parameter_names, file.parameter_units, strict=True)}


def _prepare(table: pd.DataFrame, settings: Mapping) -> pd.DataFrame:
    """The summary, sorted as it is printed, with the seeds and a ``row`` for each method and preset; where one
    experiment has several presets, labels name theirs."""
    for _, group in table.groupby("experiment"):
        if group["preset"].nunique() > 1:
            table.loc[group.index, "label"] = group["label"] + " (" + group["preset"] + ")"
    keys = ["experiment", "preset", "method"]
    seeds = table.groupby(keys, sort=False)["seed"].agg(lambda s: sorted(set(s)))
    long = summarise(table)
    long["seeds"] = [" ".join(map(str, seeds[tuple(key)])) for key in long[keys].values]
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


def _experiments(long: pd.DataFrame) -> list[pd.DataFrame]:
    return [part for _, part in long.groupby("experiment", sort=False)]


def _wide(long: pd.DataFrame) -> pd.DataFrame:
    """One row per method; columns <set>/<metric>/mean, /std and /n."""
    rows = []
    for _, part in long.groupby(["experiment", "row"], sort=False):
        row = {key: part.iloc[0][key] for key in ("experiment", "preset", "method", "label", "seeds")}
        for cell in part.itertuples():
            name = f"{cell.set}/{cell.metric}"
            row |= {f"{name}/mean": cell.mean, f"{name}/std": cell.std, f"{name}/n": cell.n}
        rows.append(row)
    table = pd.DataFrame(rows)
    counts = [name for name in table if name.endswith("/n")]
    return table.astype(dict.fromkeys(counts, "Int64"))


def _cells(part: pd.DataFrame, metrics: Sequence[str]) -> list[tuple[str, str]]:
    """The columns (set, metric) that hold a value, set by set; shares of runaways where there are any."""
    told = part[(part["metric"] != RUNAWAYS) | part["set"].map(lambda s: has_runaways(part[part["set"] == s]))]
    known = set(zip(told["set"], told["metric"], strict=True))
    return [(name, metric) for name in order_sets(part["set"]) for metric in metrics if (name, metric) in known]


def _lookup(part: pd.DataFrame) -> dict[tuple[str, str, str], pd.Series]:
    return {(row["row"], row["set"], row["metric"]): row for _, row in part.iterrows()}


def _best(part: pd.DataFrame, cells: Sequence[tuple[str, str]]) -> set[tuple[str, str, str]]:
    """The method with the smallest mean over all of its seeds, of every column of errors with something to compare."""
    found = set()
    for name, metric in cells:
        column = part[(part["set"] == name) & (part["metric"] == metric) & (part["n"] == part["of"])]
        if len(column) > 1 and metric != RUNAWAYS:
            found.add((column.loc[column["mean"].idxmin(), "row"], name, metric))
    return found


def _chosen(part: pd.DataFrame, settings: Mapping) -> list[str]:
    """Metrics of the first table."""
    return tabled_metrics(part, settings.get("convention", "sum"))


def _caption(part: pd.DataFrame, settings: Mapping) -> str:
    """What every table says of itself: preset, seeds, convention, units."""
    sizes = sorted({len(seeds.split()) for seeds in part["seeds"]})
    counted = "1 seed" if sizes == [1] else f"{' or '.join(map(str, sizes))} seeds"
    parts = [
        f"Preset: {', '.join(dict.fromkeys(part['preset']))}.",
        f"Mean ± standard deviation (n − 1) over {counted} per method; {DASH}: no value, or no deviation of one seed.",
    ]
    chosen, convention = _chosen(part, settings), settings.get("convention", "sum")
    if chosen[0].startswith("log_mse"):
        start = settings.get("from_s", "")
        times = {"": "the evaluated times", None: "the forecast window (t1, t2]"}.get(start, f"times from {start} s on")
        parts.append(
            f"log-MSE (no unit): natural logarithm of the mean, over samples and {times}, of the squared error"
            f" {CONVENTIONS[convention]} (convention: {convention})."
        )
    if "relative_error" in chosen:
        parts.append("Error: mean of |estimate − truth| / |truth| of the expert parameters, in %.")
    if (part["n"] < part["of"]).any():
        parts.append("(a/b): only a of b seeds have a finite value, and only those are averaged.")
    if has_runaways(part):
        parts.append(RUNAWAYS_NOTE)
    return " ".join(parts)


def _rows(part: pd.DataFrame) -> list[tuple[str, str, int]]:
    """Key, label and number of seeds of every row of a table."""
    first = part.drop_duplicates("row")
    counts = [len(seeds.split()) for seeds in first["seeds"]]
    return list(zip(first["row"], first["label"], counts, strict=True))


def _markdown(part: pd.DataFrame, settings: Mapping) -> str:
    units, values, chosen = settings["units"], _lookup(part), _chosen(part, settings)
    cells = _cells(part, chosen)
    best = _best(part, cells)
    titles = [f"{set_title(name, settings)}: {metric_title(metric, units)}" for name, metric in cells]
    rows = []
    for row, label, count in _rows(part):
        texts = [cell_text(values.get((row, *cell)), cell[1]) for cell in cells]
        marked = [f"**{t}**" if (row, *c) in best else t for t, c in zip(texts, cells, strict=True)]
        rows.append([escape(label), str(count), *marked])
    lines = [
        f"## {part['experiment'].iloc[0]}",
        "",
        _caption(part, settings),
        "Best of each column in bold.",
        "",
    ]
    lines += grid(["method", "seeds", *titles], rows, 1)
    others = [name for name in dict.fromkeys(part["metric"]) if name not in (*chosen, RUNAWAYS)]
    if others:
        sets = order_sets(part["set"])
        rows = []
        for metric in others:
            title = metric_title(metric, units) + (f" ({metric})" if metric.startswith("log_mse") else "")
            for row, label, _ in _rows(part):
                found = [values.get((row, name, metric)) for name in sets]
                if any(cell is not None for cell in found):
                    rows.append([title, escape(label), *(cell_text(cell, metric) for cell in found)])
        lines += [
            "",
            "Further metrics:",
            "",
            *grid(["metric", "method", *(set_title(s, settings) for s in sets)], rows, 2),
        ]
    return "\n".join(lines) + "\n"


def _latex(part: pd.DataFrame, settings: Mapping) -> str:
    units, values = settings["units"], _lookup(part)
    cells = _cells(part, _chosen(part, settings))
    best = _best(part, cells)
    sets = list(dict.fromkeys(name for name, _ in cells))
    spans, rules, column = [], [], 3
    for name in sets:
        width = sum(cell[0] == name for cell in cells)
        spans.append(rf"\multicolumn{{{width}}}{{c}}{{{tex(set_title(name, settings))}}}")
        rules.append(rf"\cmidrule(lr){{{column}-{column + width - 1}}}")
        column += width
    body = []
    for row, label, count in _rows(part):
        texts = []
        for cell in cells:
            text = cell_text(values.get((row, *cell)), cell[1], minus="-", join=r" \pm ").replace(DASH, r"\text{--}")
            if (row, *cell) in best:
                text = rf"\mathbf{{{text}}}"
            texts.append(f"${text}$" if "pm" in text else text.replace(r"\text{--}", "--"))
        body.append(" & ".join([tex(label), str(count), *texts]) + r" \\")
    titles = [tex(metric_title(metric, units)) for _, metric in cells]
    name = part["experiment"].iloc[0]
    caption = f"{tex(_caption(part, settings))} Best of each column in bold."
    lines = [
        r"% needs \usepackage{booktabs,amsmath}",
        r"\begin{table}",
        r"  \centering\footnotesize\setlength{\tabcolsep}{3pt}",
        rf"  \caption{{\textbf{{{tex(name)}.}} {caption}}}",
        rf"  \label{{tab:{name.replace('_', '-')}}}",
        rf"  \begin{{tabular}}{{lr{'r' * len(cells)}}}",
        r"    \toprule",
        "    & & " + " & ".join(spans) + r" \\",
        "    " + " ".join(rules),
        "    method & seeds & " + " & ".join(titles) + r" \\",
        r"    \midrule",
        *(f"    {row}" for row in body),
        r"    \bottomrule",
        r"  \end{tabular}",
        r"\end{table}",
    ]
    return "\n".join(lines) + "\n"

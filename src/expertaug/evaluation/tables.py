"""The stage tabulate: one table of metrics per experiment, as CSV, Markdown and LaTeX."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd

from expertaug.errors import InputError
from expertaug.evaluation.forecast_file import Forecasts
from expertaug.evaluation.formats import DASH, cell_text, escape, grid, metric_title, tex
from expertaug.evaluation.summary import (
    CONVENTIONS,
    SETS,
    log_mse_name,
    order_labels,
    order_sets,
    read_metrics,
    set_title,
    summarise,
)
from expertaug.files import write_text


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
            in full precision, the long one of all sets; LaTeX the chosen metrics, Markdown these and the others in a
            second table, of the main sets.
        settings: all optional: ``convention`` ("sum" or "dim": of the log-MSE), ``metrics`` (those in the first table),
            ``labels`` (order of the methods), ``units`` (unit of each parameter by name), ``set_titles`` (how sets are
            printed), ``from_s`` (as in evaluation: the log-MSE sees times from there on; null = the forecast window).
        forecasts: forecasts.npz of the same runs; the units of the parameters are taken from there.

    Raises:
        InputError: a metrics file is broken, an output's suffix or a metric is unknown.
    """
    settings = dict(settings or {})
    settings["units"] = _units(forecasts) | settings.get("units", {})
    long = _prepare(read_metrics(metrics), settings)
    chosen = settings.get("metrics") or [log_mse_name(settings.get("convention", "sum")), "relative_error"]
    chosen = [name for name in chosen if name in set(long["metric"])]
    if not chosen:
        known = ", ".join(dict.fromkeys(long["metric"]))
        raise InputError("metrics", f"none of {settings.get('metrics')} is in the files", f"some of {known}")
    main = long[long["set"].isin(SETS)]
    for output in map(Path, outputs):
        if output.suffix == ".csv":
            table = long if output.stem.endswith("_long") else _wide(main)
            write_text(output, table.to_csv(index=False))
        elif output.suffix == ".md":
            write_text(output, "\n".join(_markdown(part, chosen, settings) for part in _experiments(main)))
        elif output.suffix == ".tex":
            write_text(output, "\n".join(_latex(part, chosen, settings) for part in _experiments(main)))
        else:
            raise InputError(output, f"suffix {output.suffix!r}", "one of .csv, .md, .tex")


def _units(forecasts: Sequence[Path]) -> dict[str, str]:
    """Unit of each parameter by name."""
    files = [Forecasts.load(path) for path in forecasts]
    return {name: unit for file in files for name, unit in zip(file.parameter_names, file.parameter_units, strict=True)}


def _prepare(table: pd.DataFrame, settings: Mapping) -> pd.DataFrame:
    """The summary, sorted as it is printed; where one experiment has several presets, labels name theirs."""
    for _, group in table.groupby("experiment"):
        presets = group["preset"].unique()
        if len(presets) > 1:
            rows = group.index
            table.loc[rows, "label"] = group["label"] + " (" + group["preset"] + ")"
    seeds = table.groupby(["experiment", "preset", "label"], sort=False)["seed"].agg(lambda s: sorted(set(s)))
    long = summarise(table)
    long["seeds"] = [
        " ".join(map(str, seeds[e, p, lab])) for e, p, lab in long[["experiment", "preset", "label"]].values
    ]
    ranks = {
        "label": order_labels(long["label"], settings.get("labels", ())),
        "set": order_sets(long["set"]),
        "metric": list(dict.fromkeys(long["metric"])),
        "experiment": list(dict.fromkeys(long["experiment"])),
    }
    places = {key: {value: i for i, value in enumerate(values)} for key, values in ranks.items()}
    return long.sort_values(
        ["experiment", "label", "set", "metric"], key=lambda c: c.map(places[c.name]), ignore_index=True
    )


def _experiments(long: pd.DataFrame) -> list[pd.DataFrame]:
    return [part for _, part in long.groupby("experiment", sort=False)]


def _wide(long: pd.DataFrame) -> pd.DataFrame:
    """One row per method; columns <set>/<metric>/mean, /std and /n."""
    rows = []
    for (experiment, label), part in long.groupby(["experiment", "label"], sort=False):
        first = part.iloc[0]
        row = {"experiment": experiment, "preset": first["preset"], "method": first["method"], "label": label}
        row["seeds"] = first["seeds"]
        for cell in part.itertuples():
            name = f"{cell.set}/{cell.metric}"
            row |= {f"{name}/mean": cell.mean, f"{name}/std": cell.std, f"{name}/n": cell.n}
        rows.append(row)
    table = pd.DataFrame(rows)
    counts = [name for name in table if name.endswith("/n")]
    return table.astype(dict.fromkeys(counts, "Int64"))


def _cells(part: pd.DataFrame, metrics: Sequence[str]) -> list[tuple[str, str]]:
    """The columns (set, metric) that hold a value, set by set."""
    known = set(zip(part["set"], part["metric"], strict=True))
    return [(name, metric) for name in order_sets(part["set"]) for metric in metrics if (name, metric) in known]


def _lookup(part: pd.DataFrame) -> dict[tuple[str, str, str], pd.Series]:
    return {(row["label"], row["set"], row["metric"]): row for _, row in part.iterrows()}


def _best(part: pd.DataFrame, cells: Sequence[tuple[str, str]]) -> set[tuple[str, str, str]]:
    """The method with the smallest mean over all of its seeds, of every column of errors with something to compare."""
    found = set()
    for name, metric in cells:
        column = part[(part["set"] == name) & (part["metric"] == metric) & (part["n"] == part["of"])]
        if len(column) > 1 and metric != "wall_s":
            found.add((column.loc[column["mean"].idxmin(), "label"], name, metric))
    return found


def _caption(part: pd.DataFrame, chosen: Sequence[str], settings: Mapping) -> str:
    """What every table says of itself: preset, seeds, convention, units."""
    sizes = sorted({len(seeds.split()) for seeds in part["seeds"]})
    counted = "1 seed" if sizes == [1] else f"{' or '.join(map(str, sizes))} seeds"
    parts = [
        f"Preset: {', '.join(dict.fromkeys(part['preset']))}.",
        f"Mean ± standard deviation (n − 1) over {counted} per method; {DASH}: no value, or no deviation of one seed.",
    ]
    convention = next((name[8:] for name in chosen if name[8:] in CONVENTIONS and name.startswith("log_mse_")), None)
    if convention:
        start = settings.get("from_s", "")
        times = {"": "the evaluated times", None: "the forecast window (t1, t2]"}.get(start, f"times from {start} s on")
        parts.append(
            f"log-MSE (no unit): natural logarithm of the mean, over samples and {times}, of the squared error"
            f" {CONVENTIONS[convention]} (convention: {convention})."
        )
    if any(name.startswith("relative_error") for name in chosen):
        parts.append("Error: mean of |estimate − truth| / |truth| of the expert parameters, in %.")
    if (part["n"] < part["of"]).any():
        parts.append("(a/b): only a of b seeds have a finite value, and only those are averaged.")
    return " ".join(parts)


def _markdown(part: pd.DataFrame, chosen: Sequence[str], settings: Mapping) -> str:
    units, values = settings.get("units", {}), _lookup(part)
    cells = _cells(part, chosen)
    best = _best(part, cells)
    titles = [f"{set_title(name, settings)}: {metric_title(metric, units)}" for name, metric in cells]
    rows = []
    for label in dict.fromkeys(part["label"]):
        count = len(part.loc[part["label"] == label, "seeds"].iloc[0].split())
        texts = [cell_text(values.get((label, *cell)), cell[1]) for cell in cells]
        marked = [f"**{t}**" if (label, *c) in best else t for t, c in zip(texts, cells, strict=True)]
        rows.append([escape(label), str(count), *marked])
    lines = [
        f"## {part['experiment'].iloc[0]}",
        "",
        _caption(part, chosen, settings),
        "Best of each column in bold.",
        "",
    ]
    lines += grid(["method", "seeds", *titles], rows, 1)
    others = [name for name in dict.fromkeys(part["metric"]) if name not in chosen]
    if others:
        sets = order_sets(part["set"])
        rows = []
        for metric in others:
            title = metric_title(metric, units) + (f" ({metric})" if metric.startswith("log_mse") else "")
            for label in dict.fromkeys(part["label"]):
                found = [values.get((label, name, metric)) for name in sets]
                if any(cell is not None for cell in found):
                    rows.append([title, escape(label), *(cell_text(cell, metric) for cell in found)])
        lines += [
            "",
            "Further metrics:",
            "",
            *grid(["metric", "method", *(set_title(s, settings) for s in sets)], rows, 2),
        ]
    return "\n".join(lines) + "\n"


def _latex(part: pd.DataFrame, chosen: Sequence[str], settings: Mapping) -> str:
    units, values = settings.get("units", {}), _lookup(part)
    cells = _cells(part, chosen)
    best = _best(part, cells)
    sets = list(dict.fromkeys(name for name, _ in cells))
    spans, rules, column = [], [], 3
    for name in sets:
        width = sum(cell[0] == name for cell in cells)
        spans.append(rf"\multicolumn{{{width}}}{{c}}{{{tex(set_title(name, settings))}}}")
        rules.append(rf"\cmidrule(lr){{{column}-{column + width - 1}}}")
        column += width
    body = []
    for label in dict.fromkeys(part["label"]):
        count = len(part.loc[part["label"] == label, "seeds"].iloc[0].split())
        texts = []
        for cell in cells:
            text = cell_text(values.get((label, *cell)), cell[1], minus="-", join=r" \pm ").replace(DASH, r"\text{--}")
            if (label, *cell) in best:
                text = rf"\mathbf{{{text}}}"
            texts.append(f"${text}$" if "pm" in text else text.replace(r"\text{--}", "--"))
        body.append(" & ".join([tex(label), str(count), *texts]) + r" \\")
    titles = [tex(metric_title(metric, units)) for _, metric in cells]
    name = part["experiment"].iloc[0]
    caption = f"{tex(_caption(part, chosen, settings))} Best of each column in bold."
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

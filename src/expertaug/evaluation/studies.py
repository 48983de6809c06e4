"""The stage study: table and figure of one of an experiment's further questions."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from expertaug.errors import InputError
from expertaug.evaluation import study_figures
from expertaug.evaluation.formats import RUNAWAYS_NOTE, cell_text, metric_title, write_study
from expertaug.evaluation.study_figures import DURING_TRAINING_SETS, ranges_text, width_sets
from expertaug.evaluation.summary import (
    CONVENTIONS,
    has_runaways,
    read_metrics,
    set_title,
    summarise,
    tabled_metrics,
)
from expertaug.labels import base

AROUND = ("epoch", "finetune_epochs")


@dataclass(frozen=True)
class Study:
    """One kind of study.

    Attributes:
        title: of the table.
        further: columns of its metrics beside the usual ones.
        rows: summary and settings → header, rows of text, number of columns that are text.
        draw: summary, outputs and settings → the figure.
    """

    title: str
    further: tuple[str, ...]
    rows: Callable[[pd.DataFrame, Mapping], tuple[list[str], list[list[str]], int]]
    draw: Callable[[pd.DataFrame, Sequence[Path], Mapping], None]


def study(metrics: Sequence[Path], outputs: Sequence[Path], settings: Mapping) -> None:
    """Write the table and draw the figure of a study.

    Arguments:
        metrics: metrics.csv (of the study along training: during_training.csv) of all variants and groups of seeds.
        outputs: any of .csv (mean, std, n in full precision), .md, .tex, .png and .pdf.
        settings: {study, labels, all_methods, sets, classical, convention, set_titles, title, from_s} and, of
            out_of_expertise, horizons and along, ``options`` (the study's configuration), of prior_width ``priors``
            (ranges by method and name, "" = the method's own); ``labels`` has pairs of a variant and its printed label,
            in order, ``options["panels"]`` pairs of a title (of horizons: a split) and the sets of a panel, ``sets``
            the simulated sets' ranges, ``classical`` the method that is least squares with the expert, or null.

    Raises:
        InputError: a file is broken or lacks what the study compares, or an output's suffix is unknown.
    """
    kind = KINDS[settings["study"]]
    settings = {**settings, "labels": dict(settings["labels"])}
    table = read_metrics(metrics, kind.further)
    summary = summarise(table[table["method"].isin(list(settings["labels"]))], kind.further)
    _require(summary, metrics, settings)
    name = str(summary["experiment"].iloc[0])
    caption = _caption(table, settings) + (f" {RUNAWAYS_NOTE}" if has_runaways(summary) else "")
    title, label = f"{name}: {kind.title}", f"{name}-{settings['study']}".replace("_", "-")
    if drawn := write_study(outputs, summary, kind.rows(summary, settings), caption, label, title):
        kind.draw(summary, drawn, settings)


def cells_of(summary: pd.DataFrame, *keys: str) -> dict[tuple, pd.Series]:
    """Rows of a summary by the values of some columns."""
    return {tuple(row[key] for key in keys): row for _, row in summary.iterrows()}


def _require(summary: pd.DataFrame, metrics: Sequence[Path], settings: Mapping) -> None:
    panels = settings.get("options", {}).get("panels", [])
    for name in [name for _, names in panels for name in names]:
        if name not in set(summary["set"]):
            raise InputError(metrics[0], f"no metrics of the set {name!r}", "evaluate again")


def _caption(table: pd.DataFrame, settings: Mapping) -> str:
    seeds = table["seed"].nunique()
    start = settings.get("from_s")
    window = "the forecast window (t1, t2]" if start is None else f"times from {start:g} s on"
    return (
        f"Preset: {', '.join(dict.fromkeys(table['preset']))}. Mean ± standard deviation (n − 1) over {seeds} "
        f"seed{'s' if seeds > 1 else ''}. log-MSE: natural logarithm of the mean squared error over {window}, "
        f"{CONVENTIONS[settings['convention']]}; lower is better."
    )


def _shift_rows(summary: pd.DataFrame, settings: Mapping) -> tuple[list[str], list[list[str]], int]:
    """A row for each metric, panel and distance, a column for each method."""
    options, found = settings["options"], cells_of(summary, "metric", "set", "method")
    rows = []
    for metric in tabled_metrics(summary, settings["convention"]):
        for title, names in options["panels"]:
            for distance, name in zip(options["distances"], names, strict=True):
                sampled = ranges_text(settings["sets"].get(name, {}).get("z_a", {}))
                values = [cell_text(found.get((metric, name, v)), metric) for v in settings["labels"]]
                rows.append([metric_title(metric, {}), title, distance, sampled, *values])
    return ["metric", "shifted", "distance", "z_a of the set", *settings["labels"].values()], rows, 4


def _horizon_rows(summary: pd.DataFrame, settings: Mapping) -> tuple[list[str], list[list[str]], int]:
    """A row for each metric, split and end of the forecast, a column for each method."""
    options, found = settings["options"], cells_of(summary, "metric", "set", "method")
    rows = []
    for metric in tabled_metrics(summary, settings["convention"]):
        for split, names in options["panels"]:
            for end, name in zip(options["distances"], names, strict=True):
                values = [cell_text(found.get((metric, name, v)), metric) for v in settings["labels"]]
                rows.append([metric_title(metric, {}), set_title(split, settings), end, *values])
    return ["metric", "set", "until", *settings["labels"].values()], rows, 3


def _width_rows(summary: pd.DataFrame, settings: Mapping) -> tuple[list[str], list[list[str]], int]:
    """A row for each method and prior, a column for each metric and set."""
    found = cells_of(summary, "metric", "set", "method")
    columns = [(m, s) for m in tabled_metrics(summary, settings["convention"]) for s in width_sets(summary)]
    header = [f"{set_title(name, settings)}: {metric_title(metric, {})}" for metric, name in columns]
    rows = []
    for method in dict.fromkeys(map(base, settings["labels"])):
        priors = settings["priors"][method]
        ordered = {name: ranges_text(priors[name]) for name in study_figures.by_width(priors)}
        for name, ranges in {None: "not augmented", **ordered}.items():
            variant = method if name is None else f"{method}+{name}"
            if variant in settings["labels"]:
                values = [cell_text(found.get((*column, variant)), column[0]) for column in columns]
                rows.append([settings["labels"][variant], ranges, *values])
    return ["method", "p⁺", *header], rows, 2


def _during_training_rows(summary: pd.DataFrame, settings: Mapping) -> tuple[list[str], list[list[str]], int]:
    """A row for each snapshot and length of fine-tuning, a column for each metric and set."""
    found = cells_of(summary, "metric", "set", *AROUND)
    columns = [(m, s) for m in tabled_metrics(summary, settings["convention"]) for s in DURING_TRAINING_SETS]
    header = [f"{set_title(name, settings)}: {metric_title(metric, {})}" for metric, name in columns]
    rows = []
    for epoch, tuned in sorted({key[2:] for key in found}):
        values = [cell_text(found.get((*column, epoch, tuned)), column[0]) for column in columns]
        rows.append([str(epoch), str(tuned) if tuned else "–", *values])
    return ["training passes", "fine-tuning passes", *header], rows, 0


KINDS = {
    "out_of_expertise": Study("shifts out of the expertise", (), _shift_rows, study_figures.shifts),
    "horizons": Study("longer forecasts", (), _horizon_rows, study_figures.horizons),
    "prior_width": Study("width of the augmentation prior", (), _width_rows, study_figures.widths),
    "during_training": Study(
        "augmentation along the training", AROUND, _during_training_rows, study_figures.during_training
    ),
}

"""The numbers that come first: of each experiment a few rows, chosen by the validation set alone."""

from __future__ import annotations

from typing import NamedTuple

import pandas as pd

from expertaug.evaluation.metrics import log_mse_of, metric_of
from expertaug.evaluation.report.tables import by_cell, gain
from expertaug.evaluation.settings import ReportExperiment, Titles
from expertaug.evaluation.summary import in_domain
from expertaug.evaluation.table import DASH, STAR, Cell, Table
from expertaug.evaluation.tabulate import FROM_BASE, OVER_CONTROL, references
from expertaug.versions import Version

CHOSEN = "validation"  # the set by which rows are chosen
CAPTION = (
    "Log-MSE of forecasts (lower is better): mean over seeds with its 95 % interval, or ± standard deviation over "
    "seeds where samples' errors are not kept. Rows are chosen by the validation set alone: the method that is best "
    "there, and the augmented model (+) that is best there, with its control, the same base trained on for the same "
    "steps on the real data alone, and that base. Beside them stand, whatever their scores, least squares on each "
    "window and the floor, the equation that made the data. Gain: of an augmented model over its control on the test "
    "set; *: told apart from 0."
)

BESIDE = {OVER_CONTROL: "its control", FROM_BASE: "its base"}


class Row(NamedTuple):
    """A version of a method, and why it is shown."""

    method: str
    why: str


def chosen(long: pd.DataFrame, job: ReportExperiment) -> list[Row]:
    """The rows of an experiment; nothing but the validation set's log-MSE decides.

    Arguments:
        long: the experiment's long table (:func:`expertaug.evaluation.report.tables.read_long`).
    """
    part = long[(long["set"] == CHOSEN) & (long["metric"] == log_mse_of(job.convention).name)]
    known, floors = list(dict.fromkeys(long["method"])), job.floors
    apart = {*floors, *job.known_form}
    rivals = part[~part["method"].isin(apart) & (part["n"] == part["of"])]
    found = [Row(method, "best by validation") for method in _best(rivals)]
    plus = [Version.parse(method).is_augmented and not Version.parse(method).estimators for method in rivals["method"]]
    augmented = _best(rivals[plus])
    for method in augmented:
        beside = references(method, known)
        found.append(Row(method, "best + by validation"))
        found += [Row(beside[kind], said) for kind, said in BESIDE.items() if kind in beside]
    fitted = [method for method in job.least_squares if method in known and method not in apart]
    found += [Row(method, "least squares") for method in fitted if not Version.parse(method).is_refined]
    found += [Row(method, "floor") for method in floors if method in known]
    reasons: dict[str, list[str]] = {}
    for row in found:
        reasons.setdefault(row.method, []).append(row.why)
    return [Row(method, ", ".join(whys)) for method, whys in reasons.items()]


def table(experiments: list[tuple[pd.DataFrame, ReportExperiment]]) -> Table:
    """The rows of all experiments, each in a part of its own.

    Arguments:
        experiments: long table and settings of each.
    """
    near = {name: in_domain(long["set"]) for long, one in experiments for name in [one.name]}
    inner = "iid" in near.values()
    parts = []
    for long, one in experiments:
        metric, cells = log_mse_of(one.convention).name, by_cell(long.assign(label=long["method"]))
        said = dict(zip(long["method"], long["label"], strict=True))
        rows = []
        for row in chosen(long, one):
            found = {name: cells.get((row.method, name, metric)) for name in (CHOSEN, "iid", "test")}
            shown = [Cell.of_row(metric_of(metric), found[name]).text() for name in (CHOSEN, *["iid"] * inner, "test")]
            rows.append([said[row.method], row.why, *shown, gain(found["test"]) or DASH])
        parts.append((f"{one.of_experiment(one.name)} ({one.convention_text})", rows))
    sets = [Titles().of_set(name) for name in (CHOSEN, *["iid"] * inner, "test")]
    return Table(["method", "shown as", *sets, "gain over control, test"], parts, 2)


def sentence(long: pd.DataFrame, job: ReportExperiment) -> tuple[str, str]:
    """The title of an experiment, and what its rows say."""
    metric = log_mse_of(job.convention).name
    cells, said = by_cell(long.assign(label=long["method"])), dict(zip(long["method"], long["label"], strict=True))
    rows, title = chosen(long, job), job.of_experiment(job.name)

    def test(method: str) -> str:
        return Cell.of_row(metric_of(metric), cells.get((method, "test", metric))).text()

    best = next((row for row in rows if "best by validation" in row.why), None)
    if best is None:
        return title, "no method has a finite score of every seed on the validation set."
    text = f"{said[best.method]} is best by validation, with a log-MSE of {test(best.method)} on the test set"
    fitted = [
        f"{said[row.method]} {test(row.method)}" for row in rows if "least squares" in row.why and row is not best
    ]
    text += f" ({'; '.join(fitted)})." if fitted else "."
    for row in rows:
        gained = gain(cells.get((row.method, "test", metric))) if "best +" in row.why else ""
        if gained:
            apart = "told apart from 0" if STAR in gained else "not told apart from 0"
            text += f" {said[row.method]} gains {gained.replace(STAR, '')} over its control there, {apart}."
    return title, text


def _best(rows: pd.DataFrame) -> list[str]:
    """The method with the lowest mean, if there is any."""
    return [rows.loc[rows["mean"].idxmin(), "method"]] if len(rows) else []

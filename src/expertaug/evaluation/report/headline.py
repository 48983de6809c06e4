"""The numbers that come first: of each experiment a few rows, chosen by the validation set alone."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from expertaug.evaluation.metrics import log_mse_of
from expertaug.evaluation.report.tables import gain
from expertaug.evaluation.settings import ReportExperiment, Titles
from expertaug.evaluation.summary import TabledMean, cell_of, in_domain, labels_of
from expertaug.evaluation.table import DASH, STAR, Table
from expertaug.evaluation.tabulate import FROM_BASE, OVER_CONTROL, references
from expertaug.versions import Version

CHOSEN = "validation"  # the set by which rows are chosen
CAPTION = (
    "Log-MSE of forecasts (lower is better): mean over seeds with its 95 % interval, or ± standard deviation over "
    "seeds where single samples' errors are not kept. Rows are chosen by the validation set alone: the best method "
    "there, and the best augmented model (+) with its control (the same base model, trained further for as many steps "
    "on the real data alone) and its base. For comparison: least squares on each window and, as the floor, the "
    "equation that generated the data. Gain: how much lower the augmented model's log-MSE on the test set is than its "
    "control's; *: significant."
)

BESIDE = {OVER_CONTROL: "its control", FROM_BASE: "its base"}


class Row(NamedTuple):
    """A version of a method, and why it is shown."""

    method: str
    why: str


def choose_rows(long: Sequence[TabledMean], job: ReportExperiment) -> list[Row]:
    """The rows of an experiment; nothing but the validation set's log-MSE decides.

    Arguments:
        long: the experiment's long table (:func:`expertaug.evaluation.report.tables.read_long`).
    """
    metric, methods, floors = log_mse_of(job.convention).name, list(labels_of(long)), job.floors
    apart = {*floors, *job.known_form}
    scores = [mean for mean in long if (mean.set, mean.metric) == (CHOSEN, metric)]
    rivals = [mean for mean in scores if mean.method not in apart and mean.n == mean.of]
    rows = [Row(method, "best by validation") for method in _best(rivals)]
    versions = {mean.method: Version.parse(mean.method) for mean in rivals}
    for method in _best([mean for mean in rivals if _is_plus(versions[mean.method])]):
        beside = references(method, methods)
        rows.append(Row(method, "best + by validation"))
        rows += [Row(beside[kind], why) for kind, why in BESIDE.items() if kind in beside]
    fitted = [method for method in job.least_squares if method in methods and method not in apart]
    rows += [Row(method, "least squares") for method in fitted if not Version.parse(method).is_refined]
    rows += [Row(method, "floor") for method in floors if method in methods]
    reasons: dict[str, list[str]] = {}
    for row in rows:
        reasons.setdefault(row.method, []).append(row.why)
    return [Row(method, ", ".join(whys)) for method, whys in reasons.items()]


def table(experiments: Sequence[tuple[Sequence[TabledMean], ReportExperiment]]) -> Table:
    """The rows of all experiments, each in a part of its own.

    Arguments:
        experiments: long table and settings of each.
    """
    inner = any(in_domain(mean.set for mean in long) == "iid" for long, _ in experiments)
    sets = [CHOSEN, *["iid"] * inner, "test"]
    parts = []
    for long, job in experiments:
        labels, scores = labels_of(long), _scores(long, job)
        rows = []
        for row in choose_rows(long, job):
            shown = [_text(scores, row.method, name, job) for name in sets]
            rows.append([labels[row.method], row.why, *shown, gain(scores.get((row.method, "test"))) or DASH])
        parts.append((part(job), rows))
    titles = [_of_set(name, experiments) for name in sets]
    return Table(["method", "shown as", *titles, "gain over control, test"], parts, 2)


def _of_set(name: str, experiments: Sequence[tuple[Sequence[TabledMean], ReportExperiment]]) -> str:
    """A set's title: the experiments' own where all call it the same."""
    titles = {job.of_set(name) for _, job in experiments}
    return titles.pop() if len(titles) == 1 else Titles().of_set(name)


def part(job: ReportExperiment) -> str:
    """The title of an experiment's rows."""
    return f"{job.of_experiment(job.name)} ({job.convention_text})"


def sentence(long: Sequence[TabledMean], job: ReportExperiment) -> tuple[str, str]:
    """The title of an experiment, and what its rows say."""
    scores, labels, rows = _scores(long, job), labels_of(long), choose_rows(long, job)
    title = job.of_experiment(job.name)
    best = next((row for row in rows if "best by validation" in row.why), None)
    if best is None:
        return title, "no method has a finite score of every seed on the validation set."
    score = _text(scores, best.method, "test", job)
    text = f"{labels[best.method]} is best by validation, with a log-MSE of {score} on the test set"
    fitted = [
        f"{labels[row.method]} {_text(scores, row.method, 'test', job)}"
        for row in rows
        if "least squares" in row.why and row is not best
    ]
    text += f" ({'; '.join(fitted)})." if fitted else "."
    for row in rows:
        gained = gain(scores.get((row.method, "test"))) if "best +" in row.why else ""
        if gained:
            clear = "significantly" if STAR in gained else "not significantly"
            text += f" {labels[row.method]} gains {gained.replace(STAR, '')} over its control there, {clear}."
    return title, text


def _scores(long: Sequence[TabledMean], job: ReportExperiment) -> dict[tuple[str, str], TabledMean]:
    """The log-MSE by method and set."""
    metric = log_mse_of(job.convention).name
    return {(mean.method, mean.set): mean for mean in long if mean.metric == metric}


def _text(scores: dict[tuple[str, str], TabledMean], method: str, name: str, job: ReportExperiment) -> str:
    return cell_of(scores, (method, name), log_mse_of(job.convention).name).text()


def _is_plus(version: Version) -> bool:
    return version.is_augmented and not version.estimators


def _best(rivals: Sequence[TabledMean]) -> list[str]:
    """The method with the lowest mean, if there is any."""
    return [min(rivals, key=lambda mean: mean.mean).method] if rivals else []

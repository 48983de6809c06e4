"""The stage alarm: which forecasts fail, and whether a score that needs no truth tells them beforehand."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from expertaug import plotting
from expertaug.evaluation.forecasts import Forecasts
from expertaug.evaluation.intervals import of_seeds as interval_of_seeds
from expertaug.evaluation.settings import Titles, WindowStudyJob
from expertaug.evaluation.summary import mean_of
from expertaug.evaluation.table import DASH, Study, Table
from expertaug.evaluation.windows import VersionWindows, WindowSet, none_shown, windows_of
from expertaug.inference.diagnostics.alarm import FAILING, Assessment, assess, attainable, ensemble_spread
from expertaug.rows import frame, group_by
from expertaug.versions import LINES, REFINED

KNOWN, IID = "validation", "iid"
SCORES = {
    "misfit": "misfit",
    "expected": "expected error",
    "spread": "spread of seeds",
    "density": "density of estimates",
}
LOOKS: dict[str, plotting.Look] = {
    score: {"color": plotting.HUES[hue], "marker": marker, "markersize": 4, "linestyle": ""}
    for score, hue, marker in (("misfit", 5, "o"), ("expected", 6, "s"), ("spread", 7, "^"), ("density", 2, "D"))
}
CHANCE = {"color": "0.35", "linewidth": 0.9, "linestyle": ":"}
FEWEST = 5  # windows that fail, and that do not, by which a score is judged in the figure
UNJUDGED = f"No score can be judged: fewer than {FEWEST} test windows fail with every version, or all but so many."
Assessed: TypeAlias = Mapping[tuple[str, str, int], Assessment]  # by set, score and seed
ROW, APART = 0.42, 0.17  # inches of a version's row; distance of two scores, in rows
CAPTION = (
    f"Failing: forecasts whose squared error is above the {100 * FAILING:.0f} % quantile of the validation set's. "
    "Scores need the observed window alone: the model's misfit on it (after least squares, for refined versions), the "
    "squared error that is to be expected (of an encoder its forecast's distance from that of its refined version, "
    "where there is one; else the spread of forecasts from draws), the spread of the estimates over seeds, and minus "
    "the log density of the estimates among those of the validation windows (a Gaussian). AUROC: of failing against "
    "other windows of the set together with the IID test set where there is one. Caught and false alarms: of the "
    "error that is to be expected, where it is, else of the misfit, at a threshold of {share} % on the validation set. "
    "Means over seeds; –: no window fails, or all do."
)


@dataclass(frozen=True)
class Alarm:
    """What the alarm by a score is worth on a set (:class:`expertaug.inference.diagnostics.alarm.Assessment`)."""

    method: str
    label: str
    set: str
    score: str
    seed: int
    failing: float
    auroc: float
    caught: float
    false_alarms: float
    risk_area: float
    best_risk_area: float


def run_stage(forecasts: Sequence[Path], outputs: Sequence[Path], job: WindowStudyJob) -> None:
    """Stage: write the table of an experiment's alarms and draw those on its test set.

    Arguments:
        forecasts: forecasts.npz of all versions and groups of seeds.
        outputs: any of .csv (a row for each version, set, score and seed), .md, .tex, .png and .pdf.
        job: see :func:`alarm`.

    Raises:
        InputError: a file is broken, or an output's suffix is unknown.
    """
    alarm(map(Forecasts.load, forecasts), job).save(outputs)


def alarm(forecasts: Iterable[Forecasts], job: WindowStudyJob) -> Study:
    """The table of an experiment's alarms, and the figure of those on its test set.

    Arguments:
        forecasts: of all versions and groups of seeds.
        job: ``floor`` is the version of the true equation, which is not drawn; ``traced`` are drawn before others.

    Raises:
        InputError: as of :func:`windows_of`, or no version that is shown has forecasts.
    """
    versions, labels = windows_of(forecasts), job.label_of
    assessed = {v: _assess(versions[v], versions.get(f"{v}~{REFINED}")) for v in labels if v in versions}
    rows = [
        Alarm(
            *(v, labels[v], name, score, seed),
            failing=float(worth.failing.mean()),
            auroc=float(worth.area.value),
            caught=worth.caught,
            false_alarms=worth.false_alarms,
            risk_area=float(worth.risk.area),
            best_risk_area=float(worth.risk.best_area),
        )
        for v, sets in assessed.items()
        for (name, score, seed), worth in sets.items()
    ]
    if not rows:
        raise none_shown(versions)
    title = f"{job.of_experiment(versions[next(iter(assessed))].experiment)}: alarms"
    fewest = min(versions[v].sets[KNOWN].misfit.shape[1] for v in assessed)
    caption = CAPTION.format(share=f"{100 * attainable(fewest):.2g}")
    table = _table(rows, job, title, caption)
    return Study(frame(Alarm, rows), [table], lambda: _draw(assessed, labels, job, title))


def _draw(assessed: Mapping[str, Assessed], labels: Mapping[str, str], job: WindowStudyJob, title: str) -> Figure:
    """AUROC with its interval, and the share caught, of every version and score of the test set that can be judged."""
    worth = {v: judged for v, sets in assessed.items() if v != job.floor and (judged := _judge(sets))}
    shown = [v for v in worth if v in sorted(worth, key=lambda v: v not in job.traced)[:LINES]]
    if not shown:
        return plotting.note(UNJUDGED)
    looks = {score: look for score, look in LOOKS.items() if any(score in worth[v] for v in shown)}
    names = [f"{plotting.text(labels[v])}\n({worth[v][next(iter(worth[v]))].fails})" for v in shown]
    with plotting.use_style():
        figure = plotting.new_figure(1.4 + ROW * len(shown))
        left, right = figure.subplots(1, 2, sharey=True)
        for row, v in enumerate(shown):
            if row:
                left.axhline(row - 0.5, color="0.88", linewidth=0.6, zorder=0)
                right.axhline(row - 0.5, color="0.88", linewidth=0.6, zorder=0)
            for place, (score, look) in enumerate(looks.items()):
                y = row + (place - (len(looks) - 1) / 2) * APART
                if (judged := worth[v].get(score)) is not None:
                    left.plot([judged.low, judged.high], [y, y], color=look["color"], linewidth=1.0)
                    left.plot([judged.area], [y], **look)
                    right.plot([100 * judged.caught], [y], **look)
        left.axvline(0.5, **CHANCE)
        left.set(xlabel="AUROC of failing windows", xlim=(0, 1.02), ylim=(len(shown) - 0.5, -0.5))
        right.set(xlabel="failing windows with an alarm [%]", xlim=(-2, 102))
        left.set_yticks(range(len(shown)), names)
        for axis in (left, right):
            axis.grid(axis="x")
            axis.tick_params(axis="y", length=0)
        handles = [Line2D([], [], label=SCORES[score], **look) for score, look in looks.items()]
        plotting.legend(figure, [*handles, Line2D([], [], label="by chance", **CHANCE)])
        plotting.heading(figure, plotting.text(f"{title}, {job.of_set('test')}"))
    return figure


@dataclass(frozen=True)
class _Worth:
    """What a score is worth on the test set: means over the seeds of which it can be judged; ``low`` and ``high`` are
    the ends of the 95 % interval over windows and seeds."""

    area: float
    low: float
    high: float
    caught: float
    fails: str


def _judge(sets: Assessed) -> dict[str, _Worth]:
    """By score; without those that are constant, or where too few windows fail, or too few do not."""
    worth = {}
    for score in SCORES:
        of_seeds = [assessment for (name, of, _), assessment in sets.items() if (name, of) == ("test", score)]
        judged = [
            assessment
            for assessment in of_seeds
            if min(assessment.area.failing, assessment.area.others) >= FEWEST and len(set(assessment.scores)) > 1
        ]
        if judged:
            values, lows, highs = np.array(
                [(assessment.area.value, assessment.area.lower, assessment.area.upper) for assessment in judged]
            ).T
            mean, seeds = float(values.mean()), interval_of_seeds(values)
            below, above = (np.nan_to_num(end) for end in (mean - seeds.low, seeds.high - mean))
            low, high = mean - np.hypot(mean - lows.mean(), below), mean + np.hypot(highs.mean() - mean, above)
            fails = (
                f"{np.mean([assessment.area.failing for assessment in judged]):.0f} of {len(judged[0].failing)} fail"
            )
            caught = mean_of(assessment.caught for assessment in judged)
            worth[score] = _Worth(mean, float(max(low, 0.0)), float(min(high, 1.0)), caught, fails)
    return worth


def _assess(version: VersionWindows, refined: VersionWindows | None) -> dict[tuple[str, str, int], Assessment]:
    """By set, score and seed; sets that are like the training's are no shifts, but the IID test set is with each."""
    sets = version.sets
    if refined is not None and refined.seeds == version.seeds:
        moved = {name: windows.moved for name, windows in refined.sets.items() if windows.moved is not None}
        sets = {name: replace(windows, expected=moved.get(name, windows.expected)) for name, windows in sets.items()}
    validation, iid = sets[KNOWN], sets.get(IID)
    assessed = {}
    for name, shifted in sets.items():
        if name in ("train", KNOWN):
            continue
        pool = shifted if iid is None or name == IID else _pool(shifted, iid)
        for score in SCORES:
            for k, seed in enumerate(version.seeds):
                here, there = (_score(score, windows, validation, k) for windows in (pool, validation))
                if here is not None and there is not None:
                    errors = [_no_nan(windows.errors[k]) for windows in (pool, validation)]
                    assessed[name, score, seed] = assess(here, errors[0], there, errors[1], attainable(len(there)))
    return assessed


def _pool(first: WindowSet, second: WindowSet) -> WindowSet:
    hats = None
    if first.z_e_hat is not None and second.z_e_hat is not None:
        hats = np.concatenate((first.z_e_hat, second.z_e_hat), axis=1)
    expected = None
    if first.expected is not None and second.expected is not None:
        expected = np.concatenate((first.expected, second.expected), axis=1)
    return WindowSet(
        np.concatenate((first.errors, second.errors), axis=1),
        np.concatenate((first.misfit, second.misfit), axis=1),
        np.concatenate((first.z_e, second.z_e)),
        hats,
        expected=expected,
    )


def _score(score: str, windows: WindowSet, validation: WindowSet, seed: int) -> np.ndarray | None:
    """A score a window, (N,); None where a version has none."""
    if score == "misfit":
        return _no_nan(windows.misfit[seed])
    if score == "expected":
        return None if windows.expected is None else _no_nan(windows.expected[seed])
    if windows.z_e_hat is None or validation.z_e_hat is None:
        return None
    if score == "spread":
        scale = _no_nan(validation.z_e_hat).std((0, 1)).clip(1e-12)
        spread = ensemble_spread(_no_nan(windows.z_e_hat), scale) if len(windows.z_e_hat) > 1 else None
        return spread if spread is not None and spread.any() else None  # least squares is one estimator, not several
    own = _no_nan(validation.z_e_hat[seed])
    centred, mean = own - own.mean(0), own.mean(0)
    covariance = np.atleast_2d(centred.T @ centred / len(own)) + 1e-12 * np.eye(own.shape[1])
    away = _no_nan(windows.z_e_hat[seed]) - mean
    return 0.5 * np.einsum("np,pq,nq->n", away, np.linalg.inv(covariance), away)


def _no_nan(values: np.ndarray) -> np.ndarray:
    """What is no number is as bad as can be."""
    return np.nan_to_num(values.astype(float), nan=1e30, posinf=1e30, neginf=-1e30)


def _table(alarms: Sequence[Alarm], titles: Titles, title: str, caption: str) -> Table:
    """A row for each version and set: share failing, AUROC of each score, caught and false alarms by the best of them:
    the expected error, else the misfit."""
    header = ["method", "set", "failing [%]", *(f"AUROC, {text}" for text in SCORES.values())]
    header += ["caught [%]", "false alarms [%]"]
    rows = []
    for (label, name), part in group_by(alarms, lambda alarm: (alarm.label, alarm.set)).items():
        of_score = group_by(part, lambda alarm: alarm.score)
        areas = [mean_of(alarm.auroc for alarm in of_score.get(score, ())) for score in SCORES]
        best = of_score.get("expected") or of_score["misfit"]
        of_best = mean_of(alarm.caught for alarm in best), mean_of(alarm.false_alarms for alarm in best)
        cells = [_text(100 * mean_of(alarm.failing for alarm in best), 1), *(_text(a, 3) for a in areas)]
        rows.append([label, titles.of_set(name), *cells, *(_text(100 * v, 1) for v in of_best)])
    return Table(header, [("", rows)], 2, (), title, caption, "alarms")


def _text(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if np.isfinite(value) else DASH

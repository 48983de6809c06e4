"""The stage alarm: which forecasts fail, and whether a score that needs no truth tells them beforehand."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from expertaug.errors import InputError
from expertaug.evaluation.diagnostic_figures import draw_alarm
from expertaug.evaluation.settings import Titles, WindowStudyJob
from expertaug.evaluation.summary import mean_of
from expertaug.evaluation.table import DASH, Study, Table
from expertaug.evaluation.windows import VersionWindows, WindowSet, read_windows
from expertaug.inference.diagnostics.alarm import FAILING, Assessment, assess, attainable, ensemble_spread
from expertaug.rows import frame, grouped
from expertaug.versions import REFINED, Version

KNOWN, IID = "validation", "iid"
SCORES = {
    "misfit": "misfit",
    "expected": "expected error",
    "spread": "spread of seeds",
    "density": "density of estimates",
}
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


def alarm(forecasts: Sequence[Path], outputs: Sequence[Path], job: WindowStudyJob) -> None:
    """Write the table of an experiment's alarms and draw the first version's on its test set.

    Arguments:
        forecasts: forecasts.npz of all versions and groups of seeds.
        outputs: any of .csv (a row for each version, set, score and seed), .md, .tex, .png and .pdf.
        job: ``floor`` is the version of the true equation, which is not drawn; ``traced`` are drawn before others.

    Raises:
        InputError: a file is broken, or an output's suffix is unknown.
    """
    versions, labels = read_windows(forecasts), job.label_of
    assessed = {v: _assessed(versions[v], versions.get(f"{v}~{REFINED}")) for v in labels if v in versions}
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
        raise InputError(forecasts[0] if forecasts else "forecasts", "no version has windows", "evaluate them again")
    title = f"{job.of_experiment(versions[next(iter(assessed))].experiment)}: alarms"
    fewest = min(versions[v].sets[KNOWN].misfit.shape[1] for v in assessed)
    caption = CAPTION.format(share=f"{100 * attainable(fewest):.2g}")
    table = _table(rows, job, title, caption)
    Study(frame(Alarm, rows), [table], lambda: _draw(assessed, labels, job, title)).save(outputs)


def _draw(assessed: Mapping[str, Mapping], labels: Mapping[str, str], job: WindowStudyJob, title: str) -> Figure:
    drawable = {v: sets for v, sets in assessed.items() if v != job.floor} or assessed
    shown = _shown(drawable, job.traced)
    seed, of_test = _of_first_seed(assessed[shown])
    return draw_alarm(
        {SCORES[score]: one for score, one in of_test.items()}, f"{title} of {labels[shown]}, seed {seed}"
    )


def _shown(assessed: Mapping[str, Mapping], traced: Collection[str]) -> str:
    """The version that the figure shows: the first with most scores, of those where some forecasts fail, augmented
    models before others."""
    named = {v: Version.parse(v) for v in assessed}
    ranked = sorted(assessed, key=lambda v: (not named[v].is_augmented or bool(named[v].estimators), v not in traced))
    scores = {}
    for v in ranked:
        of_test = _of_first_seed(assessed[v])[1]
        if "misfit" in of_test and 0 < of_test["misfit"].failing.mean() < 1:
            scores[v] = len(of_test)
    return max(scores, key=scores.__getitem__) if scores else next(iter(assessed))


def _of_first_seed(assessed: Mapping[tuple[str, str, int], Assessment]) -> tuple[int, dict[str, Assessment]]:
    """A version's first seed, and its assessments on the test set by score."""
    first = next(iter(assessed))[2]
    return first, {score: one for (name, score, seed), one in assessed.items() if name == "test" and seed == first}


def _assessed(version: VersionWindows, refined: VersionWindows | None) -> dict[tuple[str, str, int], Assessment]:
    """By set, score and seed; sets that are like the training's are no shifts, but the IID test set is with each."""
    sets = version.sets
    if refined is not None and refined.seeds == version.seeds:
        moved = {name: one.moved for name, one in refined.sets.items() if one.moved is not None}
        sets = {name: replace(one, expected=moved.get(name, one.expected)) for name, one in sets.items()}
    known, iid = sets[KNOWN], sets.get(IID)
    assessed = {}
    for name, shifted in sets.items():
        if name in ("train", KNOWN):
            continue
        pool = shifted if iid is None or name == IID else _pooled(shifted, iid)
        for score in SCORES:
            for k, seed in enumerate(version.seeds):
                here, there = (_score(score, one, known, k) for one in (pool, known))
                if here is not None and there is not None:
                    errors = [_no_nan(one.errors[k]) for one in (pool, known)]
                    assessed[name, score, seed] = assess(here, errors[0], there, errors[1], attainable(len(there)))
    return assessed


def _pooled(one: WindowSet, other: WindowSet) -> WindowSet:
    hats = None
    if one.z_e_hat is not None and other.z_e_hat is not None:
        hats = np.concatenate((one.z_e_hat, other.z_e_hat), axis=1)
    expected = None
    if one.expected is not None and other.expected is not None:
        expected = np.concatenate((one.expected, other.expected), axis=1)
    return WindowSet(
        np.concatenate((one.errors, other.errors), axis=1),
        np.concatenate((one.misfit, other.misfit), axis=1),
        np.concatenate((one.z_e, other.z_e)),
        hats,
        expected=expected,
    )


def _score(score: str, windows: WindowSet, known: WindowSet, seed: int) -> np.ndarray | None:
    """A score a window, (N,); None where a version has none."""
    if score == "misfit":
        return _no_nan(windows.misfit[seed])
    if score == "expected":
        return None if windows.expected is None else _no_nan(windows.expected[seed])
    if windows.z_e_hat is None or known.z_e_hat is None:
        return None
    if score == "spread":
        scale = _no_nan(known.z_e_hat).std((0, 1)).clip(1e-12)
        spread = ensemble_spread(_no_nan(windows.z_e_hat), scale) if len(windows.z_e_hat) > 1 else None
        return spread if spread is not None and spread.any() else None  # least squares is one estimator, not several
    own = _no_nan(known.z_e_hat[seed])
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
    for (label, name), part in grouped(alarms, lambda alarm: (alarm.label, alarm.set)).items():
        of_score = grouped(part, lambda alarm: alarm.score)
        areas = [mean_of(alarm.auroc for alarm in of_score.get(score, ())) for score in SCORES]
        best = of_score.get("expected") or of_score["misfit"]
        of_best = mean_of(alarm.caught for alarm in best), mean_of(alarm.false_alarms for alarm in best)
        cells = [_text(100 * mean_of(alarm.failing for alarm in best), 1), *(_text(a, 3) for a in areas)]
        rows.append([label, titles.of_set(name), *cells, *(_text(100 * v, 1) for v in of_best)])
    return Table(header, [("", rows)], 2, (), title, caption, "alarms")


def _text(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if np.isfinite(value) else DASH

"""An alarm: which windows' forecasts are not to be trusted, from a score a window and a threshold from validation data.

Any score will do that is higher where the model explains a window badly: misfit of the observed window, χ² after
refinement, how far refinement moves the forecast (:func:`forecast_distance`), spread of an ensemble
(:func:`ensemble_spread`), minus the log density of what the encoder sees.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from expertaug.errors import InputError
from expertaug.inference.coverage import binomial_interval
from expertaug.inference.risk import RiskCoverage, risk_coverage
from expertaug.inference.roc import Area, auroc, labelled
from expertaug.inference.sample_arrays import Array, per_window, plain

FALSE_ALARMS = 0.05
FAILING = 0.99


@dataclass(frozen=True)
class Assessment:
    """What an alarm is worth on given windows.

    Attributes:
        threshold: scores above it raise the alarm.
        scores: (N,), as given.
        failing: (N,), whether the forecast fails.
        alarms: (N,), whether the score raises the alarm.
        area: under the ROC curve.
        caught: share of the failing windows with an alarm, NaN where none fails; ``caught_interval`` its 95 % interval.
        false_alarms: share of the other windows with an alarm, NaN where all fail.
        risk: error of the windows kept.
    """

    threshold: float
    scores: np.ndarray
    failing: np.ndarray
    alarms: np.ndarray
    area: Area
    caught: float
    caught_interval: tuple[float, float]
    false_alarms: float
    risk: RiskCoverage


def threshold(validation_scores: Array, false_alarms: float = FALSE_ALARMS) -> float:
    """The score above which a new window raises the alarm, though it is like the validation windows, in at most this
    share of cases.

    It is the conformal quantile: the k-th smallest of n scores, k = ⌈(n + 1)(1 − false alarms)⌉, whose guarantee holds
    for any distribution of scores, on the average over validation sets (Vovk et al. 2005).

    Arguments:
        validation_scores: (n,).
        false_alarms: between 0 and 1.

    Raises:
        InputError: too few validation windows, or a score that is NaN.
    """
    scores = np.sort(plain(validation_scores, "validation_scores", infinite=True).ravel())
    if not 0 < false_alarms < 1:
        raise InputError("false_alarms", f"found {false_alarms!r}", "give a share between 0 and 1, as 0.05")
    k = int(np.ceil((len(scores) + 1) * (1 - false_alarms) - 1e-9))
    if k > len(scores):
        least = int(np.ceil(1 / false_alarms - 1 - 1e-9))
        raise InputError("validation_scores", f"of {len(scores)} windows", f"{false_alarms:g} needs at least {least}")
    return float(scores[k - 1])


def attainable(windows: int, false_alarms: float = FALSE_ALARMS) -> float:
    """The share of false alarms that a threshold from so many validation windows can promise: this one, or, where it
    takes more windows, the smallest that they can, with their largest score as threshold."""
    return max(false_alarms, 1 / (windows + 1))


def failing(errors: Array, validation_errors: Array, quantile: float = FAILING) -> np.ndarray:
    """Which forecasts fail: their squared error is above this quantile of the validation set's.

    Arguments:
        errors: (N,), which may be infinite.
        validation_errors: (n,).
        quantile: between 0 and 1.

    Returns:
        (N,), bool.

    Raises:
        InputError: a value is NaN, or the quantile is none.
    """
    if not 0 < quantile < 1:
        raise InputError("quantile", f"found {quantile!r}", "give a number between 0 and 1, as 0.99")
    known = plain(validation_errors, "validation_errors", infinite=True).ravel()
    return plain(errors, "errors", infinite=True) > np.quantile(known, quantile, method="higher")


def assess(
    scores: Array,
    errors: Array,
    validation_scores: Array,
    validation_errors: Array,
    false_alarms: float = FALSE_ALARMS,
    quantile: float = FAILING,
) -> Assessment:
    """How well a score tells which forecasts fail.

    Threshold and what counts as failing come from the validation windows alone; everything else is measured on the
    given windows.  Where all of a shifted set fail, give it together with windows like the training's.

    Arguments:
        scores, errors: (N,).
        validation_scores, validation_errors: (n,).
        false_alarms: see :func:`threshold`.
        quantile: see :func:`failing`.

    Raises:
        InputError: the shapes disagree, a value is NaN, or validation windows are too few.
    """
    score, error = (plain(v, name, infinite=True) for v, name in ((scores, "scores"), (errors, "errors")))
    per_window(score, error, "scores and errors")
    limit = threshold(validation_scores, false_alarms)
    bad, alarms = failing(error, validation_errors, quantile), score > limit
    share, interval = caught(score, bad, limit)
    return Assessment(
        threshold=limit,
        scores=score,
        failing=bad,
        alarms=alarms,
        area=auroc(score, bad),
        caught=share,
        caught_interval=interval,
        false_alarms=float(alarms[~bad].mean()) if not bad.all() else np.nan,
        risk=risk_coverage(score, error),
    )


def caught(scores: Array, failing: Array, threshold: float) -> tuple[float, tuple[float, float]]:
    """The share of failing windows whose score is above the threshold, and its 95 % interval (Clopper and Pearson).

    Arguments:
        scores, failing: (N,).
        threshold: of :func:`threshold`.

    Returns:
        share and interval, NaN where no window fails.

    Raises:
        InputError: the shapes disagree, or a score is NaN.
    """
    score, bad = labelled(scores, failing)
    if not bad.any():
        return np.nan, (np.nan, np.nan)
    count, n = int((score[bad] > threshold).sum()), int(bad.sum())
    lower, upper = binomial_interval(np.array(count), n)
    return count / n, (float(lower), float(upper))


def ensemble_spread(estimates: Array, scale: Array | float = 1.0) -> np.ndarray:
    """How much the members of an ensemble disagree on each window: the score that an ensemble gives for free.

    Arguments:
        estimates: of S ≥ 2 seeds, (S, N, …): parameters (S, N, P), or forecasts (S, N, T, D).
        scale: what the components are divided by, as parameters of different units need it; broadcast to (…).

    Returns:
        (N,), root mean square, over all components, of the standard deviation over seeds.

    Raises:
        InputError: fewer than two seeds, a value that is not finite, or a scale that is not positive.
    """
    given, unit = plain(estimates, "estimates"), plain(scale, "scale")
    if given.ndim < 2 or len(given) < 2:
        raise InputError("estimates", f"have shape {given.shape}", "give (S, N, …) of at least two seeds")
    if (unit <= 0).any():
        raise InputError("scale", f"found {unit.min():g}", "give positive numbers")
    variance = np.var(given / unit, axis=0, ddof=1)
    return np.sqrt(variance.reshape(given.shape[1], -1).mean(1))


def forecast_distance(forecasts: Array, refined: Array, scale: Array | float = 1.0) -> np.ndarray:
    """How far two forecasts of each window are apart: of a fast one and its refined version, what the fast one's error
    would be if the refined one were right.

    Arguments:
        forecasts, refined: (N, T, …), of the same windows and times; they may be infinite.
        scale: what the components are divided by; broadcast to (…).

    Returns:
        (N,), mean square over times and components.

    Raises:
        InputError: the shapes disagree, a value is NaN, or a scale that is not positive.
    """
    one, other = (plain(v, name, infinite=True) for v, name in ((forecasts, "forecasts"), (refined, "refined")))
    unit = plain(scale, "scale")
    if one.shape != other.shape or one.ndim < 2:
        raise InputError("refined", f"has shape {other.shape}", f"give that of the forecasts, {one.shape}, (N, T, …)")
    if (unit <= 0).any():
        raise InputError("scale", f"found {unit.min():g}", "give positive numbers")
    both = np.isfinite(one) & np.isfinite(other)
    squares = np.where(both, np.square((np.where(both, one, 0) - np.where(both, other, 0)) / unit), np.inf)
    return squares.reshape(len(one), -1).mean(1)

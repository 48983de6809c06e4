"""Alarms: which windows' forecasts are not to be trusted, from a score a window and a threshold from validation data.

Any score will do that is higher where the model explains a window badly: misfit of the observed window, χ² after
refinement, how far refinement moves the forecast (:func:`forecast_distance`), spread of an ensemble
(:func:`ensemble_spread`), minus the log density of what the encoder sees.  What it is worth say the ROC curve and the
area under it (with an interval), and the risk that is left when the most suspicious windows are refused (El-Yaniv &
Wiener 2010).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import norm, rankdata

from expertaug.errors import InputError
from expertaug.inference.diagnostics.arrays import Array, per_window, plain
from expertaug.inference.diagnostics.calibration import binomial_interval

FALSE_ALARMS = 0.05
FAILING = 0.99


@dataclass(frozen=True)
class Area:
    """The area under a ROC curve: the probability that a failing window has the higher score, ties counting half.

    Attributes:
        value: 0.5 for a score that says nothing; NaN where no window fails, or all do.
        lower, upper: its 95 % interval; NaN where fewer than two windows fail, or all but fewer than two do.
        failing, others: numbers of windows.
    """

    value: float
    lower: float
    upper: float
    failing: int
    others: int


def auroc(scores: Array, failing: Array, confidence: float = 0.95) -> Area:
    """Area under the ROC curve, with DeLong, DeLong & Clarke-Pearson's (1988) variance on the logit scale.

    Where the score separates all windows that variance is 0; the interval is then the exact one of as many independent
    pairs as there are of the rarer kind, which is wide where they are few.

    Arguments:
        scores: (N,), higher means more suspicious; infinite ones are ordered like others.
        failing: (N,), whether the window's forecast fails.
        confidence: of the interval.

    Raises:
        InputError: the shapes disagree, or a score is NaN.
    """
    score, bad = label_failing(scores, failing)
    m, n = int(bad.sum()), int((~bad).sum())
    if not m or not n:
        return Area(np.nan, np.nan, np.nan, m, n)
    # Of each failing window the share of others below it, and the reverse: their means are the area.
    whole = rankdata(score)
    below = (whole[bad] - rankdata(score[bad])) / n
    above = 1 - (whole[~bad] - rankdata(score[~bad])) / m
    value = float(below.mean())
    if min(m, n) < 2:
        return Area(value, np.nan, np.nan, m, n)
    variance = below.var(ddof=1) / m + above.var(ddof=1) / n
    if variance == 0 and value in (0.0, 1.0):
        least = ((1 - confidence) / 2) ** (1 / min(m, n))
        lower, upper = (least, 1.0) if value == 1.0 else (0.0, 1 - least)
    elif variance == 0:  # all scores are equal
        lower = upper = value
    else:
        half = norm.ppf(0.5 + confidence / 2) * np.sqrt(variance) / (value * (1 - value))
        logit = np.log(value / (1 - value))
        lower, upper = (1 / (1 + np.exp(-(logit + side))) for side in (-half, half))
    return Area(value, float(lower), float(upper), m, n)


def roc(scores: Array, failing: Array) -> tuple[np.ndarray, np.ndarray]:
    """The ROC curve: shares of the other windows and of the failing ones at or above each score, from (0, 0) to (1, 1).

    Arguments:
        scores, failing: as for :func:`auroc`.

    Returns:
        false alarms and caught, (M,) both, M − 1 the number of different scores.

    Raises:
        InputError: as :func:`auroc`, or no window fails, or all do.
    """
    score, bad = label_failing(scores, failing)
    if bad.all() or not bad.any():
        raise InputError("failing", f"{bad.sum()} of {len(bad)} windows", "a ROC curve needs failing ones and others")
    steps = np.unique(score)[::-1]
    shares = []
    for part in (score[~bad], score[bad]):
        at_least = len(part) - np.searchsorted(np.sort(part), steps, side="left")
        shares.append(np.concatenate([[0.0], at_least / len(part)]))
    return shares[0], shares[1]


def label_failing(scores: Array, failing: Array) -> tuple[np.ndarray, np.ndarray]:
    """Scores (N,) and, as booleans (N,), which windows fail.

    Raises:
        InputError: the shapes disagree, a score is NaN, or ``failing`` is no yes or no.
    """
    score, bad = plain(scores, "scores", infinite=True), plain(failing, "failing")
    per_window(score, bad, "scores and failing")
    if not np.isin(bad, (0.0, 1.0)).all():
        raise InputError("failing", f"has the value {bad[~np.isin(bad, (0.0, 1.0))][0]:g}", "give true or false")
    return score, bad.astype(bool)


@dataclass(frozen=True)
class RiskCoverage:
    """Mean error of the windows kept.

    Attributes:
        kept: shares of the windows, 1/N … 1, (N,).
        risk: mean error of those with the lowest scores, (N,); the last is the mean of all.
        best: the same for a score that orders windows by their error, (N,).
    """

    kept: np.ndarray
    risk: np.ndarray
    best: np.ndarray

    @property
    def area(self) -> float:
        """Mean risk over all shares kept: AURC."""
        return float(self.risk.mean())

    @property
    def best_area(self) -> float:
        """The area that no score can fall below."""
        return float(self.best.mean())


def risk_coverage(scores: Array, errors: Array) -> RiskCoverage:
    """Mean error of the windows kept as the most suspicious are refused.

    Windows of equal score are refused in no order: each counts with the mean error of all of them.

    Arguments:
        scores: (N,), higher means more suspicious; they may be infinite.
        errors: (N,), as the squared error of the forecast, which may be infinite.

    Raises:
        InputError: the shapes disagree, or a value is NaN.
    """
    score, error = (plain(v, name, infinite=True) for v, name in ((scores, "scores"), (errors, "errors")))
    per_window(score, error, "scores and errors")
    _, group, size = np.unique(score, return_inverse=True, return_counts=True)
    alike = np.zeros(len(size))
    np.add.at(alike, group, error)
    count = np.arange(1, len(error) + 1)
    kept_error = (alike / size)[np.sort(group)]
    return RiskCoverage(count / len(error), np.cumsum(kept_error) / count, np.cumsum(np.sort(error)) / count)


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
    reference = plain(validation_errors, "validation_errors", infinite=True).ravel()
    return plain(errors, "errors", infinite=True) > np.quantile(reference, quantile, method="higher")


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
    score, bad = label_failing(scores, failing)
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
    members, unit = plain(estimates, "estimates"), plain(scale, "scale")
    if members.ndim < 2 or len(members) < 2:
        raise InputError("estimates", f"have shape {members.shape}", "give (S, N, …) of at least two seeds")
    if (unit <= 0).any():
        raise InputError("scale", f"found {unit.min():g}", "give positive numbers")
    variance = np.var(members / unit, axis=0, ddof=1)
    return np.sqrt(variance.reshape(members.shape[1], -1).mean(1))


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
    fast, other = (plain(v, name, infinite=True) for v, name in ((forecasts, "forecasts"), (refined, "refined")))
    unit = plain(scale, "scale")
    if fast.shape != other.shape or fast.ndim < 2:
        raise InputError("refined", f"has shape {other.shape}", f"give that of the forecasts, {fast.shape}, (N, T, …)")
    if (unit <= 0).any():
        raise InputError("scale", f"found {unit.min():g}", "give positive numbers")
    both = np.isfinite(fast) & np.isfinite(other)
    squares = np.where(both, np.square((np.where(both, fast, 0) - np.where(both, other, 0)) / unit), np.inf)
    return squares.reshape(len(fast), -1).mean(1)

"""How well a score tells windows apart whose forecast fails: ROC curve, and the area under it with an interval."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import norm, rankdata

from expertaug.errors import InputError
from expertaug.inference.sample_arrays import Array, per_window, plain


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
    score, bad = labelled(scores, failing)
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
    score, bad = labelled(scores, failing)
    if bad.all() or not bad.any():
        raise InputError("failing", f"{bad.sum()} of {len(bad)} windows", "a ROC curve needs failing ones and others")
    steps = np.unique(score)[::-1]
    found = []
    for part in (score[~bad], score[bad]):
        at_least = len(part) - np.searchsorted(np.sort(part), steps, side="left")
        found.append(np.concatenate([[0.0], at_least / len(part)]))
    return found[0], found[1]


def labelled(scores: Array, failing: Array) -> tuple[np.ndarray, np.ndarray]:
    """Scores (N,) and, as booleans (N,), which windows fail.

    Raises:
        InputError: the shapes disagree, a score is NaN, or ``failing`` is no yes or no.
    """
    score, bad = plain(scores, "scores", infinite=True), plain(failing, "failing")
    per_window(score, bad, "scores and failing")
    if not np.isin(bad, (0.0, 1.0)).all():
        raise InputError("failing", f"has the value {bad[~np.isin(bad, (0.0, 1.0))][0]:g}", "give true or false")
    return score, bad.astype(bool)

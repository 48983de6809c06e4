"""Whether a model explains windows to within their noise, and which of several models does so best.

What alarms say is relative: a window is explained as well as those of the validation set.  A wrong equation explains
all of them badly, so these tests are absolute: χ² against its distribution, and forecasts of what was held out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import binom, wilcoxon
from scipy.stats import chi2 as chi2_distribution

from expertaug.errors import InputError
from expertaug.inference.diagnostics.arrays import Array, plain

LEVEL = 0.01  # probability of a verdict against a model that is right
TOLERANCE = 0.1  # of χ² per degree of freedom: a noise that is known to 5 %
TOO_SMALL = 0.5  # χ² per degree of freedom of windows together, below which the noise is stated too large
STRONG = 10.0  # difference of the information criterion that decides (Kass & Raftery 1995: "very strong")
LARGEST = 1e6  # of an error in units of the noise: what is beyond is as bad


@dataclass(frozen=True)
class Goodness:
    """The χ² test of a model on N windows.

    Attributes:
        p: of each window, the probability of so large a χ² under the model and its noise, (N,).
        chi2: per degree of freedom, of all windows together.
        p_together: the same probability for all windows together.
        explains: whether the model explains the windows to within their noise.
        too_well: whether it does so far better than that, which says that the noise is stated too large.
    """

    p: np.ndarray
    chi2: float
    p_together: float
    explains: bool
    too_well: bool = False

    @property
    def says(self) -> str:
        """One sentence."""
        if self.too_well:
            return f"the model explains these windows far better than their noise allows (χ² {self.chi2:.3g}, not 1)"
        if self.explains:
            return f"the model explains these windows to within their noise (χ² {self.chi2:.3g} per degree of freedom)"
        return f"the model does not explain these windows to within their noise (χ² {self.chi2:.3g}, not 1)"


def goodness_of_fit(chi2: Array, dof: Array | int, independent: int | None = None) -> Goodness:
    """Test fits of windows by χ² (Fisher 1922), with the noise that was stated.

    A χ² of all windows together within 10 % of 1 is not held against a model, however many they are: the noise is
    hardly known better.

    Arguments:
        chi2: per degree of freedom, of each window, (N,); infinite where a fit has failed.
        dof: degrees of freedom of each window, (N,), or of all: observed numbers less fitted ones.
        independent: how many of the windows count, where some overlap or follow each other; None: all.

    Raises:
        InputError: no window, or one without a degree of freedom.
    """
    values = plain(chi2, "chi2", infinite=True)
    freedom = np.broadcast_to(plain(dof, "dof"), values.shape)
    if not len(values) or freedom.min() < 1:
        problem = f"{len(values)} windows" if not len(values) else f"{freedom.min():g} degrees of freedom"
        raise InputError("dof", problem, "give fewer parameters or longer windows")
    total = float((np.minimum(values, LARGEST) * freedom).sum() / freedom.sum())
    together = freedom.sum() * (len(values) if independent is None else independent) / len(values)
    p_together = float(chi2_distribution.sf(total * together, together))
    explains = p_together >= LEVEL or total <= 1 + TOLERANCE
    p = chi2_distribution.sf(values * freedom, freedom)
    return Goodness(p, total, p_together, bool(explains), is_too_small(total, together))


def is_too_small(chi2: float, dof: float) -> bool:
    """Whether a χ² per degree of freedom is so far below 1, and that by no chance, that the noise is stated too large.

    Arguments:
        chi2: of all windows together.
        dof: their degrees of freedom in sum.
    """
    return chi2 < TOO_SMALL and float(chi2_distribution.cdf(chi2 * dof, dof)) < LEVEL


def find_unexplained(chi2: Array, dof: Array | int) -> np.ndarray:
    """Windows (N,) that a model does not explain to within their noise, where there are more of them than chance makes.

    A window counts whose χ² has a probability below 1 % with a noise 5 % larger than stated; of N windows that a right
    model made so many are expected to be one in a hundred, and none is named while their number is no surprise.

    Arguments:
        chi2: per degree of freedom, of each window, (N,); infinite where a fit has failed.
        dof: degrees of freedom of each window, (N,), or of all.
    """
    values = plain(chi2, "chi2", infinite=True)
    freedom = np.broadcast_to(plain(dof, "dof"), values.shape)
    beyond = chi2_distribution.sf(values * freedom / (1 + TOLERANCE), freedom) < LEVEL
    surprise = binom.sf(beyond.sum() - 1, len(beyond), LEVEL)
    return beyond if surprise < LEVEL else np.zeros_like(beyond)


@dataclass(frozen=True)
class Candidate:
    """What is known of one of several models.

    Attributes:
        held_out: mean squared error of each window's held-out part, in units of the noise, (N,).
        chi2: per degree of freedom, of fits of the whole windows, (N,).
        observations: numbers that were measured of each window, (N,).
        parameters: numbers that are fitted to a window.
        overdispersion: of its residuals: how much more, for their size and correlation, than as many independent ones
            of the noise that was stated.
    """

    held_out: np.ndarray
    chi2: np.ndarray
    observations: np.ndarray
    parameters: int
    overdispersion: float = 1.0

    @property
    def dof(self) -> np.ndarray:
        """Degrees of freedom of each window, (N,)."""
        return self.observations - self.parameters

    def criterion(self, overdispersion: float) -> float:
        """The Bayesian information criterion (Schwarz 1978) of a window with known noise, their mean; χ² counts for so
        many times less (the quasi-likelihood of Lebreton et al. 1992)."""
        each = np.minimum(self.chi2, LARGEST) * self.dof / overdispersion
        return float((each + self.parameters * np.log(self.observations)).mean())


@dataclass(frozen=True)
class Choice:
    """Which of several models windows speak for.

    Attributes:
        score: of each model, mean over windows of the log of the held-out error in units of the noise; near 0 where
            forecasts are as good as the noise allows.
        behind: median over windows of how much higher that is than the best model's.
        p: two-sided probability of such differences if neither were better (Wilcoxon 1945); 1 of the best itself.
        criterion: information criterion, less the least one.
        goodness: χ² test of each.
        as_good: models that are not told apart from the best by their forecasts.
        chosen: the one that the windows speak for; None where they do not tell.
    """

    score: dict[str, float]
    behind: dict[str, float]
    p: dict[str, float]
    criterion: dict[str, float]
    goodness: dict[str, Goodness]
    as_good: list[str]
    chosen: str | None

    @property
    def says(self) -> str:
        """One sentence."""
        if self.chosen is None:
            return f"these windows do not decide between {' and '.join(self.as_good)}"
        goodness = self.goodness[self.chosen]
        beyond = "" if goodness.explains else ", but does not explain them to within their noise"
        if goodness.too_well:
            beyond = f"; their noise seems stated too large (χ² {goodness.chi2:.2g}, not 1)"
        return f"these windows speak for {self.chosen}{beyond}"


def choose(candidates: Mapping[str, Candidate], groups: Sequence | np.ndarray | None = None) -> Choice:
    """Choose between models by forecasts of held-out parts of windows; among those that forecast as well, by the
    information criterion where it is decisive.

    A larger model that contains the right one forecasts hardly worse than it: forecasts cannot tell them apart, and the
    criterion charges the larger one for its parameters.

    Arguments:
        candidates: by name, all of the same N windows.
        groups: (N,), windows of one group (a trajectory, a stretch of one) count as one; None: all are independent.

    Raises:
        InputError: fewer than two models, or different numbers of windows.
    """
    sizes = {len(candidate.held_out) for candidate in candidates.values()}
    if len(candidates) < 2 or len(sizes) != 1 or 0 in sizes:
        raise InputError(
            "experts", f"{len(candidates)} with {sorted(sizes)} windows", "give two or more, of the same windows"
        )
    logs = {name: _by_group(_log(candidate.held_out), groups) for name, candidate in candidates.items()}
    score = {name: float(value.mean()) for name, value in logs.items()}
    best = min(score, key=lambda name: score[name])
    independent = len(logs[best])
    behind = {name: float(np.median(value - logs[best])) for name, value in logs.items()}
    p = {name: 1.0 if name == best else _p(value - logs[best]) for name, value in logs.items()}
    least_over = min(candidate.overdispersion for candidate in candidates.values())  # of the model that explains most
    criteria = {name: independent * candidate.criterion(least_over) for name, candidate in candidates.items()}
    least = min(criteria.values())
    criterion = {name: value - least for name, value in criteria.items()}
    as_good = sorted((name for name in candidates if p[name] >= LEVEL), key=lambda name: criterion[name])
    decided = len(as_good) == 1 or criterion[as_good[1]] - criterion[as_good[0]] >= STRONG
    goodness = {
        name: goodness_of_fit(candidate.chi2, candidate.dof, independent) for name, candidate in candidates.items()
    }
    return Choice(score, behind, p, criterion, goodness, as_good, as_good[0] if decided else None)


def _log(errors: np.ndarray) -> np.ndarray:
    return np.log(np.clip(np.nan_to_num(errors, nan=LARGEST, posinf=LARGEST), 1 / LARGEST, LARGEST))


def _by_group(values: np.ndarray, groups: Sequence | np.ndarray | None) -> np.ndarray:
    if groups is None:
        return values
    names, place = np.unique(np.asarray(groups), return_inverse=True)
    return np.bincount(place, values, len(names)) / np.bincount(place, minlength=len(names))


def _p(differences: np.ndarray) -> float:
    return 1.0 if not differences.any() else float(wilcoxon(differences).pvalue)

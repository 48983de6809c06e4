"""Which terms: forward on normal equations with windows' own unknowns eliminated, backward by validation, the choice.

A greedy path fits what it was chosen on, and pairs that cancel each other extrapolate badly; so every formula on it is
refitted through the solver, terms are taken away again by the error of validation forecasts, and of formulas that are
as good within one standard error the shortest is chosen (Breiman et al. 1984)."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from expertaug.equation.shooting import Fit, Formula, Guess, Sample, Shooting, criterion
from expertaug.inference.joint_fit import NormalEquations, eliminate
from expertaug.models.terms import Term, quantities
from expertaug.systems.inputs import inputs_of, states_of

logger = logging.getLogger(__name__)
BEAM = 3  # of the most promising further terms that are tried through the solver
PATIENCE = 3  # terms that make validation forecasts no better, after which none is added
ROUNDS = 3  # of exchanges
SAME = 1e-6  # of a term's curvature that is left once others are fitted: below it they say the same
SIGNIFICANT = 3.0  # standard errors of a coefficient, below which the training windows do not call for its term
TINY = 1e-9  # of F_a's square: what is left then is rounding


@dataclass(frozen=True)
class Tried:
    """A formula that was refitted, and its forecasts of the validation windows.

    Attributes:
        fit: to the training windows.
        errors: squared error of each validation window, (N,).
        source: whence it was proposed.
        significance: of the weakest coefficient that all windows share, in its standard errors; infinite without one.
    """

    fit: Fit
    errors: np.ndarray
    source: str
    significance: float

    @property
    def formula(self) -> Formula:
        return self.fit.formula

    @property
    def score(self) -> float:
        """Mean squared error."""
        return float(np.nanmean(self.errors)) if np.isfinite(self.errors).any() else math.inf


@dataclass(frozen=True)
class Candidates:
    """What a linear problem says of terms that may be added.

    Attributes:
        equations: normal equations, (N, K, K).
        base: places of coordinates that are fitted in any case, and whether windows share each.
        terms: and their places.
    """

    equations: NormalEquations
    base: tuple[tuple[int, bool], ...]
    terms: tuple[tuple[Term, int], ...]

    def gains(self) -> list[tuple[float, Term, bool]]:
        """By how much each further term lowers the sum of squares, with one coefficient and with one a window."""
        own = [k for k, shared in self.base if not shared]
        held = [k for k, shared in self.base if shared]
        new = [k for _, k in self.terms]
        chosen = [*own, *held, *new]
        part = _scale(self.equations.of(chosen), len(own))
        places = list(range(len(own), len(chosen)))
        curvature, slope, *_ = eliminate(part, places, 0.0)
        raw = part.curvature.diagonal(dim1=1, dim2=2)[:, places]
        count = len(held)
        # One for all windows: what all of them say together, once what they share is fitted.
        total, left = curvature.sum(0), slope.sum(0)
        inner = total[:count, :count] + 1e-12 * torch.eye(count, dtype=total.dtype) * total.diagonal().amax()
        follow = torch.linalg.solve(inner, total[:count, count:])
        weight = total.diagonal()[count:] - (total[:count, count:] * follow).sum(0)
        pull = left[count:] - follow.mT @ left[:count]
        of_all = torch.where(weight > SAME * raw.sum(0)[count:], pull.square() / weight.clamp_min(1e-30), 0.0)
        # One a window: what each says.
        each = curvature.diagonal(dim1=1, dim2=2)[:, count:]
        determined = each > SAME * raw[:, count:]
        of_each = torch.where(determined, slope[:, count:].square() / each.clamp_min(1e-30), 0.0).sum(0)
        shared_gains = [(float(of_all[k]), term, True) for k, (term, _) in enumerate(self.terms)]
        return shared_gains + [(float(of_each[k]), term, False) for k, (term, _) in enumerate(self.terms)]


def _scale(equations: NormalEquations, own: int) -> NormalEquations:
    """The same with coordinates in units of what tells them, the first ``own`` window by window: rounding then leaves
    little of two terms that say the same, and precise data tell others apart that are nearly alike."""
    each = equations.curvature.diagonal(dim1=1, dim2=2)
    information = torch.cat((each[:, :own], each[:, own:].sum(0).expand(len(each), -1)), dim=1)
    unit = torch.where(information > 0, information, 1.0).rsqrt()
    curvature = equations.curvature * unit.unsqueeze(-1) * unit.unsqueeze(-2)
    return NormalEquations(equations.cost, curvature, equations.slope * unit)


def forward(
    shooting: Shooting,
    start: Tried,
    library: Sequence[Term],
    sample: Sample,
    most: int,
    judge: Callable[[Fit], Tried],
) -> list[Tried]:
    """Formulas of one term, of two, …: each time the further term that lowers the criterion most, of the few that the
    normal equations at the last formula find most promising; until none lowers it, or validation forecasts have not
    become better for a while.

    Arguments:
        start: without a term.
        most: terms.
        judge: forecasts of the validation windows.
    """
    path, best = [start], start
    while len(path) <= most and len(path) - path.index(best) <= PATIENCE:
        now = path[-1].fit
        trials = [
            shooting.fit(now.formula.plus(t, s), now.guess, sample) for t, s in further(shooting, now, library, sample)
        ]
        chosen = min(trials, key=lambda fit: fit.criterion, default=now)
        if chosen.criterion >= now.criterion:
            break
        judged = {fit.formula: judge(fit) for fit in trials if fit.criterion < now.criterion}
        path.append(judged[chosen.formula])
        best = min(best, path[-1], key=lambda candidate: candidate.score)
        logger.info("equation: %s, validation %.3g", chosen.formula, path[-1].score)
    return path


def further(shooting: Shooting, now: Fit, library: Sequence[Term], sample: Sample) -> list[tuple[Term, bool]]:
    """The few terms that the normal equations at a fit find most promising, and whether windows share each."""
    left = [term for term in library if term not in now.formula.terms]
    if not left:
        return []
    own, count = len(shooting.system.expert_parameters), len(now.formula.terms)
    equations = shooting.linearise(now, left, sample)
    first = own + count + len(left)
    base = [(k, k in shooting.places(now.formula)) for k in range(own + count)]
    base += [(k, False) for k in range(first, equations.slope.shape[1])]
    of_terms = tuple((term, own + count + k) for k, term in enumerate(left))
    return _rank(Candidates(equations, tuple(base), of_terms).gains(), now, shooting.own)[:BEAM]


def exchange_terms(
    shooting: Shooting,
    chosen: Tried,
    library: Sequence[Term],
    sample: Sample,
    attempt: Callable[[Formula, Guess], Tried],
) -> None:
    """The chosen formula with each of its terms exchanged for one of the few that are most promising in its place; and
    one of which each window has its own coefficient for what may be the same with one of all windows."""
    formula, guess = chosen.formula, chosen.fit.guess
    for k, (term, shared) in enumerate(zip(formula.terms, formula.shared, strict=True)):
        rest = attempt(formula.without(k), guess)
        for other, common in further(shooting, rest.fit, library, sample):
            attempt(rest.formula.plus(other, common), rest.fit.guess)
        for other, value in [] if shared else alike(shooting, chosen.fit, term, library, sample):
            start = {**guess.coefficients, other: torch.full((sample.count,), value, dtype=torch.float64)}
            attempt(rest.formula.plus(other, True), Guess(guess.z_e, guess.y0, start))


def alike(
    shooting: Shooting, fit: Fit, term: Term, library: Sequence[Term], sample: Sample
) -> list[tuple[Term, float]]:
    """The few terms that with one coefficient are most like a term with a fit's coefficients of each window, along the
    observed states; and these coefficients."""
    system, y = shooting.system, states_of(shooting.system, sample.windows)[:, 0]
    u = inputs_of(system, sample.windows)
    values = quantities(system, y, fit.guess.z_e.expand(len(y), -1, -1), None if u is None else u[:, 0])
    own = fit.guess.coefficients[term].view(-1, *[1] * (len(system.state_shape) - 1))
    aim, matches = (own * term.value(values)).nan_to_num(), []
    for k, other in enumerate(library):
        if other.rate != term.rate or other in fit.formula.terms:
            continue
        column = other.value(values).nan_to_num()
        both, size = float((aim * column).sum()), float(column.square().sum())
        if size > 0:
            matches.append((-(both**2) / size, k, both / size))
    return [(library[k], value) for _, k, value in sorted(matches)[:BEAM]]


def _rank(gains: Sequence[tuple[float, Term, bool]], now: Fit, own: bool) -> list[tuple[Term, bool]]:
    """Terms and whether they are shared, the most promising first; none that promises nothing."""
    windows = len(now.equations.cost)
    each = sorted(
        (criterion(max(now.cost - gain, 0.0), now.numbers, 1 if shared else windows, now.least), -gain, k)
        for k, (gain, _, shared) in enumerate(gains)
        if gain > 0 and (shared or own)
    )
    return [(gains[k][1], gains[k][2]) for _, _, k in each]


def by_regression(columns: Candidates, numbers: int, most: int, own: bool) -> list[Formula]:
    """Formulas of one term, of two, … of a linear problem, as F_a's values at states that were visited; with ``own`` a
    coefficient may be each window's own."""
    formula, formulas, now = Formula(), [], columns
    windows, cost = len(columns.equations.cost), float(columns.equations.cost.sum())
    scale = max(cost, 1e-300) / numbers  # in units of what is to be explained
    places = dict(columns.terms)
    while len(formulas) < most and now.terms:
        remaining = remainder(columns, formula, places)
        best = min(
            (
                (criterion((remaining - gain) / scale, numbers, 1 if s else windows, TINY), -gain, t, s)
                for gain, t, s in now.gains()
                if gain > 0 and (s or own)
            ),
            key=lambda candidate: candidate[:2],
            default=None,
        )
        if best is None or best[0] >= criterion(remaining / scale, numbers, 0, TINY):
            break
        formula = formula.plus(best[2], best[3])
        formulas.append(formula)
        now = condition(columns, formula, places)
    return formulas


def condition(columns: Candidates, formula: Formula, places: dict[Term, int]) -> Candidates:
    """The same once a formula's terms are fitted in any case."""
    more = tuple((places[t], s) for t, s in zip(formula.terms, formula.shared, strict=True))
    equations = columns.equations
    base = (*columns.base, *more)
    solution = solve_base(equations, base)
    k = [place for place, _ in base]
    part = (equations.curvature[:, :, k] @ solution.unsqueeze(-1)).squeeze(-1)
    slope = equations.slope - part
    cost = equations.cost - (2 * equations.slope[:, k] * solution).sum(1)
    cost = cost + (solution.unsqueeze(1) @ equations.curvature[:, k][:, :, k] @ solution.unsqueeze(-1)).flatten()
    left = tuple((t, place) for t, place in columns.terms if t not in formula.terms)
    return Candidates(NormalEquations(cost, equations.curvature, slope), base, left)


def remainder(columns: Candidates, formula: Formula, places: dict[Term, int]) -> float:
    """Sum of squares that a formula leaves of a linear problem."""
    return float(condition(columns, formula, places).equations.cost.sum())


def solve_base(equations: NormalEquations, base: Sequence[tuple[int, bool]]) -> Tensor:
    """Coefficients (N, len(base)) that fit best, in the order of ``base``."""
    if not base:
        return equations.slope[:, :0]
    order = [k for k, _ in base]
    part = NormalEquations(equations.cost, equations.curvature[:, order][:, :, order], equations.slope[:, order])
    places = [k for k, (_, shared) in enumerate(base) if shared]
    reduced, left, follow, rest, own = eliminate(part, places, 0.0)
    total = reduced.sum(0)
    shared = torch.linalg.solve(
        total + 1e-12 * torch.eye(len(places), dtype=total.dtype) * total.diagonal().sum().clamp_min(1e-30),
        left.sum(0),
    )
    coefficients = torch.zeros_like(part.slope)
    coefficients[:, places] = shared
    coefficients[:, own] = rest - follow @ shared
    return coefficients


def backward(attempt: Callable[[Formula, Guess], Tried], last: Tried) -> None:
    """From a formula, one term less at a time: each time that without which validation forecasts are best; or one
    window's own coefficient less, where all windows may share it."""
    now = last
    while now.formula.terms:
        formulas = [now.formula.without(k) for k in range(len(now.formula.terms))]
        formulas += [now.formula.sharing(k) for k, shared in enumerate(now.formula.shared) if not shared]
        trials = [attempt(formula, now.fit.guess) for formula in formulas]
        now = min((t for t in trials if t.formula.freedom(2) < now.formula.freedom(2)), key=lambda t: t.score)
        logger.info("equation: %s, validation %.3g", now.formula, now.score)


@dataclass(frozen=True)
class Choice:
    """What validation says.

    Attributes:
        chosen: the shortest formula within one standard error of the best.
        ties: others within it.
    """

    chosen: Tried
    ties: tuple[Tried, ...]


def choose(tried: Sequence[Tried], groups: np.ndarray, tolerance: float) -> Choice:
    """By the one-standard-error rule among formulas without a coefficient that may be zero; windows of a group count as
    one.

    Arguments:
        tried: formulas on the same validation windows.
        groups: of these windows, (N,).
        tolerance: squared error that is as good as none.
    """
    tried = [candidate for candidate in tried if candidate.significance >= SIGNIFICANT]
    best = min(tried, key=lambda candidate: candidate.score)
    near = [candidate for candidate in tried if within(candidate.errors, best.errors, groups, tolerance)]
    chosen = min(near, key=lambda candidate: (candidate.formula.freedom(2), candidate.formula.length, candidate.score))
    return Choice(chosen, tuple(candidate for candidate in near if candidate is not chosen))


def within(errors: np.ndarray, best: np.ndarray, groups: np.ndarray, tolerance: float) -> bool:
    """Whether errors (N,) are in the mean no more than one standard error of the difference above the best's (N,)."""
    behind = errors - best
    finite = np.isfinite(behind)
    if not finite.any():
        return False
    mean, behind, groups = behind[finite].mean(), behind[finite], groups[finite]
    sums = np.array([(behind[groups == g] - mean).sum() for g in np.unique(groups)])
    count = len(sums)
    error = math.sqrt(float((sums**2).sum()) * count / max(count - 1, 1)) / len(behind)
    return float(mean) <= max(error, tolerance)

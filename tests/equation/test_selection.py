"""Terms are chosen by what they explain, window by window or of all, and of formulas that are as good the shortest."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import torch

from expertaug.equation import selection
from expertaug.equation.selection import Candidates, Tried
from expertaug.equation.shooting import Formula
from expertaug.inference.joint_fit import NormalEquations
from expertaug.models.terms import Term

A, B = Term("v", "v"), Term("v", "x")
WINDOWS, POINTS = 6, 30


def linear(noise=0.01):
    """Windows with an unknown of their own and two candidates, of which the first made what is to be explained."""
    random = np.random.default_rng(0)
    design = random.standard_normal((WINDOWS, 3, POINTS))
    aim = random.standard_normal((WINDOWS, 1)) * design[:, 0] + 2 * design[:, 1]
    aim += noise * random.standard_normal(aim.shape)
    rows, right = torch.from_numpy(design), torch.from_numpy(aim)
    slope = (rows @ right.unsqueeze(-1)).squeeze(-1)
    equations = NormalEquations(right.square().sum(1), rows @ rows.mT, slope)
    return design, aim, Candidates(equations, ((0, False),), ((A, 1), (B, 2)))


def left(design, aim, shared=(), own=()):
    """Sum of squares after a linear fit of some columns, with one coefficient or one a window."""
    columns = [design[:, k].ravel() for k in shared]
    for k in own:
        columns += [np.where(np.arange(WINDOWS)[:, None] == w, design[:, k], 0).ravel() for w in range(WINDOWS)]
    matrix = np.stack(columns, axis=1)
    return ((aim.ravel() - matrix @ np.linalg.lstsq(matrix, aim.ravel(), rcond=None)[0]) ** 2).sum()


def test_a_gain_is_by_how_much_the_sum_of_squares_falls():
    design, aim, columns = linear()
    gains = {(term, shared): gain for gain, term, shared in columns.gains()}
    before = left(design, aim, own=[0])
    for term, place in ((A, 1), (B, 2)):
        assert gains[term, True] == pytest.approx(before - left(design, aim, [place], [0]))
        assert gains[term, False] == pytest.approx(before - left(design, aim, own=[0, place]))


def test_what_a_formula_leaves_is_that_of_a_linear_fit():
    design, aim, columns = linear()
    places = dict(columns.terms)
    for formula, expected in (
        (Formula(), left(design, aim, own=[0])),
        (Formula((A,), (True,)), left(design, aim, [1], [0])),
        (Formula((B, A), (False, True)), left(design, aim, [1], [0, 2])),
    ):
        assert selection.remainder(columns, formula, places) == pytest.approx(expected)


def test_a_regression_finds_what_made_the_values_and_stops():
    *_, columns = linear()
    numbers = WINDOWS * POINTS
    assert selection.by_regression(columns, numbers, 3, own=True) == [Formula((A,), (True,))]
    assert selection.by_regression(columns, numbers, 0, own=True) == []


def tried(errors, *terms, significance=np.inf):
    formula = Formula(terms, (True,) * len(terms))
    return Tried(SimpleNamespace(formula=formula, guess=None), np.array(errors, dtype=float), "direct", significance)


def test_of_formulas_within_one_standard_error_the_shortest_is_chosen():
    best, short, far = tried([1, 1, 1, 1], A, B), tried([1.1, 0.95, 1.0, 1.05], A), tried([3, 3, 3, 3])
    choice = selection.choose([best, far, short], np.arange(4), 0.0)
    assert choice.chosen is short and choice.ties == (best,)
    assert selection.choose([best, far, short], np.arange(4), 5.0).chosen is far, "errors that are as good as none"
    weak = tried([1.1, 0.95, 1.0, 1.05], A, significance=1.0)
    assert selection.choose([best, far, weak], np.arange(4), 0.0).chosen is best, "its coefficient may be zero"


def test_windows_of_a_group_count_as_one():
    best, errors = np.ones(100), np.repeat([1.3, 0.9], 50)
    assert not selection.within(errors, best, np.arange(100), 0.0)
    assert selection.within(errors, best, np.repeat([0, 1], 50), 0.0)
    assert not selection.within(np.full(100, np.nan), best, np.arange(100), 0.0)


def test_terms_are_taken_away_one_by_one_the_least_missed_first():
    asked = []

    def attempt(formula, guess):
        asked.append(formula)
        return tried([1.0 if A in formula.terms else 2.0], *formula.terms)

    selection.backward(attempt, tried([1.0], A, B))
    assert [formula.terms for formula in asked] == [(B,), (A,), ()]

"""Whether models explain windows: against the distribution of χ², and which of several does best."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from expertaug.errors import InputError
from expertaug.inference.diagnostics.goodness import Candidate, choose, find_unexplained, goodness_of_fit

DOF, N = 50, 200


def right(seed=0):
    """χ² per degree of freedom of windows that the right model made, (N,)."""
    return np.random.default_rng(seed).chisquare(DOF, size=N) / DOF


def test_windows_of_the_right_model_are_explained_and_others_are_not():
    values = right()
    found = goodness_of_fit(values, DOF)
    np.testing.assert_allclose(found.p, chi2.sf(values * DOF, DOF))
    assert found.explains and not found.too_well and found.chi2 == pytest.approx(values.mean())
    assert not goodness_of_fit(1.3 * values, DOF).explains
    assert goodness_of_fit(1.05 * values, DOF).explains, "nobody knows the noise better than that"
    assert goodness_of_fit(0.3 * values, DOF).too_well and "far better" in goodness_of_fit(0.3 * values, DOF).says
    assert not goodness_of_fit([np.inf, *values], DOF).explains


def test_fewer_independent_windows_say_less():
    values = 1.2 * right()[:20]
    assert goodness_of_fit(values, DOF).p_together < goodness_of_fit(values, DOF, independent=2).p_together


def test_single_windows_are_named_where_there_are_more_than_chance_makes():
    values = right()
    assert not find_unexplained(values, DOF).any()
    values[:10] *= 3
    assert find_unexplained(values, DOF).nonzero()[0].tolist() == list(range(10))


def test_forecasts_choose_and_where_they_do_not_the_fewer_parameters():
    held = np.random.default_rng(1).chisquare(20, size=N) / 20
    observed = np.full(N, 100)
    small, large = (Candidate(held, right(), observed, parameters=count) for count in (1, 3))
    wrong = Candidate(4 * held, 3 * right(), observed, parameters=1)
    found = choose({"large": large, "small": small, "wrong": wrong})
    assert found.chosen == "small" and found.as_good == ["small", "large"] and found.p["wrong"] < 0.01
    assert found.behind["wrong"] == pytest.approx(np.log(4)) and found.goodness["small"].explains
    few = {name: Candidate(held[:2], right()[:2], observed[:2], count) for name, count in (("a", 1), ("b", 2))}
    assert choose(few).chosen is None and choose(few).says == "these windows do not decide between a and b"


def test_mistakes_are_one_line():
    with pytest.raises(InputError, match="0 degrees of freedom; give fewer parameters"):
        goodness_of_fit(right(), 0)
    with pytest.raises(InputError, match="give two or more, of the same windows"):
        choose({"a": Candidate(np.ones(2), np.ones(2), np.ones(2), 1)})

"""The search for an equation begins with windows that go on, and with candidates of rates that there are."""

from __future__ import annotations

import numpy as np
import pytest

import expertaug as ea
from expertaug.equation.search import Options, Search
from expertaug.errors import InputError
from rubbed_swings import NOISE, T, fitted


@pytest.fixture(scope="module")
def sets():
    """Small swings in closed form."""
    y = np.stack((0.3 * np.cos(2 * T), -0.6 * np.sin(2 * T)), axis=-1)
    return [ea.Trajectories(T, np.stack((y, -y)), np.full((2, 1), 2.0)) for _ in range(2)]


def test_windows_must_go_on_after_what_is_observed(sets):
    how = {"prior": {"omega0": (1.0, 3.5)}, "noise": NOISE, "starts": 2, "tries": 1}
    model = ea.least_squares(ea.DampedPendulum(), sets[0], observed_s=4.0, **how)
    with pytest.raises(InputError, match="0 points after the observed window"):
        Search(model.stored, model.predictor, model.refinement, *sets)


def test_candidates_are_the_library_of_the_rates_that_are_sought_or_what_is_given(sets):
    model = fitted(sets[0], starts=2, tries=1)
    search = Search(model.stored, model.predictor, model.refinement, *sets)
    one, two = ea.Term("omega", "omega"), ea.Term("theta", "1")
    assert search.candidates(Options(only=(one,), extra=(two, one))) == [one, two]
    for options, rates in (
        (Options(), {"omega"}),
        (Options(kinematics=True), {"theta", "omega"}),
        (Options(components=("theta",)), {"theta"}),
    ):
        assert {term.rate for term in search.candidates(options)} == rates
    assert two in search.candidates(Options(extra=(two,)))
    with pytest.raises(InputError, match="components: names 'speed'; known: theta, omega"):
        search.candidates(Options(components=("speed",)))
    with pytest.raises(InputError, match=r"units\.alpha: 'alpha' is no expert parameter"):
        Search(model.stored, model.predictor, model.refinement, *sets, units={"alpha": "shared"})

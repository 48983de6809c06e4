"""Files of forecasts, and the constants that they name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fake_windows import forecasts

from expertaug.errors import InputError
from expertaug.evaluation.forecasts import Forecasts, constants_of
from expertaug.models.fit_settings import Constant, Population, Refinement, RefinementSettings


@pytest.mark.parametrize(("form", "deviation"), [("normal", 0.5), ("lognormal", 3 * 1.133 * 0.533)])
def test_a_spread_is_a_standard_deviation_in_the_parameters_unit(form, deviation):
    """exp(σ²/2) is 1.133 and √(exp(σ²) − 1) is .533 for σ = .5."""
    middle, spread = Constant(value=3.0, std=0.1), Constant(value=0.5, std=0.1)
    known = {"ka": Population(form=form, middle=middle, spread=spread, unit="trajectory")}
    refinement = Refinement.of(settings=RefinementSettings(), noise=0.1, prior=None, population=known)
    (found,) = constants_of(refinement, {"ka": "1/h"}, {})
    assert (found.value, found.spread) == (3.0, pytest.approx(deviation, rel=1e-3))


def test_what_is_saved_is_loaded(tmp_path):
    made = forecasts()
    made.save(tmp_path / "forecasts.npz")
    again = Forecasts.load(tmp_path / "forecasts.npz")
    assert (again.version, again.seeds, again.observed, again.rank_draws) == (made.version, [0, 1], 1, 119)
    assert again.parameter_names == made.parameter_names and set(again.sets) == set(made.sets)
    for name, each in made.sets.items():
        found = again.sets[name].arrays(name)
        assert found.keys() == each.arrays(name).keys()
        for key, values in each.arrays(name).items():
            np.testing.assert_array_equal(found[key], values)


def test_whose_forecasts_they_are_is_needed_where_versions_are_told_apart():
    assert forecasts("a", "e").identified() == ("e", "corrected", "a")
    with pytest.raises(InputError, match="make it again with evaluate"):
        replace(forecasts(), version=None).identified()

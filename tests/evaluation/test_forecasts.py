"""Files of forecasts, and the constants that they name."""

from __future__ import annotations

import pytest

from expertaug.evaluation.forecasts import constants_of
from expertaug.models.settings import Constant, Population, Refinement, RefinementSettings


@pytest.mark.parametrize(("form", "deviation"), [("normal", 0.5), ("lognormal", 3 * 1.133 * 0.533)])
def test_a_spread_is_a_standard_deviation_in_the_parameters_unit(form, deviation):
    """exp(σ²/2) is 1.133 and √(exp(σ²) − 1) is .533 for σ = .5."""
    middle, spread = Constant(value=3.0, std=0.1), Constant(value=0.5, std=0.1)
    known = {"ka": Population(form=form, middle=middle, spread=spread, unit="trajectory")}
    refinement = Refinement.of(settings=RefinementSettings(), noise=0.1, prior=None, population=known)
    (found,) = constants_of(refinement, {"ka": "1/h"}, {})
    assert (found.value, found.spread) == (3.0, pytest.approx(deviation, rel=1e-3))

"""Figures of models in memory."""

from __future__ import annotations

import numpy as np
import pytest
from small_pendulum import SHIFTED

import expertaug as ea
from expertaug.api import plots


def test_figures_are_returned(fit, plus, sets):
    both = {"APHYNITY": fit, "APHYNITY+": plus}
    figure = plots.forecasts(both, sets["test"], samples=[0, 4])
    assert len(figure.axes) == 4 and len(figure.axes[0].lines) == 3
    np.testing.assert_array_equal(figure.axes[1].lines[0].get_ydata(), sets["test"].y[4, :, 0])
    drawn = plots.parameters(both, sets["test"], prior=SHIFTED)
    assert len(drawn.axes) == 2
    course = plots.course(fit)
    assert len(course.axes[0].lines) == 2 and course.axes[1].get_ylabel() == "selection score"
    assert len(plots.forecasts(fit[1], sets["test"]).axes) == 6
    with pytest.raises(ea.InputError, match="samples"):
        plots.forecasts(fit, sets["test"], samples=[99])

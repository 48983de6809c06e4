"""Formulas are refitted through the solver: a known friction is found again, and longer ones cost more."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

import expertaug as ea
from expertaug.equation.shooting import Formula, Guess, Sample, Shooting, criterion

FRICTION, TORQUE = ea.Term("omega", "omega"), ea.Term("omega", "cos(theta)")


def test_a_formula_counts_its_coefficients_and_is_changed_one_term_at_a_time():
    both = Formula().plus(FRICTION, True).plus(TORQUE, False)
    assert (both.freedom(10), both.sharing(1).freedom(10), Formula().freedom(10)) == (11, 2, 0)
    assert both.without(1) == Formula((FRICTION,), (True,)) and both.length == FRICTION.length + TORQUE.length
    assert str(both) == "omega: omega, omega: cos(theta) (of each window)" and str(Formula()) == "no term"


def test_the_criterion_is_that_of_bayes_and_no_error_below_the_noise_is_a_gain():
    assert criterion(8.0, 4, 2, 1e-12) == pytest.approx(4 * math.log(2) + 2 * math.log(4))
    assert criterion(1.0, 4, 2, 1.0) == criterion(2.0, 4, 2, 1.0) == pytest.approx(2 * math.log(4))


def test_a_known_friction_and_frequency_are_found_again():
    t, system = np.arange(9) * 0.1, ea.DampedPendulum()
    data = ea.simulate(system, {"omega0": (2.0, 2.0)}, {"alpha": (0.3, 0.3)}, n=2, t=t)
    sample = Sample.of(data, 5)
    assert sample.count == 2 and sample.windows.shape == (9, 1, 2, 2)
    first = torch.from_numpy(data.y[:, 0]).double().unsqueeze(0)
    guess = Guess(torch.full((1, 2, 1), 1.8, dtype=torch.float64), first)
    how = {"noise": 0.01, "assumed": False, "free_start": False, "solver": ea.Solver("rk4"), "scales": {FRICTION: 1.0}}
    how |= {"units": ["omega0"], "bound": None, "ranges": None, "own": True}
    shooting = Shooting(system, torch.from_numpy(t), **how)
    fit = shooting.fit(Formula((FRICTION,), (True,)), guess, sample)
    (friction,) = shooting.values(fit, sample.groups)
    assert friction.value == pytest.approx(-0.3, abs=1e-3) and math.isnan(friction.spread)
    assert shooting.constants(fit, sample.groups)["omega0"][0] == pytest.approx(2.0, abs=1e-3)
    assert fit.numbers == 2 * 8 * 2 and fit.cost < 1e-3
    assert shooting.errors(fit, guess, sample).max() < 1e-6

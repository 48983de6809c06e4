"""Propagators of a linear part: made once, exact, and kept in their basis."""

from __future__ import annotations

import math

import pytest
import torch

from expertaug.systems.solvers.linear_propagator import DiagonalPropagator, Propagators, lawson4_step


def test_diagonal_flow():
    flow = DiagonalPropagator(lambda y: 2 * y, lambda y: y / 2, torch.tensor([0.5, 1.0]))
    torch.testing.assert_close(flow(torch.tensor([3.0, 4.0])), torch.tensor([1.5, 4.0]))


def test_a_propagator_is_made_once_for_each_length_of_a_step():
    made = []
    propagators = Propagators(lambda h: made.append(h) or (lambda y: math.exp(-h) * y))
    y = torch.ones(1, dtype=torch.float64)
    for h in (0.1, 0.1 * (1 + 1e-7), 0.2):
        assert float(propagators(h)(y)) == pytest.approx(math.exp(-h), rel=1e-6)
    assert made == [0.1, 0.2] and Propagators(None)(0.1)(y) is y


def test_a_lawson_step_is_exact_where_all_is_linear():
    y, h = torch.tensor([[2.0], [-1.0]], dtype=torch.float64), 0.5
    found = lawson4_step(lambda s, y: 0 * y, y.new_tensor(0.0), h, y, 0 * y, lambda y: math.exp(-3 * h / 2) * y)
    torch.testing.assert_close(found, math.exp(-3 * h) * y)

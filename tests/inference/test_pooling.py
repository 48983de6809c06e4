"""Means of values with errors of their own, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from expertaug.inference.pooling import pool


def test_values_that_agree_have_the_error_that_theirs_tell():
    found = pool(np.array([1.0, 1.0, 1.0, 1.0]), np.array([0.2, 0.2, 0.2, 0.2]))
    assert (found.value, found.error, found.spread, found.groups) == (1.0, pytest.approx(0.1), 0.0, 4)


def test_what_scatters_beyond_its_errors_has_a_spread():
    values, errors = np.array([0.0, 2.0, 4.0]), np.array([0.5, 0.5, 0.5])
    found = pool(values, errors)
    assert found.value == pytest.approx(2.0) and found.error == pytest.approx(2 / np.sqrt(3))
    assert found.spread == pytest.approx(np.sqrt(4 - 0.25))  # variance of the values less that of their errors
    alone = pool(values, None)
    assert (alone.value, alone.error, alone.spread) == (2.0, pytest.approx(2 / np.sqrt(3)), pytest.approx(2.0))


def test_a_value_without_an_error_is_the_mean():
    found = pool(np.array([1.0, 2.0, 3.0]), np.array([0.0, 0.5, 0.5]))
    assert (found.value, found.spread) == (pytest.approx(1.0), 0.0) and found.error >= 0

"""Expressions in columns: arithmetic, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from expertaug.errors import InputError
from expertaug.measurements import expression


def test_expressions_are_arithmetic_and_nothing_else():
    columns = {"theta": np.array([0.0, 1.0, np.nan]), "omega": np.array([2.0, 0.0, 1.0])}
    found = expression.value("omega**2 / 2 - 1.5 * cos(theta) + 0 * pi", columns, "")
    assert found[:2] == pytest.approx([0.5, -1.5 * np.cos(1.0)]) and np.isnan(found[2])
    assert np.isnan(expression.value("log(theta - 1)", columns, "")).all()
    assert expression.names("maximum(abs(theta), omega)", "") == ["theta", "omega"]
    for text in (
        "__import__('os').system('true')",
        "theta.__class__",
        "[x for x in theta]",
        "open(theta)",
        "theta if omega else 1",
        "lambda: theta",
        "theta[0]",
        "'a' * 3",
        "cos()",
        "theta +",
        "theta" * 200,
        "theta * 1" + 400 * "0",
        "theta * 1e400",
    ):
        with pytest.raises(InputError) as error:
            expression.names(text, "data.files.split.quantity")
        assert "\n" not in str(error.value)
    with pytest.raises(InputError, match="names 'speed'; known: theta, omega"):
        expression.value("speed", columns, "")

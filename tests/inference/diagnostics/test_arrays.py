"""Arrays that diagnostics are given: what they are made into, and what is refused in one line."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from expertaug.errors import InputError
from expertaug.inference.diagnostics.arrays import draws_and_truth, per_window, plain


def test_tensors_and_lists_become_arrays_of_double_precision():
    for given in ([1, 2], torch.tensor([1.0, 2.0], requires_grad=True), np.float32([1, 2])):
        found = plain(given, "x")
        assert found.dtype == np.float64 and found.tolist() == [1.0, 2.0]
    assert plain([np.inf, 1.0], "x", infinite=True)[0] == np.inf


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ("abc", "x: no array of numbers"),
        ([], r"x: is empty, of shape \(0,\)"),
        ([[1.0, 2.0], [3.0, np.nan]], r"x: is nan at index \(1, 1\)"),
        ([1.0, -np.inf], r"x: is -inf at index \(1,\)"),
    ],
)
def test_what_is_no_array_of_finite_numbers_is_told(given, says):
    with pytest.raises(InputError, match=says) as caught:
        plain(given, "x")
    assert "\n" not in str(caught.value)


def test_draws_and_truth_are_of_the_same_windows_and_draws_are_enough():
    draws, truth = draws_and_truth(torch.ones(3, 2, 1), np.zeros((2, 1)), least=3)
    assert draws.shape == (3, 2, 1) and truth.shape == (2, 1)
    with pytest.raises(InputError, match=r"have shape \(3, 2\), the truth \(3,\)"):
        draws_and_truth(np.ones((3, 2)), np.ones(3))
    with pytest.raises(InputError, match="3 draw a window; give at least 4"):
        draws_and_truth(np.ones((3, 2)), np.ones(2), least=4)
    with pytest.raises(InputError, match="one number a window"):
        per_window(np.ones(3), np.ones(2), "scores")

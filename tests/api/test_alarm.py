"""Alarms by one's own scores: what the front door offers counts windows, whatever arrays they are given in."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from expertaug.api import alarm

SCORES = np.array([0.1, 0.4, 0.4, 0.8, 0.9, 0.2])
FAILING = np.array([False, True, False, True, True, False])


@pytest.mark.parametrize("kind", [np.asarray, torch.as_tensor])
def test_the_area_is_the_share_of_pairs_in_the_right_order_ties_counting_half(kind):
    bad, good = SCORES[FAILING], SCORES[~FAILING]
    right = (np.sign(bad[:, None] - good) + 1) / 2
    found = alarm.auroc(kind(SCORES), kind(FAILING))
    assert found.value == pytest.approx(right.mean())
    assert (found.failing, found.others) == (3, 3) and found.lower < found.value < found.upper


def test_a_threshold_catches_what_lies_above_it():
    limit = alarm.threshold(SCORES[~FAILING], 0.34)
    share, (low, high) = alarm.caught(SCORES, FAILING, 0.4)
    assert share == pytest.approx(2 / 3) and low < share < high
    assert (SCORES[~FAILING] > limit).mean() <= 0.34

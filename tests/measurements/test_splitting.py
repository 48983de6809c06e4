"""Which set each point belongs to: by time, by level or at random, in whole segments and with a guard between."""

from __future__ import annotations

import numpy as np
import pytest

from expertaug.errors import InputError
from expertaug.measurements.splitting import keep_apart, label_at_random, label_by_level, label_by_time, number_segments


def test_segments_and_guard():
    measured = np.array([1, 1, 1, 1, 1, 0, 1, 1, 0, 1, 1, 1, 1], dtype=bool)
    assert number_segments(measured, 2).tolist() == [0, 0, 1, 1, 1, -1, 2, 2, -1, 3, 3, 4, 4]
    assert keep_apart(np.array([2, 2, 2, 1, 1, -1, 0, 0]), 1).tolist() == [2, 2, -1, -1, -1, -1, -1, 0]


def test_time_divides_by_shares_from_either_end():
    measured = np.arange(10) != 4
    shares = (0.5, 0.3, 0.2)
    assert label_by_time(measured, shares, from_end=False).tolist() == [0, 0, 0, 0, -1, 1, 1, 1, 2, 2]
    assert label_by_time(measured, shares).tolist() == [2, 2, 1, 1, -1, 0, 0, 0, 0, 0]


def test_segments_of_low_levels_train_and_those_of_high_ones_test():
    level = np.repeat([5.0, 1.0, 3.0, 2.0, 6.0, 4.0], 2)
    labels, thresholds = label_by_level([np.ones(12, bool)], [level], [2], (0.5, 0.25, 0.25))
    assert labels[0].tolist() == [2, 2, 0, 0, 0, 0, 0, 0, 2, 2, 1, 1]
    assert thresholds == {"train_below": 3.5, "test_above": 4.75}
    with pytest.raises(InputError, match="split by energy: 2 stretches are a chunk long"):
        label_by_level([np.ones(4, bool)], [np.ones(4)], [2], (0.5, 0.25, 0.25))


def test_segments_drawn_at_random_are_whole_and_as_many_as_the_shares_say():
    (label,) = label_at_random([np.ones(40, bool)], [4], (0.5, 0.3, 0.2), 3, "here")
    segments = label.reshape(10, 4)
    assert (segments == segments[:, :1]).all() and np.bincount(segments[:, 0]).tolist() == [5, 3, 2]

"""Converted frame rates are found from the motion, and true times put back."""

from __future__ import annotations

import numpy as np
import pytest

from expertaug_recordings.angles.conversion import find_conversion


def theta(t):
    return np.stack((2 * np.sin(5 * t), 1.5 * np.sin(7 * t + 1)), axis=1)


def test_the_source_s_rate_and_the_times_of_what_is_shown_are_found():
    shown = np.floor(np.arange(100) * 24 / 30 + 0.37)
    found = find_conversion(theta(shown / 24), 30.0)
    assert found.source_hz == pytest.approx(24)
    np.testing.assert_allclose(found.t, (shown - shown[0]) / 24)
    assert np.array_equal(found.repeated[1:], np.diff(shown) == 0) and found.repeated.sum() == 20


@pytest.mark.parametrize("rate", [30.0, 60.0])
def test_frames_at_their_times_tell_of_no_conversion(rate):
    assert find_conversion(theta(np.arange(100) / rate), rate) is None

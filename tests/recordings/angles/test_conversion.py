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
    assert not found.later.any()


@pytest.mark.parametrize("rate", [30.0, 60.0])
def test_frames_at_their_times_tell_of_no_conversion(rate):
    assert find_conversion(theta(np.arange(100) / rate), rate) is None


@pytest.mark.parametrize(
    ("source_hz", "rate", "start"),
    [(24, 25, 0.0), (24, 25, 0.28), (60 / 1.001, 60, 0.8), (50, 60, 0.0), (50, 60, 0.5), (60, 50, 0.2)],
)
def test_mixtures_tell_the_pattern_and_by_how_much_each_frame_is_later(source_hz, rate, start):
    """Also one that repeats once in 1000 frames, of which fewer are seen."""
    at = start + np.arange(400) * source_hz / rate
    strong = np.floor(at + 0.5 + 1e-9)
    blended = np.abs(at - strong) > 0.38
    angles = theta(strong / source_hz)
    angles[blended] = np.nan
    found = find_conversion(angles, float(rate), blended)
    assert found.source_hz == pytest.approx(source_hz, rel=1e-4)
    assert np.abs(found.later - (at - strong))[~blended].max() < 0.03
    np.testing.assert_allclose(np.diff(found.t[~blended]), np.diff(strong[~blended]) / source_hz, atol=1e-4)


def test_single_frames_that_look_mixed_in_fast_motion_tell_of_no_conversion():
    blended = np.zeros(100, bool)
    blended[np.random.default_rng(0).choice(100, 12, replace=False)] = True
    angles = theta(np.arange(100) / 60)
    angles[blended] = np.nan
    assert find_conversion(angles, 60.0, blended) is None

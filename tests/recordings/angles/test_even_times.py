"""Frames off their times are found from the motion, and places between frames lie on the cubics through them."""

from __future__ import annotations

import numpy as np
import pytest

from expertaug_recordings.angles.even_times import find_dropped, find_repeated, interpolate_arm, lagrange, resample

STEADY = np.outer(np.arange(60), [0.2, 0.15])


def test_lagrange_s_weights_take_a_cubic_to_its_own_value():
    rng = np.random.default_rng(0)
    nodes, at = np.sort(rng.uniform(-1, 1, (6, 4)), axis=1), rng.uniform(-1, 1, 6)
    cubic = np.poly1d(rng.normal(size=4))
    np.testing.assert_allclose((lagrange(nodes, at) * cubic(nodes)).sum(1), cubic(at), atol=1e-9)


def test_of_two_frames_that_show_the_same_the_one_of_another_time_is_repeated():
    theta = STEADY.copy()
    theta[20], theta[40] = theta[19], theta[41]
    assert np.flatnonzero(find_repeated(theta)).tolist() == [20, 40]
    assert not find_repeated(STEADY).any()


@pytest.mark.parametrize("lost", [1, 2])
def test_a_motion_that_jumps_as_if_time_had_passed_tells_of_missing_frames(lost):
    theta = np.delete(STEADY, np.arange(25, 25 + lost), axis=0)
    found = find_dropped(theta, np.arange(len(theta), dtype=float))
    assert np.flatnonzero(found).tolist() == [25] and found[25] == lost


def swung(t):
    """Pivot, joint and tip (n, 3, 2) of arms that turn steadily."""
    theta = np.stack((3 * t, -2 * t), axis=1)
    arms = np.stack((np.sin(theta), np.cos(theta)), axis=-1) * [[118.0], [90.0]]
    return np.array([240.0, 238.0]) + np.concatenate((np.zeros((len(t), 1, 2)), np.cumsum(arms, axis=1)), axis=1)


def test_a_steady_rotation_stays_one_between_uneven_frames():
    t = (np.arange(100) + np.random.default_rng(0).uniform(-0.2, 0.2, 100)) / 50
    made = resample(t, swung(t), np.ones(100, bool), 50.0)
    known = np.isfinite(made.place).all((1, 2))
    assert np.diff(made.t) == pytest.approx(1 / 50) and known.mean() > 0.9
    np.testing.assert_allclose(made.place[known], swung(made.t)[known], atol=1e-6)
    assert max(made.error_deg) < 1e-6
    angle, length, _ = interpolate_arm(t, np.diff(swung(t), axis=1)[:, 0], made.t[5:-5])
    assert np.angle(np.exp(1j * (angle - 3 * made.t[5:-5]))) == pytest.approx(0, abs=1e-9)
    assert length == pytest.approx(118.0)

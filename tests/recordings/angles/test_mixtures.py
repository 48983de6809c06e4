"""Frames that a converter mixed from two: which half is whole, and where the stronger images of the others are."""

from __future__ import annotations

import numpy as np
import pytest

from expertaug_recordings.angles.mixtures import late_by, unmix, whole_half


def test_where_every_other_frame_is_a_mixture_the_others_are_whole():
    odd = np.arange(40) % 2 == 1
    assert (whole_half(odd), whole_half(~odd)) == (0, 1)
    assert whole_half(odd & (np.arange(40) < 16)) is None  # too few
    assert whole_half(np.random.default_rng(0).random(200) < 0.5) is None


def test_without_a_pattern_angles_are_off_by_a_fifth_of_a_frame():
    theta = np.outer(np.arange(30), [0.1, -0.1])
    theta[12] = np.nan
    assert late_by(theta)[2:-1] == pytest.approx(0.02)


def places(theta):
    arm = np.stack([np.sin(theta), np.cos(theta)], axis=-1) * [[118.0], [90.0]]
    return np.cumsum(np.concatenate((np.full((len(theta), 1, 2), 240.0), arm), axis=1), axis=1)


@pytest.mark.parametrize("disk", [15.0, 25.0])
def test_places_between_two_images_are_put_back_to_the_stronger_one(disk):
    """Also where disks are of another size than usual: the motion tells it."""
    t, later = np.arange(120) / 30, np.tile([0.0, 0.4, 0.2, -0.2, -0.4], 24)
    theta = np.stack((0.5 * np.sin(2 * t), 0.7 * np.sin(3 * t + 1)), axis=1)
    true = places(theta)
    step = np.gradient(true, axis=0)
    part = later[:, None] / (1 + (np.linalg.norm(step, axis=2) / (0.19 * disk)) ** 4)
    seen = true + part[..., None] * step
    seen[40] = np.nan
    moved, error = unmix(seen, np.arange(120), later)
    known = np.isfinite(seen[:, 0, 0])
    before, after = (np.sqrt(np.mean((place - true)[known] ** 2)) for place in (seen, moved))
    assert after < 0.35 * before
    assert (error[::5] == 0).all() and (error[1::5][:, 1] > error[1::5][:, 0]).mean() > 0.9


def test_where_no_frame_is_mixed_nothing_is_moved():
    place = places(np.outer(np.arange(30), [0.03, 0.02]))
    moved, error = unmix(place, np.arange(30), np.zeros(30))
    assert np.array_equal(moved, place) and not error.any()

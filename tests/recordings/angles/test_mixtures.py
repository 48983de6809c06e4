"""Frames that a converter mixed from two: which half is whole, and by how much the others are off."""

from __future__ import annotations

import numpy as np
import pytest

from expertaug_recordings.angles.mixtures import late_by, whole_half


def test_where_every_other_frame_is_a_mixture_the_others_are_whole():
    odd = np.arange(40) % 2 == 1
    assert (whole_half(odd), whole_half(~odd)) == (0, 1)
    assert whole_half(odd & (np.arange(40) < 16)) is None  # too few
    assert whole_half(np.random.default_rng(0).random(200) < 0.5) is None


@pytest.mark.parametrize(
    ("step", "undone", "error"),
    [
        (0.1, False, 0.02),  # a fifth of a frame late
        (0.03, True, 0.16 * 0.03),  # the middle of both images
        (0.1, True, 0.16 * 0.05**4 / 0.1**3),  # the images lie apart: the stronger one is followed
    ],
)
def test_angles_are_off_by_what_the_followed_image_is(step, undone, error):
    theta = np.outer(np.arange(30), [step, -step])
    theta[12] = np.nan
    assert late_by(theta, undone)[2:-1] == pytest.approx(error)

"""The pendulum's lengths and its pivot from frames of which nothing else is known."""

from __future__ import annotations

import numpy as np
import pytest

from expertaug.errors import InputError
from expertaug_recordings.markers.geometry import centre_of_circle


def test_a_joint_that_hardly_moves_tells_no_pivot():
    angle = np.linspace(0, np.deg2rad(300), 40)
    points = np.array([300.0, 200.0]) + 80 * np.stack((np.sin(angle), np.cos(angle)), 1)
    points[7] += 25  # taken for another marker
    assert centre_of_circle(points) == pytest.approx((300, 200), abs=1e-6)
    with pytest.raises(
        InputError, match=r"the joint moves over \d+° only: too little to find the pivot; set recordings.*pivot_px"
    ):
        centre_of_circle(points[-5:])

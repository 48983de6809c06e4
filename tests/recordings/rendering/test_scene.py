"""What the camera sees: markers where they should be, exposures averaged, and nothing where nothing is."""

from __future__ import annotations

import numpy as np
import pytest
from light import centroid

from expertaug_recordings.rendering import scene
from expertaug_recordings.rendering.render import poses
from expertaug_recordings.rendering.scene import Pose, Scene

ARMS = (117.8, 90.1)


@pytest.mark.slow
def test_marker_centres_are_exact_before_the_sensor(monkeypatch):
    """Without rods and stand, a marker looks the same turned by half a turn: its centroid is its centre."""
    monkeypatch.setattr(
        scene, "RODS", {name: (offsets, width, (0, 0, 0)) for name, (offsets, width, _) in scene.RODS.items()}
    )
    monkeypatch.setattr(scene, "STAND", ((0, 0, 0), 1.0))
    rng = np.random.default_rng(2)
    for _ in range(8):
        pivot = (238 + rng.uniform(-4, 4), 239 + rng.uniform(-4, 4))
        drawn = Scene(480, pivot, ARMS, 0, rng)
        state = np.array([np.pi + rng.uniform(-1, 1), np.pi + rng.uniform(-1, 1), 0, 0])
        pose = poses(state, pivot, ARMS, 90e-6)[0]
        scale = 480 / drawn.sensor
        light = drawn.clean([pose]).sum(axis=-1).astype(float)
        seen = drawn.frame([pose]).sum(axis=-1).astype(float)
        for centre in (pose.pivot, pose.joint, pose.tip):
            on_sensor = (np.array(centre) + 0.5) / scale - 0.5
            np.testing.assert_allclose(centroid(light, on_sensor, 17 / scale) * scale, on_sensor * scale, atol=0.01)
            np.testing.assert_allclose(centroid(seen, centre, 17), centre, atol=0.05)


def test_an_exposure_is_the_mean_of_its_poses_and_where_nothing_is_it_is_dark():
    pivot, arms = (120.3, 60.2), (60.0, 40.0)
    drawn = Scene(240, pivot, arms, 0, np.random.default_rng(0))

    def pose(theta1, theta2):
        joint = pivot[0] + arms[0] * np.sin(theta1), pivot[1] + arms[0] * np.cos(theta1)
        tip = joint[0] + arms[1] * np.sin(theta2), joint[1] + arms[1] * np.cos(theta2)
        return Pose(pivot, joint, tip, theta1, theta2)

    one, other = pose(0.5, 1.0), pose(0.6, 0.8)
    separate = [drawn.clean([each]).astype(float) for each in (one, other)]
    np.testing.assert_allclose(drawn.clean([one, other]), np.mean(separate, axis=0), atol=1)
    frame = drawn.frame([one])
    assert np.array_equal(frame, drawn.frame([one])) and frame.shape == (240, 240, 3)
    assert frame[:, :60].max() == 0 < frame[40:80, 100:140].max()

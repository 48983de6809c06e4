"""Markers off their hinges are told by how the arms' lengths vary, and taken out."""

from __future__ import annotations

import numpy as np
import pytest

from expertaug_recordings.angles.arms import GROUPS, NONE, Offsets, find_offsets

LENGTHS, OFF = (118.0, 90.0), np.array([1.2, -1.6])


def arms():
    """Directions (n, 2, 2) of both arms, and at right angles to them."""
    theta = np.random.default_rng(0).uniform(-np.pi, np.pi, (800, 2))
    along = np.stack((np.sin(theta), np.cos(theta)), axis=-1)
    return along, np.stack((-along[..., 1], along[..., 0]), axis=-1)


def between_markers(offsets):
    """Vectors (n, 2, 2) between markers that are off their hinges."""
    along, across = arms()
    joint = sum(
        of[0] * along[:, k] + of[1] * across[:, k] for k, of in enumerate((offsets.joint_arm1, offsets.joint_arm2))
    )
    hinges = along * np.array(LENGTHS)[:, None]
    return np.stack((hinges[:, 0] + offsets.pivot + joint, hinges[:, 1] - joint + offsets.tip), axis=1)


@pytest.mark.parametrize("group", GROUPS)
def test_an_offset_is_found_and_taken_out(group):
    offsets = Offsets(**{name: OFF * (name == group) for name in GROUPS})
    seen = between_markers(offsets)
    noisy = seen + 0.05 * np.random.default_rng(1).normal(size=seen.shape)
    found = find_offsets(noisy, np.ones(len(seen), bool))
    assert found.sizes == {group: pytest.approx(2.0, abs=0.03)}
    assert getattr(found, group) == pytest.approx(OFF, abs=0.03)
    np.testing.assert_allclose(np.linalg.norm(offsets.remove(seen), axis=-1), np.tile(LENGTHS, (800, 1)), atol=1e-4)


def test_lengths_that_vary_by_their_noise_alone_tell_of_no_offset():
    vectors = between_markers(NONE)
    noisy = vectors + 0.05 * np.random.default_rng(1).normal(size=vectors.shape)
    assert find_offsets(noisy, np.ones(len(noisy), bool)).sizes == {}
    assert np.array_equal(NONE.remove(noisy), noisy)

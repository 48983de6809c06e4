"""Which frames are measured, filled or unusable, and why, in plain words."""

from __future__ import annotations

import numpy as np
import pytest

from expertaug_recordings.angles.quality import NO_PIVOT, gap_lengths, is_crowded, judge, too_few
from expertaug_recordings.angles.smoothing import Motion


def test_each_frame_has_the_quality_and_the_reason_of_what_became_of_it():
    frames, none = np.arange(6), np.full((6, 4), np.nan)
    y = np.where(frames[:, None] < 5, 0.0, none)
    flags = np.zeros((6, 2), bool)
    motion = Motion(y, y[:, :2], none, flags, flags.astype(int), frames == 0, frames == 1)
    reason = np.array(["", "", "lost:blue", "", "", ""], object)
    quality, said = judge(motion, frames != 2, reason, frames == 3)
    assert quality.tolist() == [0.5, 0.5, 0.5, 1, 1, 0]
    assert said.tolist() == ["margin", "interpolated", "interpolated", NO_PIVOT, "", "short_stretch"]


def test_gaps_are_runs_of_what_is_not_there():
    assert gap_lengths(np.array([0, 1, 0, 0, 1, 1, 0], bool)) == [1, 2, 1]
    assert gap_lengths(np.ones(4, bool)) == []


@pytest.mark.parametrize(
    ("reason", "turn", "why", "helps"),
    [
        ("lost:blue", 0.1, "in 8 the markers were not found", "check the tracking"),
        ("torn", 0.1, "all markers were found, 8 are torn", "take the camera's own file"),
        ("arm_length", 0.1, "all markers were found, 8 have an arm of another length", "angles.arm_tolerance"),
        ("repeated", 0.1, "all markers were found, 8 repeat the one before", "before its frame rate was converted"),
        ("", 1.5, "the arms turn by 86° from frame to frame", "30 frames/s are too few: record with more"),
    ],
)
def test_too_few_usable_frames_have_a_cause_and_a_remedy(reason, turn, why, helps):
    reasons, usable = np.array([reason] * 8 + [""] * 2, object), np.arange(10) >= 8
    theta = turn * np.arange(10)[:, None] * np.ones(2)
    found = too_few(reasons, usable, theta, 30.0, 4)
    assert found[0].startswith(why) and helps in found[1]
    assert is_crowded(theta) == (turn > 1)

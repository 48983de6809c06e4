"""Times of frames: even but for their rounding, or uneven, and which of them lie in a span."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from expertaug.errors import InputError
from expertaug_recordings.video.timestamps import in_seconds, judge, span

EVEN_MS = 1000 * np.arange(60) / 30
CLIP = Path("clip.mp4")


def test_rounded_times_are_even_and_those_off_by_a_fifth_of_a_step_are_not():
    step, even = judge(CLIP, np.round(EVEN_MS), 1.0)
    assert even and step == pytest.approx(1000 / 30, rel=1e-4)
    off = EVEN_MS + np.random.default_rng(0).uniform(-7, 7, 60)
    assert not judge(CLIP, off, 1.0)[1]
    with pytest.raises(InputError, match=r"clip.mp4: frame 3 is not later than the one before"):
        judge(CLIP, np.array([0.0, 10, 20, 20, 30]), 1.0)


def test_times_are_scaled_to_the_rate_at_which_frames_were_taken():
    times = np.delete(EVEN_MS, [5, 20]) + 500
    rate, seconds = in_seconds(times, None)
    assert rate == pytest.approx(30) and seconds == pytest.approx((times - 500) / 1000)
    rate, slow = in_seconds(times, 240.0)
    assert rate == 240 and slow == pytest.approx(seconds / 8)


def test_a_span_has_the_frames_from_its_first_to_its_last_time():
    assert span("clip", EVEN_MS / 1000, 0.5, 1.0) == range(15, 31)
    assert span("clip", EVEN_MS / 1000, 1.9, None) == range(57, 60)
    with pytest.raises(InputError, match=r"clip: from 5 to 6 s there are 0 frames; it lasts 1.97 s: set recordings"):
        span("clip", EVEN_MS / 1000, 5.0, 6.0)

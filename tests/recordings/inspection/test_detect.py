"""Which of the round things in frames are a pendulum's markers, by their hues and their motion."""

from __future__ import annotations

import numpy as np
from seen_spots import FRAMES, HUES, sightings, swing

from expertaug_recordings.inspection.detect import by_hue, cleanest, find_pendulum

NOISE = sightings(np.random.default_rng(0).uniform(0, 400, (FRAMES, 2)), 60.0)


def spots(first=0, last=3):
    places = swing()
    return [spot for k in range(first, last) for spot in sightings(places[:, k], HUES[k])]


def test_the_markers_that_keep_their_distances_have_the_roles_of_their_motion():
    found = find_pendulum([*NOISE, *spots()[::-1]], "disk", FRAMES)
    for k, role in enumerate(found.spots):
        np.testing.assert_allclose([role[n].centre for n in range(FRAMES)], swing()[:, k])
    assert found.spread < 1e-9


def test_a_pivot_may_bear_no_marker_and_a_pendulum_may_be_single():
    unmarked = find_pendulum(spots(first=1), "disk", FRAMES).spots
    assert unmarked[0] is None and unmarked[2][0].colour[0] == HUES[2]
    single = find_pendulum(spots(last=2), "disk", FRAMES).spots
    assert single[2] is None and single[1][0].colour[0] == HUES[1]


def test_what_does_not_swing_or_is_seen_too_seldom_is_no_pendulum():
    still = [spot for k in range(3) for spot in sightings(np.tile(swing()[0, k], (FRAMES, 1)), HUES[k])]
    assert find_pendulum(still, "disk", FRAMES) is None
    assert find_pendulum([spot for spot in spots() if spot.frame < 4], "disk", FRAMES) is None


def test_hues_go_round_and_of_each_frame_the_cleanest_spot_counts():
    place = np.zeros((1, 2))
    red, other, green = (sightings(place, hue, share)[0] for hue, share in ((355.0, 0.7), (5.0, 0.9), (120.0, 0.8)))
    assert sorted(len(group) for group in by_hue([red, green, other])) == [1, 2] and by_hue([]) == []
    assert cleanest([red, other]) == {0: other}

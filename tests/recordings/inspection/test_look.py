"""The keys that are proposed for what was seen of a video."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from seen_spots import HUES, sightings, swing

from expertaug_recordings.inspection.detect import Pendulum
from expertaug_recordings.inspection.look import Footage, propose_tracking
from expertaug_recordings.settings import StatedTimes, TrackMarkersJob


def pendulum(hues):
    roles = [
        None if hue is None else {spot.frame: spot for spot in sightings(swing()[:, k], hue)}
        for k, hue in enumerate(hues)
    ]
    return Pendulum("disk", tuple(roles), 0.0)


def test_colours_are_proposed_by_name_and_as_ranges():
    names, ranges = propose_tracking(pendulum(HUES))
    look = {"style": "disk", "pivot": "red", "joint": "green", "tip": "blue"}
    assert names == {"markers": look, "marker_diameter_px": 24.0}
    appearance = TrackMarkersJob.from_mapping(ranges).appearance
    assert [colour.middle for colour in appearance.colours] == pytest.approx(HUES)
    assert propose_tracking(pendulum((None, *HUES[1:])))[0]["markers"]["pivot"] is None


def test_hues_that_have_one_name_are_proposed_as_ranges_that_do_not_meet():
    (ranges,) = propose_tracking(pendulum((350.0, 10.0, 230.0)))
    assert (ranges["markers"]["pivot"]["hue"], ranges["markers"]["joint"]["hue"]) == ([341, 359], [1, 19])
    assert ranges["markers"]["tip"]["saturation"] == [0.4, 1.0]


@pytest.mark.parametrize(("times", "said"), [(None, ""), (np.arange(90) / 30, " (variable)")])
def test_a_video_s_facts_are_those_of_its_frames(times, said):
    footage = Footage(Path("a.mp4"), [np.zeros((48, 64, 3), np.uint8)], [0], 30.0, 90, times, StatedTimes())
    assert footage.facts == f"64x48 px, 30 Hz{said}, 90 frames, 3.00 s"

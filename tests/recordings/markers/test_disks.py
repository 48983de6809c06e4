"""Disks in a frame: where they are, how large, and which marker by their colour."""

from __future__ import annotations

import numpy as np
import pytest
from drawn import PAINT, draw

from expertaug_recordings.markers.appearance import COLOURS, Appearance, Colour
from expertaug_recordings.markers.disks import Palette, fitter, hsv


def test_hue_saturation_and_value():
    bgr = np.array([[0, 0, 1], [0, 1, 0], [1, 0, 0], [0, 0.5, 1], [1, 0.5, 0.75], [0.4, 0.4, 0.4], [0, 0, 0]])
    found = hsv(bgr)
    assert found[:5, 0] == pytest.approx([0, 120, 240, 30, 270])
    assert found[:, 1] == pytest.approx([1, 1, 1, 1, 0.5, 0, 0])
    assert found[:, 2] == pytest.approx([1, 1, 1, 1, 1, 0.4, 0])


def test_colours_are_told_apart_also_where_their_ranges_overlap():
    colours = (Colour(name, COLOURS[name]) for name in ("green", "cyan", "red"))
    palette = Palette(Appearance("quadrant", *colours))
    hue = np.array([130, 185, 170, 195, 350, 10, 60, 250])
    colour = np.stack((hue, np.full(8, 0.6), np.full(8, 0.7)), axis=1)
    assert palette.identify(colour).tolist() == [0, 1, 1, 1, 2, 2, -1, -1]
    assert palette.identify(colour * [1, 0.2, 1]).tolist() == [-1] * 8  # grey
    assert palette.identify(colour * [1, 1, 0.1]).tolist() == [-1] * 8  # black


@pytest.mark.parametrize("style", ["disk", "quadrant"])
def test_a_disk_is_measured_to_a_small_part_of_a_pixel_and_called_by_its_colour(style):
    places = np.array([[[40.3, 40.8], [120.6, 50.1], [80.0, 110.45]]])
    (frame,) = draw(places, (160, 150), [PAINT[name] for name in ("red", "green", "blue")], 24.0, style, noise=0.0)
    finder = fitter(24.0, 40.0, 0.6, Appearance(style))
    found = finder.fit(frame, places[0] + [2.0, -1.5])
    assert np.abs(found.centre - places[0]).max() < 0.15 and found.radius == pytest.approx(12.0, abs=0.3)
    assert found.identity.tolist() == [0, 1, 2] and found.share.min() > 0.6
    near = finder.candidates(frame)
    assert all(np.hypot(*(near - place).T).min() < 4 for place in places[0])

"""Marker descriptions: what is accepted, what each refusal says, and which colour is taken for which marker."""

import numpy as np
import pytest

from expertaug.errors import InputError
from expertaug_recordings.markers.appearance import COLOURS, Appearance, Colour
from expertaug_recordings.markers.disks import Palette, hsv


def test_defaults_are_the_quadrants_of_the_dataset():
    look = Appearance.from_mapping(None)
    assert look == Appearance()
    assert (look.style, look.names, look.first) == ("quadrant", ("red", "green", "blue"), 0)


def test_an_unmarked_pivot_is_called_by_its_role():
    look = Appearance.from_mapping({"pivot": None, "pivot_px": [10, 20.5], "joint": {"hue": [340, 20]}})
    assert look.names == ("pivot", "joint", "blue")
    assert (look.first, look.pivot_px) == (1, (10.0, 20.5))
    assert (look.joint.middle, look.joint.reach) == (0, 20)


@pytest.mark.parametrize(
    ("markers", "message"),
    [
        ({"shape": "disk"}, r"markers\.shape: unknown key; known are style"),
        ({"style": "square"}, r"markers\.style: is 'square'; it must be quadrant or disk"),
        ({"tip": "yelow"}, r"markers\.tip: 'yelow' is no known colour; did you mean yellow"),
        ({"tip": "grey"}, r"markers\.tip: 'grey' is no known colour"),
        ({"joint": None}, r"markers\.joint: is None"),
        ({"tip": "red"}, r"markers\.tip: has the colour of the pivot, red"),
        ({"tip": {"saturation": [0, 1]}}, r"markers\.tip\.hue: missing"),
        ({"tip": {"hue": [10, 400]}}, r"markers\.tip\.hue: is \[10, 400\]"),
        ({"tip": {"hue": [10, 10]}}, r"markers\.tip\.hue: is \(10\.0, 10\.0\)|markers\.tip\.hue: is \[10"),
        ({"tip": {"hue": [10, 30], "value": [0.5, 0.2]}}, r"markers\.tip\.value: is \[0\.5, 0\.2\]"),
        ({"tip": {"hue": [10, 30], "hues": 1}}, r"markers\.tip\.hues: unknown key"),
        ({"pivot_px": [10, 20]}, r"markers\.pivot_px: given for a red pivot"),
        ({"pivot": None, "pivot_px": [10]}, r"markers\.pivot_px: is \[10\]"),
        ({"pivot": None, "pivot_px": [10, float("nan")]}, r"markers\.pivot_px: is \[10, nan\]"),
    ],
)
def test_refusals(markers, message):
    with pytest.raises(InputError, match=message) as error:
        Appearance.from_mapping(markers)
    assert "\n" not in str(error.value)


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


def test_each_named_colour_is_nearest_to_its_own_middle():
    for name, hue in COLOURS.items():
        colour = Appearance.from_mapping(
            {"pivot": None, "joint": name, "tip": "green" if name != "green" else "red"}
        ).joint
        assert 0 < colour.reach <= 60 and (colour.middle - hue[0]) % 360 == pytest.approx(colour.reach)

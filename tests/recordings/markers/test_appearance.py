"""Marker descriptions: what is accepted, what each refusal says, and which colour is taken for which marker."""

import pytest

from expertaug.errors import InputError
from expertaug_recordings.markers.appearance import COLOURS, Appearance


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


def test_each_named_colour_is_nearest_to_its_own_middle():
    for name, hue in COLOURS.items():
        colour = Appearance.from_mapping(
            {"pivot": None, "joint": name, "tip": "green" if name != "green" else "red"}
        ).joint
        assert 0 < colour.reach <= 60 and (colour.middle - hue[0]) % 360 == pytest.approx(colour.reach)

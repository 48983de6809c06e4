"""What is left over beside the proposed pendulum is said: second pendulums, balls and stickers of a marker's colour."""

import re

import cv2
import numpy as np
import pytest
from drawn import PAINT, draw, markers_of, swinging, write_video

from expertaug_recordings.inspection.detect import find_pendulum, find_spots
from expertaug_recordings.inspection.inspect import inspect
from expertaug_recordings.inspection.left_over import find_left_over
from nightly import others_slow

SIZE, ARMS, DIAMETER, COUNT = (340, 208), (52.0, 38.0), 16, 8
WALL = (60, 58, 55)  # on a darker one noise has colours, and its thousand parts cost more than the disks
COLOURS = ("red", "green", "blue")
START, OTHER = (1.2, 0.5, 0.0, 0.0), (-0.9, 0.4, 0.0, 0.0)


def pendulum(pivot=(100.2, 100.7), start=START):
    return markers_of(swinging(24 * COUNT, start)[::24, :2], pivot, ARMS)


def ball(reach, centre=(270, 60)):
    """A ball that goes round, (n, 1, 2)."""
    t = np.arange(COUNT) * 0.7
    return (np.array(centre) + reach * np.stack([np.cos(t), np.sin(t)], axis=1))[:, None]


def filmed(markers, colours, extra, painted):
    """Frames (n, H, W, 3) of markers (n, 3, 2) and more disks (n, k, 2)."""
    frames = draw(markers, SIZE, [None if c is None else PAINT[c] for c in colours], DIAMETER, background=WALL)
    for image, places in zip(frames, () if extra is None else extra, strict=extra is not None):
        for place, colour in zip(places, painted, strict=True):
            at = tuple(np.rint(place * 16).astype(int).tolist())
            cv2.circle(image, at, 8 * DIAMETER, PAINT[colour], -1, cv2.LINE_AA, 4)
    return frames


def seen(*scene):
    """Whether each role has a marker in what is proposed for a scene, and what is said of it."""
    frames = filmed(*scene)
    spots = find_spots(frames, "disk")
    found = find_pendulum(spots, "disk", len(frames))
    return [one is not None for one in found.spots], find_left_over(found, spots, len(frames))


BALLS = {
    "a ball of the tip's colour": (ball(30), ("blue",), 2, [" colour (hue 225) that move, in 8 of 8 frames"]),
    "nothing": (None, (), 3, []),
    "another pendulum": (
        pendulum((250.0, 90.0), OTHER)[:, 1:],
        ("orange", "purple"),
        3,
        ["another colour (hue 268) that move, in 8 of 8 frames: are there two", "another colour (hue 26) that move"],
    ),
    "one of the joint's": (ball(30), ("green",), 1, ["the joint's colour (hue 125) that move", "another colour"]),
    "one of no marker's": (ball(30), ("magenta",), 3, ["another colour (hue 311) that move"]),
    "a sticker of the tip's": (ball(0), ("blue",), 3, ["the tip's colour (hue 225) at rest, in 8 of 8 frames"]),
    "a sticker of no marker's": (ball(0), ("magenta",), 3, []),
    "one alike": (
        pendulum((250.0, 90.0), OTHER),
        COLOURS,
        3,
        ["the pivot's colour (hue 0) at rest", "the joint's colour (hue 125) that move", "the tip's colour"],
    ),
}


@pytest.mark.parametrize("name", others_slow(list(BALLS), 3))
def test_balls_stickers_and_other_pendulums_are_told(name):
    extra, painted, least, said = BALLS[name]
    roles, lines = seen(pendulum(), COLOURS, extra, painted)
    assert len(lines) == len(said) and all(any(one in line for line in lines) for one in said), lines
    assert sum(roles) >= least


@pytest.mark.parametrize("two", others_slow([True, False]))
def test_two_single_pendulums_are_told(two):
    extra = pendulum((250.0, 90.0), OTHER)[:, :2] if two else None
    roles, lines = seen(pendulum(), ("red", "blue", None), extra, ("red", "blue"))
    assert roles == [True, True, False] and len(lines) == 2 * two
    assert not two or any("the joint's colour (hue 225) that move" in line for line in lines)


@pytest.mark.slow
def test_inspect_says_it_in_the_proposal_and_in_the_terminal(tmp_path, caplog):
    frames = filmed(pendulum(), COLOURS, ball(30), ("blue",))
    text = inspect(write_video(frames.repeat(2, axis=0), tmp_path / "clip.mp4", 30), tmp_path / "sheet.png")
    said = r"left over: disks of (another|the tip's) colour \(hue 225\) that move, in 16 of 16 frames"
    assert re.search(f"(?m)^# {said}", text) and re.search(said, caplog.text)

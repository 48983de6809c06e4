"""Drawings lie where they should, leave out what is not known, and can be read on any background."""

from __future__ import annotations

import numpy as np
import pytest

from expertaug_recordings.reports import drawing

PLACE = np.array([[80.0, 20.0], [80.0, 70.0], [130.0, 70.0]])


def drawn(place):
    image = np.zeros((100, 160, 3), np.uint8)
    drawing.pendulum(image, place, 10)
    return image.astype(int)


def test_rings_lie_about_their_markers_in_the_colours_of_their_roles():
    image = drawn(PLACE)
    for (x, y), colour in zip(PLACE.astype(int), drawing.ROLE_COLOURS, strict=True):
        off = np.abs(image[y - 12 : y + 13, x - 12 : x + 13] - colour).max(axis=2)
        rows, columns = np.nonzero(off < 60)
        assert len(rows) > 20 and np.hypot(rows - 12, columns - 12) == pytest.approx(10, abs=1.5)


def test_what_is_not_known_is_left_out():
    known = drawn(np.where(np.arange(3)[:, None] < 2, PLACE, np.nan))
    assert known[:, 95:].max() == 0 < drawn(PLACE)[:, 95:].max()
    assert drawn(np.full((3, 2), np.nan)).max() == 0


def test_fractions_of_a_pixel_are_kept_in_sixteenths():
    assert drawing.to_fixed_point(np.array([[1.5, 2.25], [-0.0625, 3.03]])).tolist() == [[24, 36], [-1, 48]]


def test_words_stand_on_a_darker_patch_and_nothing_else_is_touched():
    image = np.full((60, 160, 3), 240, np.uint8)
    drawing.text(image, "12", (20, 40), (255, 255, 255))
    assert (image[31, 18] == 80).all() and (image == 255).any()
    assert (image[50:] == 240).all() and (image[:, 80:] == 240).all()


@pytest.mark.parametrize("factor", [1, 0.5, 2])
def test_an_image_in_another_size_is_one_of_its_own(factor):
    image = np.full((40, 60, 3), 7, np.uint8)
    other = drawing.resize(image, factor)
    assert other.shape == (40 * factor, 60 * factor, 3) and (other == 7).all() and not np.shares_memory(image, other)

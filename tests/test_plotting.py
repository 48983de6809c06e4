"""One look for all figures: lines that can be told apart, axes with plain numbers, files that are the same again."""

from __future__ import annotations

import pytest

from expertaug import plotting
from expertaug.errors import InputError
from expertaug.hues import FLOOR


def test_versions_of_one_method_differ_in_dash_or_marker_and_the_true_equation_is_dotted():
    versions = ["a", "a+", "a=", "a+~flow", "a~refined"]
    colours = plotting.colours([*versions, "truth"], {"a": 2, "truth": FLOOR})
    looks = [plotting.look(version, colours) for version in versions]
    assert len({(str(one["linestyle"]), one["marker"]) for one in looks}) == len(versions)
    truth = plotting.look("truth", colours)
    assert (truth["linestyle"], truth["marker"]) == (":", "")


def test_augmented_versions_are_darker_than_the_trained_one():
    colours = plotting.colours(["a", "a+"], {"a": 2})
    assert all(dark < light for dark, light in zip(colours["a+"], colours["a"], strict=True))


def test_a_logarithmic_axis_has_plain_numbers_and_stays_linear_where_nothing_is_above_zero():
    axes, other = plotting.new_figure(1).subplots(1, 2)
    axes.plot([1, 2], [0.01, 100])
    other.plot([1, 2], [-1, 0])
    for one in (axes, other):
        plotting.plain_log(one)
    assert axes.get_yscale() == "log" and other.get_yscale() == "linear"
    assert [axes.yaxis.get_major_formatter()(value) for value in (0.01, 1, 100)] == ["0.01", "1", "100"]


def test_words_are_wrapped_to_a_width_in_inches_and_long_ones_stay_whole():
    assert plotting.wrap_words("one two three four", 0.9, 8) == "one two three\nfour"
    assert plotting.wrap_words("incomprehensibilities", 0.1, 8) == "incomprehensibilities"


def test_a_figure_of_the_same_words_is_the_same_file_and_another_suffix_is_refused(tmp_path):
    for name in ("one.png", "one.pdf", "two.png", "two.pdf"):
        plotting.save(plotting.note("nothing"), tmp_path / name, dpi=30)
    for suffix in ("png", "pdf"):
        assert (tmp_path / f"one.{suffix}").read_bytes() == (tmp_path / f"two.{suffix}").read_bytes()
    with pytest.raises(InputError, match=r"a\.svg: suffix '\.svg'; figures are \.png or \.pdf"):
        plotting.save(plotting.note("x"), tmp_path / "a.svg")

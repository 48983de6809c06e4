"""What users are told of a value, in the words of a configuration file."""

from __future__ import annotations

import pytest
import yaml

from expertaug.wording import is_multiple, number_in, show, suggest, unknown


@pytest.mark.parametrize(
    ("text", "number"),
    [("1e-3", "1.0e-3"), ("2E5", "2.0e+5"), (".5e3", ".5e+3"), ("12", "12"), ("e3", None), ("x", None)],
)
def test_numbers_are_written_as_yaml_wants_them(text, number):
    assert number_in(text) == number
    if number:
        assert isinstance(yaml.safe_load(number), int | float)


@pytest.mark.parametrize("value", [1e-7, 0.5, -3, True, None, [1, 2], "text", float("-inf")])
def test_a_value_is_shown_as_yaml_reads_it(value):
    assert yaml.safe_load(show(value)) == value


def test_long_values_are_cut():
    assert len(show("x" * 100)) == 60 and show("x" * 100).endswith("...")


@pytest.mark.parametrize(
    ("name", "known", "said"),
    [
        ("pendulm", ["pendulum", "rlc"], "did you mean 'pendulum'? known: pendulum, rlc"),
        ("gpu", ["cpu", "cuda"], "did you mean 'cuda'? known: cpu, cuda"),
        ("x", ["pendulum"], "known: pendulum"),
        ("x", [], "known: none"),
    ],
)
def test_the_nearest_known_name_is_suggested(name, known, said):
    assert suggest(name, known) == said


def test_names_that_are_unknown_or_there_twice_are_told_with_their_places():
    assert [str(error) for error in unknown(["a", "b", "a"], ["a"], "run", "experiment")] == [
        "run[1]: 'b' is no experiment; known: a",
        "run[2]: 'a' is there twice; name each experiment once",
    ]


def test_a_multiple_is_one_in_spite_of_rounding():
    assert is_multiple(0.3, 0.1) and is_multiple(2.0, 2.0)
    assert not is_multiple(0.35, 0.1) and not is_multiple(0.0, 0.1)

"""The exception for bad input: one line, whatever it quotes."""

from __future__ import annotations

from pathlib import Path

from expertaug.errors import LONGEST, InputError, InputErrors, lines


def test_a_message_is_one_line_of_where_what_was_found_and_what_would_be_right():
    error = InputError(Path("a.csv"), "no\n  such\t file", "give one")
    assert str(error) == "a.csv: no such file; give one"
    assert (error.where, error.remedy) == ("a.csv", "give one")
    assert str(InputError("a", "b")) == "a: b"


def test_what_a_terminal_would_obey_is_escaped_and_long_texts_are_cut():
    message = str(InputError("x", "\x1b[31mred\x07", "y" * 1000 + "z"))
    assert r"\x1b[31mred\x07" in message and message.isprintable()
    assert len(message) < 2 * LONGEST and message.endswith("yz") and " … " in message


def test_several_are_told_a_line_each_and_the_first_stands_for_all():
    first, second = InputError("a", "1", "2"), InputError("b", "3")
    both = InputErrors([first, second])
    assert lines(both) == ["a: 1; 2", "b: 3"] and lines(second) == ["b: 3"]
    assert (str(both), both.where, both.found, both.remedy) == ("a: 1; 2", "a", "1", "2")

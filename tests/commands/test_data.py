"""Subcommands that look at data, or forecast: what they hand on of the command line."""

from __future__ import annotations

from pathlib import Path

import pytest

from expertaug.commands import data
from expertaug.errors import InputError
from subcommands import call


@pytest.mark.parametrize(
    ("words", "seed", "refine"),
    [
        ([], None, None),
        (["--seed", "3", "--refine", "0.1"], 3, 0.1),
        (["--seed", "median", "--refine", "estimated"], "median", "estimated"),
    ],
)
def test_a_forecast_is_told_seeds_and_noise_as_numbers_or_words(monkeypatch, words, seed, refine):
    given = []
    monkeypatch.setattr("expertaug.api.window_file.forecast_file", lambda *a: given.append(a))
    call(data, "forecast", "--model", "m", "w.csv", *words, "--class", "own:A", "--class", "own:B", "--t-end", "3")
    classes = ["own:A", "own:B"]
    assert given == [(Path("m"), Path("w.csv"), None, seed, 3.0, classes, refine, None, None)]


@pytest.mark.parametrize(
    ("said", "expected"),
    [
        ("skip_lines", "--set: found 'skip_lines'; give KEY=VALUE"),
        ("skip_lines=[1", "--set: found 'skip_lines=[1'; write the value as YAML"),
        ("skip_line=3", "--set.skip_line: unknown key; did you mean 'skip_lines'?"),
        ("skip_lines=x3", "--set.skip_lines: found 'x3'; give a whole number"),
    ],
)
def test_a_key_that_cannot_be_set_is_one_line_before_any_file_is_read(said, expected):
    with pytest.raises(InputError) as caught:
        call(data, "inspect-data", "none.csv", "--set", said)
    assert str(caught.value).startswith(expected)


def test_the_example_table_is_printed_as_it_is_made(monkeypatch, capsys):
    monkeypatch.setattr("expertaug.measurements.example.table", lambda: "t,angle\n0,1\n")
    call(data, "example-table")
    assert capsys.readouterr().out == "t,angle\n0,1\n"

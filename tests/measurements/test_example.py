"""The table that the first page's commands are tried on."""

from __future__ import annotations

import re

from expertaug.cli import main
from expertaug.measurements.example import table


def test_the_example_gives_enough_validation_windows_for_a_verdict(tmp_path, capsys):
    """A threshold of trusted, 95 % of the validation windows, needs 19 of them."""
    assert main(["example-table"]) == 0
    text = capsys.readouterr().out
    assert text == table()
    assert text.startswith("trial,time [ms],angle [deg]\n0,0,")
    path = tmp_path / "swings.csv"
    path.write_text(text, encoding="utf-8")
    assert main(["inspect-data", str(path), "--system", "pendulum", "--output", str(tmp_path / "x.png")]) == 0
    windows = re.search(r"(\d+) train, (\d+) validation, (\d+) test chunks", capsys.readouterr().out)
    assert windows and int(windows[2]) >= 19


def test_the_example_is_the_same_whenever_it_is_written():
    text = table()
    assert text == table() and len(text.splitlines()) > 10_000

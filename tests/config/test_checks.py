"""What no single block of a configuration says is checked, one line for each mistake."""

from __future__ import annotations

import pytest

from expertaug.config import checks
from expertaug.stages import STAGES
from shipped import refused


def test_results_that_cannot_be_written(base: dict, monkeypatch: pytest.MonkeyPatch) -> None:
    """Root may write anywhere, so the answer of the system is replaced."""
    monkeypatch.setattr("expertaug.config.checks.os.access", lambda *_: False)
    assert "cannot be written; choose a writable results folder" in refused(base, "results: here")


def test_texts_that_are_numbers_or_that_no_program_takes_are_told_with_their_places():
    block = {"a": {"b": ["1e3", "x\0"]}, "label": "1e3", "n": 2**70, "plain": "12", "flag": True}
    assert [(error.where, error.found) for error in checks.check_texts(block)] == [
        ("a.b[0]", "found '1e3', which YAML takes for a text"),
        ("a.b[1]", "found 'x\\x00'"),
        ("n", "found a number of 22 digits"),
    ]


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("swing", []),
        ("tables", ["the results folder needs this name"]),
        ("train", ["a stage of the workflow has this name"]),
        ("pendulum_long", ["the files of 'pendulum' would have the same names"]),
        ("pendulum_alarm", ["the files of 'pendulum' would have the same names"]),
        ("rlc_alarm", []),
    ],
)
def test_names_that_files_or_rules_need_are_no_experiments(name, expected):
    assert [error.found for error in checks.check_name(name, ["pendulum", name], STAGES)] == expected


def test_an_experiment_is_compared_with_numbers_that_there_are():
    assert {"pendulum", "rlc"} <= set(checks.published_systems())


def test_results_below_a_file_cannot_be_written(tmp_path):
    (tmp_path / "file").touch()
    (error,) = checks.check_results(str(tmp_path / "file" / "results"))
    assert error.where == "results" and error.found == f"'{tmp_path / 'file'}' is no folder"
    assert not list(checks.check_results(str(tmp_path / "new" / "results")))

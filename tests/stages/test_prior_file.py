"""Ranges that p⁺ has found are read strictly, and put wherever settings leave them open."""

from __future__ import annotations

import pytest

from expertaug.errors import InputError
from expertaug.stages.prior_file import read_ranges, with_ranges

OPEN = {"prior": "own", "fit": {"own": {"prior": "own"}, "prior": {"k": [0, 1]}}, "method": "own"}


def test_ranges_stand_at_every_depth_and_nowhere_else():
    ranges = {"k": (1.0, 2.0)}
    found = with_ranges(OPEN, ranges)
    assert found == {
        "prior": {"k": [1.0, 2.0]},
        "fit": {"own": {"prior": {"k": [1.0, 2.0]}}, "prior": {"k": [0, 1]}},
        "method": "own",
    }
    assert OPEN["prior"] == "own", "what was given is not changed"


def test_open_ranges_without_a_file_are_told():
    with pytest.raises(InputError, match="--prior: missing"):
        with_ranges({"fit": {"prior": "own"}}, None)
    assert with_ranges({"prior": None}, None) == {"prior": None}


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", '{"ranges": 3}', '{"ranges": {"k": [1]}}', '{"ranges": {"k": ["a", 2]}}']
)
def test_another_file_is_one_line(tmp_path, text):
    path = tmp_path / "prior.json"
    path.write_text(text)
    with pytest.raises(InputError, match=r"prior\.json: holds no ranges of p⁺ .*; make it again with own-prior"):
        read_ranges(path)
    path.write_text('{"ranges": {"k": [1, 2]}, "more": 3}')
    assert read_ranges(path) == {"k": [1.0, 2.0]}

"""Options that several subcommands share: settings as text or file, the tracking store, ranges of p⁺."""

from __future__ import annotations

import argparse
import json

import pytest

from expertaug.errors import InputError
from expertaug.stages import options
from expertaug.tracking.settings import Tracking


def test_settings_are_json_text_or_a_file_of_json_or_yaml(tmp_path):
    settings = {"seeds": [1, 2], "name": "x"}
    (tmp_path / "a.json").write_text(json.dumps(settings))
    (tmp_path / "a.yaml").write_text("# mine\nseeds: [1, 2]\nname: x\n")
    for text in (json.dumps(settings), f"  {json.dumps(settings)}", str(tmp_path / "a.json"), str(tmp_path / "a.yaml")):
        assert options.read_settings(text) == settings


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("nowhere.json", "nowhere.json: No such file or directory; give JSON text or the path of a file"),
        ('{"a": ', "neither JSON nor YAML"),
        ("list.yaml", "holds list; give a JSON object"),
    ],
)
def test_settings_that_are_none_are_one_line(tmp_path, monkeypatch, text, expected):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "list.yaml").write_text("[1]\n")
    with pytest.raises(InputError) as caught:
        options.read_settings(text)
    assert str(caught.value).startswith("--settings: ") and expected in str(caught.value)


def test_the_tracking_store_is_what_its_file_says(tmp_path):
    store = {"enabled": True, "uri": "sqlite:///x.db", "experiment": "e", "experiments": {"swing": "3"}}
    marker = tmp_path / "tracking.json"
    given = argparse.Namespace(tracking=marker, stage="train")
    marker.write_text(json.dumps(store))
    assert options.tracking_of(given) == Tracking(**store, rule="train")
    marker.write_text('{"enabled": false}')
    assert options.tracking_of(given) is None
    assert options.tracking_of(argparse.Namespace(tracking=None)) is None
    marker.write_text("{}")
    with pytest.raises(InputError, match="does not say which tracking store"):
        options.tracking_of(given)


def test_ranges_that_were_found_stand_where_settings_leave_them_open(tmp_path):
    (tmp_path / "prior.json").write_text('{"ranges": {"k": [1, 2]}}')
    parser = argparse.ArgumentParser()
    options.add_prior(parser)
    given = parser.parse_args(["--prior", str(tmp_path / "prior.json")])
    assert options.with_prior(given, {"prior": "own", "n": 1}) == {"prior": {"k": [1.0, 2.0]}, "n": 1}
    assert options.with_prior(parser.parse_args([]), {"prior": None}) == {"prior": None}

"""The schema that editors read agrees with the files of the project and refuses what the models refuse."""

from __future__ import annotations

import re
from pathlib import Path

import yaml
from jsonschema import Draft202012Validator

from expertaug.config import schema

ROOT = Path(__file__).parents[2]


def test_editors_see_what_the_files_may_say():
    validator = Draft202012Validator(schema.schema())
    files = [*(ROOT / "config").glob("*.yaml"), *(ROOT / "config" / "experiments").glob("*.yaml")]
    assert len(files) > 7
    for file in files:
        text = file.read_text(encoding="utf-8")
        found = re.match(r"# yaml-language-server: \$schema=(\S+)", text)
        assert found and (file.parent / found[1]).resolve() == ROOT / "config" / "schema.json"
        assert not list(validator.iter_errors(yaml.safe_load(text)))
    wrong = {
        "model": {"encoder": {"kind": "window", "layers": "x"}},
        "training": {"epoch": 1},
        "overrides": {"hvae": {"training": {"epochs": 0}}},
    }
    places = {tuple(e.absolute_path)[2:4] for e in validator.iter_errors({"experiments": {"x": wrong}})}
    assert places == {("model", "encoder"), ("training",), ("overrides", "hvae")}

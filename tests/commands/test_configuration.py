"""Subcommands about configurations: what is wrong is one line, and what is right is shown."""

from __future__ import annotations

from pathlib import Path

import pytest

from expertaug.commands import configuration
from expertaug.errors import InputError
from subcommands import call

ROOT = Path(__file__).parents[2]


def test_validate(tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT)
    call(configuration, "validate", "config/config.yaml", "config/smoke.yaml")
    bad = tmp_path / "bad.yaml"
    bad.write_text("seeds: [one]\n")
    with pytest.raises(InputError, match=r"^seeds\[0\]: found 'one'; give a whole number$"):
        call(configuration, "validate", "config/config.yaml", bad)


def test_files_stand_over_the_default_configuration(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("my.yaml").write_text("experiments: {pendulum: {training: {epochs: 7}}}")
    call(configuration, "config", "show", "pendulum", "aphynity", "epochs", "--configfile", "my.yaml")
    shown = capsys.readouterr().out
    assert "training.epochs: 7" in shown and "my.yaml:1" in shown

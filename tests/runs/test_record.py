"""A results folder remembers by which files it is configured."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from expertaug.config.models import Configuration, TrackingKeys
from expertaug.errors import InputError
from expertaug.runs import record


def changed(config: Configuration, change: dict) -> Configuration:
    return config.model_copy(update=change)


@pytest.fixture
def finished(tmp_path, monkeypatch) -> Configuration:
    """A configuration whose run, without other files, has ended."""
    monkeypatch.chdir(tmp_path)
    config = Configuration.model_construct(results="results", overwrite=False, seeds=[0], run=["a"])
    record.remember(config, [])
    Path("results/tables").mkdir()
    Path("results/tables/a_long.csv").touch()
    return config


def test_other_files_are_refused_before_they_overwrite_tables(finished):
    other = changed(finished, {"seeds": [1]})
    with pytest.raises(InputError, match=r"of the default configuration, not of my\.yaml; .*overwrite"):
        record.refuse_another(other, ["my.yaml"])
    record.refuse_another(changed(other, {"overwrite": True}), ["my.yaml"])
    record.remember(other, [Path("my.yaml").absolute()])
    record.refuse_another(other, ["my.yaml"])
    record.refuse_another(finished, [])
    with pytest.raises(InputError, match=r"holds the tables of my\.yaml, not of a\.yaml and b\.yaml"):
        record.refuse_another(changed(finished, {"seeds": [2]}), ["a.yaml", "b.yaml"])


def test_the_same_files_may_say_something_else(finished):
    record.refuse_another(changed(finished, {"seeds": [1]}), [])
    record.remember(changed(finished, {"seeds": [1]}), [])
    record.refuse_another(finished, [])


@pytest.mark.parametrize("change", [{"run": ["a", "b"]}, {"device": "cpu"}, {"tracking": TrackingKeys(enabled=False)}])
def test_files_that_change_no_table_are_not_refused(finished, change):
    record.refuse_another(changed(finished, change), ["my.yaml"])


def test_a_folder_without_tables_or_record_is_free(finished):
    other = changed(finished, {"seeds": [1]})
    Path("results/tables/a_long.csv").unlink()
    record.refuse_another(other, ["my.yaml"])
    Path("results/tables/a_long.csv").touch()
    for text in (None, "{}", "[]", json.dumps({"runs": [3]})):
        Path("results", record.NAME).unlink(missing_ok=True)
        if text is not None:
            Path("results", record.NAME).write_text(text)
        record.refuse_another(other, ["my.yaml"])


def test_a_run_says_at_which_revisions_it_filled_the_folder(finished, monkeypatch):
    one = changed(finished, {"results": "one"})
    for revision in ("a", "b", "a", None):
        monkeypatch.setattr(record, "revision", lambda revision=revision: revision)
        record.remember(one, [])
    assert record.revisions(Path("one")) == ["a", "b", "unknown"]
    assert record.revisions(Path("elsewhere")) == []
